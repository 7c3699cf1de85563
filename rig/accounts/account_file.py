"""The file of accounts: names, roles and hashes of passwords, for its owner's eyes only.

A change replaces the whole file at once, under a lock, and is on the disk before it is answered: a
process that is killed at any moment leaves the accounts as they were before or after its change.
"""

import fcntl
import hashlib
import json
import os
import stat
import time
import unicodedata
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from rig.unique_keys import RepeatedLineError, json_of

from .passwords import is_hash
from .roles import Role

FILE_NAME: Final = "console-accounts.json"
"""Name of the file of accounts that is used unless another one is named."""
VERSION: Final = 1
LARGEST_FILE: Final = 1 << 20
"""Most bytes of the file; the most accounts, with the longest names, need a tenth."""
MOST_ACCOUNTS: Final = 200
"""Most accounts of a file, as many as visitors of a console."""
LONGEST_NAME: Final = 32
"""Most characters of a name, as for the visitors of a console with a token."""
LOCK_S: Final = 10.0
"""Time in s for which another process's change is awaited."""
_AGAIN_S: Final = 0.02
_SIGNS: Final = " .-_'"
_KEYS: Final = {"name", "role", "password"}


class AccountsError(ValueError):
    """The error of a file of accounts that cannot be used or changed.

    Attributes:
        problems: the reasons, as one line each, with file, value, limit and remedy.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = [*problems]
        super().__init__("\n".join(problems))


@dataclass(frozen=True)
class Account:
    """An account.

    Attributes:
        name: the person's name, as journals and pages show it.
        role: what the person may do.
        password: the hash of the password.
    """

    name: str
    role: Role
    password: str

    @property
    def proof(self) -> str:
        """A digest of the password's hash, in hexadecimal digits.

        Logins belong to it. It changes with the password, and if the account is removed and made
        anew, as every hash has a salt of its own.
        """
        return hashlib.sha256(self.password.encode()).hexdigest()[:32]


def name_key(name: str) -> str:
    """Return what two spellings of one name have in common: signs in compatible form, no case."""
    return unicodedata.normalize("NFKC", " ".join(name.split())).casefold()


def checked_name(name: str) -> str:
    """Return a name in the form in which it is kept, with single spaces and composed signs.

    Raises:
        ValueError: it is empty or too long, begins with another sign than a letter or a digit, or
            holds a sign other than letters, digits, spaces and `.-_'`. A colon, for example, ends
            the name in the remarks of a journal.
    """
    text = unicodedata.normalize("NFC", name).strip(" ")
    shown = f"name {_shown(name)!r}"
    if not 0 < len(text) <= LONGEST_NAME:
        raise ValueError(f"{shown}: a name has 1 to {LONGEST_NAME} characters; take another")
    # Marks belong to the letters of many scripts.
    fits = all(c.isalnum() or c in _SIGNS or unicodedata.category(c) in ("Mn", "Mc") for c in text)
    if not fits or not text[0].isalnum():
        signs = f"letters, digits, spaces and {_SIGNS.strip()}"
        raise ValueError(f"{shown}: a name is of {signs}, and begins with a letter or a digit")
    return " ".join(text.split())


class AccountFile:
    """The file of accounts.

    Args:
        path: the file, which its owner alone may read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> dict[str, Account]:
        """Return the accounts by `name_key`, in the order in which they were made.

        Raises:
            FileNotFoundError: there is no such file.
            OSError: it cannot be read.
            AccountsError: it is another user's, others may read it, or its content is none of
                accounts. All that is wrong with the accounts is told at once.
        """
        return _accounts(self._content(), self.path)

    def exists(self) -> bool:
        """Return whether there is anything at the file's path.

        Raises:
            OSError: a folder above it may not be entered, so that nobody knows.
        """
        try:
            os.lstat(self.path)
        except (FileNotFoundError, NotADirectoryError):
            return False
        return True

    def stamp(self) -> tuple[int, ...]:
        """Return numbers that change when the file is replaced or changed; () if it is not there.

        Raises:
            OSError: they cannot be read.
        """
        try:
            state = os.stat(self.path)
        except FileNotFoundError:
            return ()
        return state.st_ino, state.st_mtime_ns, state.st_ctime_ns, state.st_size

    def check(self, name: str) -> None:
        """Check that there is an account of this name.

        Raises:
            AccountsError: there is none, or the file cannot be read.
        """
        try:
            accounts = self.read() if self.exists() else {}
        except OSError as error:
            raise AccountsError(f"{self.path}: cannot be read: {error.strerror}") from None
        self._there(accounts, name)

    def add(self, name: str, role: Role, password: str) -> Account:
        """Add an account, and return it.

        Args:
            name: the person's name.
            role: the account's role.
            password: the hash of the password.

        Raises:
            ValueError: the name cannot be one.
            AccountsError: there is an account of this name, perhaps in other spelling, there are
                too many, or the file cannot be changed.
        """
        account = Account(checked_name(name), role, password)
        with self._changed() as accounts:
            there = accounts.get(name_key(account.name))
            if there is not None:
                text = f"there is an account {there.name} already; take another name"
                raise AccountsError(f"{self.path}: {account.name}: {text}")
            if len(accounts) >= MOST_ACCOUNTS:
                text = f"holds {MOST_ACCOUNTS} accounts, the most; remove one"
                raise AccountsError(f"{self.path}: {text}")
            accounts[name_key(account.name)] = account
        return account

    def remove(self, name: str) -> Account:
        """Remove an account, and return it.

        Raises:
            AccountsError: there is none of this name, or the file cannot be changed.
        """
        with self._changed() as accounts:
            account = self._there(accounts, name)
            del accounts[name_key(name)]
        return account

    def change(self, name: str, **changed: Any) -> Account:
        """Change `role` or `password`, a hash, of an account, and return it as it is now.

        Raises:
            AccountsError: there is none of this name, or the file cannot be changed.
        """
        with self._changed() as accounts:
            account = replace(self._there(accounts, name), **changed)
            accounts[name_key(name)] = account
        return account

    def _there(self, accounts: Mapping[str, Account], name: str) -> Account:
        account = accounts.get(name_key(name))
        if account is None:
            names = ", ".join(each.name for each in accounts.values()) or "none"
            raise AccountsError(f"{self.path}: {_shown(name)}: is no account; there are {names}")
        return account

    def _content(self) -> bytes:
        # Opening a pipe would otherwise wait until somebody writes to it.
        with os.fdopen(
            os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb"
        ) as file:
            state = os.fstat(file.fileno())
            if not stat.S_ISREG(state.st_mode) or state.st_uid != os.geteuid():
                raise AccountsError(f"{self.path}: is no file of this user; name another --file")
            if state.st_mode & 0o077:
                raise AccountsError(
                    f"{self.path}: may be read or written by others; chmod 600 {self.path}"
                )
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise AccountsError(f"{self.path}: is larger than {LARGEST_FILE} bytes")
        return content

    @contextmanager
    def _changed(self) -> Iterator[dict[str, Account]]:
        """Yield the accounts, to be changed, and write them unless an error is raised meanwhile."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with self._locked():
                accounts: dict[str, Account] = {}
                with suppress(FileNotFoundError):
                    accounts = self.read()
                yield accounts
                self._write(accounts)
        except OSError as error:
            reason = error.strerror or error
            raise AccountsError(f"{self.path}: cannot be changed: {reason}") from None

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Hold the lock beside the file; the file itself is replaced by each change.

        Raises:
            AccountsError: another process holds the lock for longer than `LOCK_S`.
        """
        path = self.path.with_name(f".{self.path.name}.lock")
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            until = time.monotonic() + LOCK_S
            while True:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > until:
                        text = "is being changed by another process; try again"
                        raise AccountsError(f"{self.path}: {text}") from None
                    time.sleep(_AGAIN_S)
            yield
        finally:
            os.close(lock)

    def _write(self, accounts: Mapping[str, Account]) -> None:
        entries = [
            {"name": each.name, "role": str(each.role), "password": each.password}
            for each in accounts.values()
        ]
        text = json.dumps({"version": VERSION, "accounts": entries}, indent=1, ensure_ascii=False)
        # What a killed process has left under this name is overwritten: the lock is held.
        new = self.path.with_name(f".{self.path.name}.new")
        with suppress(FileNotFoundError):
            new.unlink()
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        with os.fdopen(os.open(new, flags, 0o600), "wb") as file:
            file.write(text.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, self.path)
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _shown(name: str) -> str:
    """Return a name that may be any text as a message shows it, which ends no line of a log."""
    text = name[:80].encode(errors="replace").decode()
    return "".join(c if c.isprintable() else "?" for c in text)


def _accounts(content: bytes, path: Path) -> dict[str, Account]:
    """Return the accounts in a file's content.

    Raises:
        AccountsError: lists all that is wrong with it.
    """
    remedy = "take the file away and make the accounts anew by rig accounts add"
    try:
        told = json_of(content)
    except RepeatedLineError as error:
        raise AccountsError(error.at(path)) from None
    except (ValueError, RecursionError):
        raise AccountsError(f"{path}: is no JSON; {remedy}") from None
    if not isinstance(told, dict) or told.keys() != {"version", "accounts"}:
        raise AccountsError(f"{path}: has not the keys version and accounts; {remedy}")
    if told["version"] != VERSION or not isinstance(told["accounts"], list):
        raise AccountsError(f"{path}: is no list of accounts of version {VERSION}; {remedy}")
    if len(told["accounts"]) > MOST_ACCOUNTS:
        raise AccountsError(f"{path}: has more than {MOST_ACCOUNTS} accounts; remove some")
    found: dict[str, Account] = {}
    problems = []
    for number, entry in enumerate(told["accounts"], 1):
        try:
            account = _account(entry)
            if name_key(account.name) in found:
                raise ValueError(f"{account.name}: is there twice; remove one")
            found[name_key(account.name)] = account
        except ValueError as error:
            problems.append(f"{path}: account {number}: {error}")
    if problems:
        raise AccountsError(*problems)
    return found


def _account(entry: Any) -> Account:
    if not isinstance(entry, dict) or entry.keys() != _KEYS:
        raise ValueError(f"has not the keys {', '.join(sorted(_KEYS))}")
    if not all(isinstance(value, str) for value in entry.values()):
        raise ValueError("has a value that is no text")
    roles = {str(role): role for role in Role}
    role = roles.get(entry["role"])
    if role is None:
        raise ValueError(f"role {_shown(entry['role'])!r}: is none of {', '.join(roles)}")
    if not is_hash(entry["password"]):
        raise ValueError("password: is no hash; set it by rig accounts password")
    if checked_name(entry["name"]) != entry["name"]:
        raise ValueError(f"name {_shown(entry['name'])!r}: is not written as a name is kept")
    return Account(entry["name"], role, entry["password"])
