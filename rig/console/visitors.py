"""Visitors log in with a token that cannot be guessed, and are then known by a secret cookie.

At most one visitor at a time has control and may act on the rigs; everybody sees who it is.
"""

import hashlib
import hmac
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rig.accounts import Role
from rig.stream import own_key

from .logins import LONGEST_NAME, Login, LoginFile

LIFETIME_S: Final = 12 * 3600.0
"""Time in s after which a login ends: a shift."""
FAILURES: Final = 5
"""Wrong tokens from one address within `FAILURES_S` s after which it must wait with another one."""
FAILURES_S: Final = 60.0
MOST_VISITORS: Final = 200
MOST_ADDRESSES: Final = 1000
TOKEN_FILE: Final = "console.token"


class LoginRefused(Exception):  # noqa: N818 (a refusal, not a failure)
    """The error of a login that is refused; its message is the reason.

    Attributes:
        wait_s: time in s after which another attempt makes sense; 0 for at once.
    """

    def __init__(self, text: str, wait_s: float = 0.0) -> None:
        self.wait_s = wait_s
        super().__init__(text)


@dataclass(frozen=True)
class Visitor:
    """Somebody who has logged in.

    Attributes:
        number: number of the login, from 1 on; unlike the cookie it is shown to everybody.
        name: name as given at login.
        until: time in s on the clock of `Visitors` at which the login ends.
        role: what the visitor may do, now; whoever has the token may do everything. It may change
            while the login lasts, and makes no other visitor.
        expired: whether the login has ended, so that all that is left of it is to stop.
    """

    number: int
    name: str
    until: float
    role: Role = field(default=Role.ENGINEER, compare=False)
    expired: bool = field(default=False, compare=False)


def console_token() -> tuple[str, Path]:
    """Return the token with which one logs in to this user's consoles, and its file.

    The token, hexadecimal digits, is made if the file does not exist.

    Raises:
        KeyFileError: the file cannot be made, or cannot be used.
    """
    key, path = own_key(TOKEN_FILE)
    return key.hex(), path


class Visitors:
    """The visitors who are logged in, at most `MOST_VISITORS`.

    Args:
        token: the token that a visitor must give at login.
        clock: returns a monotonic time in s.
        file: keeps the logins over a restart of the console; None if they end with it.
    """

    def __init__(
        self,
        token: str,
        clock: Callable[[], float] = time.monotonic,
        file: LoginFile | None = None,
    ) -> None:
        self._token = hashlib.sha256(token.encode()).digest()
        self._clock = clock
        self._file = file
        self._known: OrderedDict[str, Visitor] = OrderedDict()
        """Visitors by the digests of their cookies, the oldest login first."""
        self._failures: OrderedDict[str, deque[float]] = OrderedDict()
        for each in file.read(LIFETIME_S)[-MOST_VISITORS:] if file is not None else ():
            self._known[each.cookie] = Visitor(each.number, each.name, clock() + each.left_s)
        self._count = max((visitor.number for visitor in self._known.values()), default=0)

    def log_in(self, token: str, name: str, address: str) -> str:
        """Log a visitor in, and return the cookie; spaces around token and name do not count.

        If there are too many visitors, the oldest login ends. The right token is always accepted.

        Raises:
            LoginRefused: the token is wrong, or the name is missing or too long. After `FAILURES`
                wrong tokens from this address, the error gives a time to wait.
        """
        # Digests have the same length, so the time of the comparison shows nothing of the token.
        given = hashlib.sha256(token.strip().encode(errors="replace")).digest()
        if not hmac.compare_digest(given, self._token):
            # Only wrong tokens are limited: 256 bits cannot be guessed, and an attacker behind the
            # same tunnel or proxy shares an address with the operators, who must not be kept out.
            self._note_failure(address)
            raise LoginRefused("this is not the token")
        name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
        if not 0 < len(name) <= LONGEST_NAME:
            raise LoginRefused(f"give a name, of {LONGEST_NAME} characters at most")
        self._count += 1
        cookie = secrets.token_urlsafe(32)
        self._known[cookie_digest(cookie)] = Visitor(self._count, name, self._clock() + LIFETIME_S)
        while len(self._known) > MOST_VISITORS:
            self._known.popitem(last=False)
        self._keep()
        return cookie

    def visitor(self, cookie: str | None) -> Visitor | None:
        """Return the visitor who has this cookie; None if nobody has, or the login has ended."""
        found = self._known.get(cookie_digest(cookie))
        return None if found is None or found.until < self._clock() else found

    def log_out(self, cookie: str | None) -> None:
        """End the login with this cookie, if there is one."""
        if self._known.pop(cookie_digest(cookie), None) is not None:
            self._keep()

    def _keep(self) -> None:
        """Write the logins that last to the file, if there is one."""
        now = self._clock()
        if self._file is not None:
            self._file.write(
                Login(cookie, visitor.number, visitor.name, visitor.until - now)
                for cookie, visitor in self._known.items()
                if visitor.until > now
            )

    def _note_failure(self, address: str) -> None:
        """Note a wrong token from an address; after too many, raise `LoginRefused` instead."""
        now = self._clock()
        failed = self._failures.setdefault(address, deque(maxlen=FAILURES))
        while failed and failed[0] < now - FAILURES_S:
            failed.popleft()
        if len(failed) >= FAILURES:
            wait_s = FAILURES_S - (now - failed[0])
            raise LoginRefused(f"too many wrong tokens; wait {wait_s:.0f} s", wait_s)
        failed.append(now)
        self._failures.move_to_end(address)
        while len(self._failures) > MOST_ADDRESSES:
            self._failures.popitem(last=False)


def cookie_digest(cookie: str | None) -> str:
    """Return SHA-256 of a cookie in hexadecimal digits; that of an empty one if there is none."""
    return hashlib.sha256((cookie or "").encode(errors="replace")).hexdigest()


class NotInControl(Exception):  # noqa: N818 (a refusal, not a failure)
    """The error of a visitor who may not act, or may not take control.

    The message says who has control, or that nobody has. `ControlHolder.take` raises it if somebody
    else has control, `ControlHolder.require` also if nobody has control.
    """


@dataclass
class ControlHolder:
    """The record of which visitor has control; at first nobody has.

    Attributes:
        say: is called with a sentence on every change.
        clock_ns: returns the wall clock in ns since 1970.
        holder: the visitor who has control; None if nobody has.
        since_ns: time of the last change, ns since 1970; 0 if there was none.
    """

    say: Callable[[str], None]
    clock_ns: Callable[[], int] = time.time_ns
    holder: Visitor | None = None
    since_ns: int = 0

    def take(self, visitor: Visitor, *, over: bool = False) -> None:
        """Give a visitor control; do nothing if the visitor has it already.

        Args:
            visitor: the visitor who asks for control.
            over: whether control is taken from somebody else who has it, for which the visitor must
                have asked explicitly.

        Raises:
            NotInControl: somebody else has control, and `over` is false.
        """
        before = self.holder
        if before == visitor:
            return
        if before is not None and not over:
            raise NotInControl(f"{before.name} has control; take over, if it is agreed")
        self.holder, self.since_ns = visitor, self.clock_ns()
        taken = " control" if before is None else f" over from {before.name}"
        if before is not None and before.name == visitor.name:
            taken = " control on another page"
        self.say(f"{visitor.name} takes{taken}")

    def release(self, visitor: Visitor, why: str = "gives control up") -> None:
        """Release control if this visitor has it, and say why; otherwise do nothing."""
        if self.holder == visitor:
            self.holder = None
            self.since_ns = self.clock_ns()
            self.say(f"{visitor.name} {why}")

    def require(self, visitor: Visitor) -> None:
        """Raise unless this visitor has control.

        Raises:
            NotInControl: somebody else has control, or nobody has.
        """
        if self.holder is None:
            raise NotInControl("nobody has control; take it first")
        if self.holder != visitor:
            raise NotInControl(f"{self.holder.name} has control")

    def content(self) -> dict[str, Any]:
        """Return `number` and `name` of the visitor in control, both None if nobody has it.

        `since_ms` is the time of the last change, ms since 1970; 0 if there was none.
        """
        holder = self.holder
        return {
            "number": None if holder is None else holder.number,
            "name": None if holder is None else holder.name,
            "since_ms": self.since_ns // 10**6,
        }
