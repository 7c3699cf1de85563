"""Visitors log in with a token that cannot be guessed, and are then known by a secret cookie."""

import hashlib
import hmac
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rig.stream import own_key

LIFETIME_S: Final = 12 * 3600.0
"""Time in s after which a login ends: a shift."""
FAILURES: Final = 5
"""Wrong tokens from one address within `FAILURES_S` s after which it must wait with another one."""
FAILURES_S: Final = 60.0
MOST_VISITORS: Final = 200
MOST_ADDRESSES: Final = 1000
LONGEST_NAME: Final = 32
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
    """

    number: int
    name: str
    until: float


def console_token() -> tuple[str, Path]:
    """Return the token with which one logs in to this user's consoles, and its file.

    The token is made at the first call.

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
    """

    def __init__(self, token: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._token = hashlib.sha256(token.encode()).digest()
        self._clock = clock
        self._known: OrderedDict[str, Visitor] = OrderedDict()
        self._failures: OrderedDict[str, deque[float]] = OrderedDict()
        self._count = 0

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
            self._check_rate(address)
            self._failed(address)
            raise LoginRefused("this is not the token")
        name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
        if not 0 < len(name) <= LONGEST_NAME:
            raise LoginRefused(f"give a name, of {LONGEST_NAME} characters at most")
        self._count += 1
        cookie = secrets.token_urlsafe(32)
        self._known[cookie] = Visitor(self._count, name, self._clock() + LIFETIME_S)
        while len(self._known) > MOST_VISITORS:
            self._known.popitem(last=False)
        return cookie

    def visitor(self, cookie: str | None) -> Visitor | None:
        """Return the visitor who has this cookie; None if nobody has, or the login has ended."""
        found = self._known.get(cookie) if cookie else None
        if found is None or found.until < self._clock():
            return None
        return found

    def log_out(self, cookie: str | None) -> None:
        """End the login with this cookie, if there is one."""
        if cookie:
            self._known.pop(cookie, None)

    def _check_rate(self, address: str) -> None:
        now = self._clock()
        failed = self._failures.get(address, deque())
        while failed and failed[0] < now - FAILURES_S:
            failed.popleft()
        if len(failed) >= FAILURES:
            wait_s = FAILURES_S - (now - failed[0])
            raise LoginRefused(f"too many wrong tokens; wait {wait_s:.0f} s", wait_s)

    def _failed(self, address: str) -> None:
        self._failures.setdefault(address, deque(maxlen=FAILURES)).append(self._clock())
        self._failures.move_to_end(address)
        while len(self._failures) > MOST_ADDRESSES:
            self._failures.popitem(last=False)
