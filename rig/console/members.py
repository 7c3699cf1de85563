"""Members log in to a console by their accounts: name and password, a role, and a time to act.

A login ends for acting and seeing after `LIFETIME_S`, or after `IDLE_S` without an act; what is
left of it is to stop, for `STOPPING_S` more. The file of accounts is watched: whoever is removed,
or gets another password, is logged out, and another role holds from then on.
"""

import asyncio
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

from rig.accounts import (
    Account,
    AccountFile,
    AccountsError,
    Attempts,
    Passwords,
    Role,
    TooManyAttemptsError,
    name_key,
)

from .logins import LONGEST_NAME, Login, LoginFile
from .visitors import LIFETIME_S, MOST_VISITORS, LoginRefused, Visitor, cookie_digest

IDLE_S: Final = 2 * 3600.0
"""Time in s without an order or a loaded page after which a login ends, of operator or engineer.

It bounds how long a screen that was left alone can be acted on, and is longer than a watch between
two rounds. A viewer's login can only look and stop, so that an open page is use enough.
"""
STOPPING_S: Final = 7 * 24 * 3600.0
"""Time in s after its end for which a login may still stop: a page left open over the holidays."""
WATCH_S: Final = 0.2
"""Period in s at which the file of accounts is looked at."""
KEEP_S: Final = 60.0
"""Longest time in s by which the file of logins is behind with when each was last used."""
MOST_WAITING: Final = 8
"""Most passwords that wait to be compared, one at a time: a fifth of a second of one processor."""
WRONG: Final = "name or password is wrong"


@dataclass
class _Login:
    """A login: its number, the member's name as logged in, the proof, and times on the clock."""

    number: int
    name: str
    proof: str
    until: float
    used: float


class Members:
    """Whoever is logged in by an account, at most `MOST_VISITORS`.

    Args:
        accounts: the file of accounts.
        say: is called with a sentence when the file cannot be used any more, and when it can again.
        passwords: compares the passwords that are given with the accounts' hashes.
        clock: returns a monotonic time in s.
        file: keeps the logins over a restart of the console; None if they end with it.

    Raises:
        AccountsError: the file cannot be used, or holds no account.
    """

    def __init__(
        self,
        accounts: AccountFile,
        say: Callable[[str], None],
        passwords: Passwords,
        clock: Callable[[], float] = time.monotonic,
        file: LoginFile | None = None,
    ) -> None:
        self._file, self._say, self._clock, self._logins = accounts, say, clock, file
        self._passwords = passwords
        self._attempts = Attempts(clock)
        self._comparing = ThreadPoolExecutor(1, "password")
        self._waiting = 0
        self._stamp = accounts.stamp()
        self._accounts: dict[str, Account] = usable_accounts(accounts)
        self._problem = ""
        self._known: OrderedDict[str, _Login] = OrderedDict()
        """Logins by the digests of their cookies, the oldest first."""
        now = clock()
        kept = file.read(LIFETIME_S + STOPPING_S) if file is not None else []
        for each in kept[-MOST_VISITORS:]:
            until = now + each.left_s - STOPPING_S
            used = now - each.unused_s
            self._known[each.cookie] = _Login(each.number, each.name, each.proof, until, used)
        self._count = max((each.number for each in self._known.values()), default=0)
        self._kept_at = now

    # -- the file of accounts ---------------------------------------------------------------------

    def watch(self, ended: threading.Event) -> None:
        """Look at the file of accounts every `WATCH_S` until an event is set.

        It is for a thread of its own, so that a disk that hangs delays nobody's stop.
        """
        while not ended.wait(WATCH_S):
            self.look()

    def look(self) -> None:
        """Take the accounts anew if their file has changed.

        If it is gone, damaged or open to others, nobody may do anything but stop until it is
        mended. After another error of the disk the accounts stay as they were.
        """
        try:
            stamp = self._file.stamp()
            if stamp == self._stamp:
                return
            accounts, problem = self._file.read(), ""
        except FileNotFoundError:
            stamp, accounts, problem = (), {}, f"{self._file.path}: is gone"
        except AccountsError as error:
            accounts, problem = {}, str(error)
        except OSError as error:
            problem = f"{self._file.path}: cannot be read: {error.strerror}"
            if problem != self._problem:
                self._problem = problem
                self._say(f"accounts: {problem}; they stay as they were")
            return
        self._stamp, self._accounts = stamp, accounts
        if problem:
            self._say(f"accounts: {problem}; until it is mended nobody may do anything but stop")
        elif self._problem:
            self._say("accounts: the file can be used again")
        self._problem = problem

    # -- logging in and out -----------------------------------------------------------------------

    async def log_in(self, name: str, password: str, address: str, cookie: str | None) -> str:
        """Log a member in by name and password, and return the cookie.

        If there are too many logins, the oldest one ends. Names without an account take as long.

        Args:
            name: the name of the account, in any case.
            password: the password.
            address: address that the attempt comes from.
            cookie: the cookie that came with it. A browser that was logged in by this account
                before is counted by itself, so that guesses from its address do not keep it out.

        Raises:
            LoginRefused: name or password is wrong, the accounts cannot be used, or it must wait.
        """
        if self._problem and not self._accounts:
            raise LoginRefused("the file of accounts cannot be used; see the console's log")
        key = name_key(name) if len(name) <= 2 * LONGEST_NAME else ""
        account = self._accounts.get(key)
        before = self._known.get(cookie_digest(cookie))
        mine = before is not None and account is not None and before.proof == account.proof
        source = f"login {before.number}" if before is not None and mine else f"address {address}"
        if self._waiting >= MOST_WAITING:
            raise LoginRefused("too many log in at once; try again", 1.0)
        try:
            self._attempts.begin(source, key or "-")
        except TooManyAttemptsError as error:
            raise LoginRefused(str(error), error.wait_s) from None
        hashed = self._passwords.decoy if account is None else account.password
        loop = asyncio.get_running_loop()
        self._waiting += 1
        try:
            comparing = loop.run_in_executor(
                self._comparing, self._passwords.fits, hashed, password
            )
            fits = await comparing
        finally:
            self._waiting -= 1
        if not fits or account is None or self._accounts.get(key) != account:
            raise LoginRefused(WRONG)
        self._attempts.take_back(source, key)
        return self._begin(account)

    def _begin(self, account: Account) -> str:
        self._count += 1
        cookie, now = secrets.token_urlsafe(32), self._clock()
        self._known[cookie_digest(cookie)] = _Login(
            self._count, account.name, account.proof, now + LIFETIME_S, now
        )
        while len(self._known) > MOST_VISITORS:
            self._known.popitem(last=False)
        self._keep()
        return cookie

    def log_out(self, cookie: str | None) -> None:
        """End the login with this cookie for everything, if there is one."""
        if self._known.pop(cookie_digest(cookie), None) is not None:
            self._keep()

    # -- who may do what --------------------------------------------------------------------------

    def visitor(self, cookie: str | None, *, acts: bool = False) -> Visitor | None:
        """Return the visitor who has this cookie, with the role as it is now.

        Args:
            cookie: the cookie.
            acts: whether the visitor does something now, which keeps the login from ending.

        Returns:
            The visitor, whose `expired` says that nothing but a stop is left; None if nobody has
            the cookie, or its account was removed or has got another password since.
        """
        digest = cookie_digest(cookie)
        visitor, now = self._visitor(digest), self._clock()
        if visitor is not None and acts and not visitor.expired:
            self._known[digest].used = now
            if now - self._kept_at > KEEP_S:
                self._keep()
        return visitor

    def may_act(self, number: int) -> bool:
        """Return whether the login of this number is an operator's or engineer's and lasts."""
        for digest, login in list(self._known.items()):
            if login.number == number:
                visitor = self._visitor(digest)
                return visitor is not None and not visitor.expired and visitor.role > Role.VIEWER
        return False

    def _visitor(self, digest: str) -> Visitor | None:
        login = self._known.get(digest)
        if login is None:
            return None
        now = self._clock()
        if self._problem and not self._accounts:
            return Visitor(login.number, login.name, login.until, Role.VIEWER, expired=True)
        account = self._accounts.get(name_key(login.name))
        if account is None or account.proof != login.proof or now > login.until + STOPPING_S:
            self._known.pop(digest, None)
            return None
        rested = now - login.used > IDLE_S and account.role > Role.VIEWER
        expired = now > login.until or rested
        return Visitor(login.number, account.name, login.until, account.role, expired)

    def _keep(self) -> None:
        """Write the logins that may still stop to their file, if there is one."""
        now = self._clock()
        self._kept_at = now
        if self._logins is not None:
            self._logins.write(
                Login(
                    digest,
                    login.number,
                    login.name,
                    login.until + STOPPING_S - now,
                    login.proof,
                    now - login.used,
                )
                for digest, login in self._known.items()
                if login.until + STOPPING_S > now
            )


def usable_accounts(file: AccountFile) -> dict[str, Account]:
    """Return the accounts of a file by which a console can be begun.

    Raises:
        AccountsError: the file cannot be read, or holds no account.
    """
    try:
        accounts = file.read()
    except OSError as error:
        text = f"{file.path}: cannot be read: {error.strerror}; make it by rig accounts add"
        raise AccountsError(text) from None
    if not accounts:
        remedy = "add one by rig accounts add, or take the file away to log in with the token"
        raise AccountsError(f"{file.path}: holds no account; {remedy}")
    return accounts
