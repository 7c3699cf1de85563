"""Keeps the logins of a console in a file, so that they outlive a restart of the console.

The file holds digests of the cookies, not the cookies: who reads it cannot log in by it. A new
token ends all logins that were made with the one before.
"""

import hashlib
import json
import os
import stat
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Final

from rig.unique_keys import json_of

LARGEST_FILE: Final = 1 << 20
"""Most bytes of the file that are read; the most logins that a console keeps need a twentieth."""
LONGEST_NAME: Final = 32
"""Most characters of a visitor's name."""


@dataclass(frozen=True)
class Login:
    """A login as the file has it.

    Attributes:
        cookie: SHA-256 of the cookie, in hexadecimal digits.
        number: number of the login.
        name: name of the visitor.
        left_s: time in s for which the login still lasts.
        proof: of the account's password, to which the login belongs; empty without accounts.
        unused_s: time in s since somebody last acted with it; 0 without accounts.
    """

    cookie: str
    number: int
    name: str
    left_s: float
    proof: str = ""
    unused_s: float = 0.0


class LoginFile:
    """The file with the logins of one console.

    A file that is missing, damaged or not of this token holds no logins. Neither does what is no
    regular file, such as a pipe, nor a file that is another user's or that others may write. One
    that cannot be written keeps none, and the console works without.

    Args:
        path: the file; only its owner may read it.
        token: digest of the console's token in hexadecimal digits, which the logins belong to.
        clock: returns the wall clock in s since 1970, by which logins last while no console runs.
    """

    def __init__(self, path: Path, token: str, clock: Callable[[], float] = time.time) -> None:
        self._path = path
        self._token = token
        self._clock = clock

    def read(self, lifetime_s: float) -> list[Login]:
        """Return the logins that still last, in the order of the file.

        Args:
            lifetime_s: the longest time in s for which a login lasts. A login that the file has
                last longer, as after the wall clock was set back, lasts for that time from now on,
                which is written to the file so that a restart does not begin it anew. A login with
                a longer name than a visitor can have is left out.
        """
        found: list[Login] = []
        too_long = False
        with suppress(OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
            content = json_of(self._content())
            if content["token"] != self._token:
                return []
            now = self._clock()
            for each in content["logins"]:
                stated_s = float(each["until_s"]) - now
                left_s = min(stated_s, lifetime_s)
                name, number = str(each["name"]), int(each["number"])
                if left_s > 0.0 and 0 < len(name) <= LONGEST_NAME:
                    proof = str(each.get("proof", ""))
                    # A clock that was set back makes a login no older than it is.
                    unused_s = max(0.0, now - float(each.get("used_s", now)))
                    cookie = str(each["cookie"])
                    found.append(Login(cookie, number, name, left_s, proof, unused_s))
                    too_long |= stated_s > lifetime_s
        if too_long:
            self.write(found)
        return found

    def _content(self) -> bytes:
        """Return the bytes of the file.

        Raises:
            OSError: the file cannot be read, is no regular file, is another user's, or may be
                written by others.
        """
        # Opening a pipe would otherwise wait until somebody writes to it.
        with os.fdopen(os.open(self._path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            state = os.fstat(file.fileno())
            foreign = state.st_uid != os.geteuid() or state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            if foreign or not stat.S_ISREG(state.st_mode):
                raise PermissionError(f"{self._path}: is not this user's own file")
            return file.read(LARGEST_FILE)

    def write(self, logins: Iterable[Login]) -> None:
        """Replace the file's logins by these."""
        now = self._clock()
        held: list[dict[str, Any]] = [
            {"cookie": each.cookie, "number": each.number, "name": each.name,
             "until_s": now + each.left_s,
             **({"proof": each.proof, "used_s": now - each.unused_s} if each.proof else {})}
            for each in logins
        ]  # fmt: skip
        text = json.dumps({"token": self._token, "logins": held})
        with suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            # A temporary file may be read by its owner only, and so may what it becomes.
            with NamedTemporaryFile("w", dir=self._path.parent, delete=False) as file:
                try:
                    file.write(text)
                    file.flush()
                    os.replace(file.name, self._path)
                finally:
                    # It is still there only if the disk is full or the file cannot be replaced.
                    Path(file.name).unlink(missing_ok=True)


def account_logins(folder: Path, port: int, accounts: Path) -> LoginFile:
    """Return the file with the logins of this user's console at a port that has accounts.

    Args:
        folder: the folder with this user's keys and tokens.
        port: the port, by which the console's cookie is named as well.
        accounts: the file of accounts, which the logins belong to.
    """
    digest = hashlib.sha256(os.fsencode(accounts.absolute())).hexdigest()
    return LoginFile(folder / f"console-account-logins-{port}.json", digest)


def login_file(folder: Path, port: int, token: str) -> LoginFile:
    """Return the file with the logins of this user's console at a port.

    Args:
        folder: the folder with this user's keys and tokens.
        port: the port, by which the console's cookie is named as well.
        token: the console's token.
    """
    digest = hashlib.sha256(token.encode()).hexdigest()
    return LoginFile(folder / f"console-logins-{port}.json", digest)
