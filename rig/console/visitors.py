"""Who has logged in: sessions by a secret cookie, after a token that guessing does not find."""

import hashlib
import hmac
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rig.stream import local_state, make_key, read_key

LIFETIME_S: Final = 12 * 3600.0
"""How long a login lasts: a shift."""
FAILURES: Final = 5
"""Wrong tokens within `FAILURES_S` after which the next wrong one is not even judged."""
FAILURES_S: Final = 60.0
MOST_VISITORS: Final = 200
MOST_ADDRESSES: Final = 1000
LONGEST_NAME: Final = 32
TOKEN_FILE: Final = "console.token"


class LoginRefused(Exception):  # noqa: N818 (a refusal, not a failure)
    """Somebody who is not let in.

    Attributes:
        wait_s: after which trying again makes sense; 0 at once.
    """

    def __init__(self, text: str, wait_s: float = 0.0) -> None:
        self.wait_s = wait_s
        super().__init__(text)


@dataclass(frozen=True)
class Visitor:
    """Somebody who has logged in.

    Attributes:
        number: from 1 on, which everybody may know; the cookie is nobody's business.
        name: as given at login.
        until: when it ends, on the visitors' clock.
    """

    number: int
    name: str
    until: float


def console_token() -> tuple[str, Path]:
    """Return this user's token to log in with, made when first asked for, and its file.

    Raises:
        KeyFileError: it cannot be made, or used.
    """
    path = local_state() / TOKEN_FILE
    if not path.exists():
        make_key(path)
    return read_key(path).hex(), path


class Visitors:
    """Those who are logged in.

    Args:
        token: what they have to know.
        clock: monotonic, s.
    """

    def __init__(self, token: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._token = hashlib.sha256(token.encode()).digest()
        self._clock = clock
        self._known: OrderedDict[str, Visitor] = OrderedDict()
        self._failures: OrderedDict[str, deque[float]] = OrderedDict()
        self._count = 0

    def log_in(self, token: str, name: str, address: str) -> str:
        """Return the cookie of a new visitor.

        Raises:
            LoginRefused: the token is wrong, there were too many wrong ones, or no name is given.
        """
        # Digests are of one length: the time taken shows nothing of the token.
        given = hashlib.sha256(token.strip().encode(errors="replace")).digest()
        if not hmac.compare_digest(given, self._token):
            # The right one is let in always: its 256 bits are not guessed, and whoever guesses
            # shares an address with the operators where all come through one (a tunnel, a proxy).
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
        """Return whose cookie this is; None if it is nobody's."""
        found = self._known.get(cookie) if cookie else None
        if found is None or found.until < self._clock():
            return None
        return found

    def log_out(self, cookie: str | None) -> None:
        """Forget a cookie."""
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
