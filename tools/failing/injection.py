"""Replaces what this process asks the system by, notes the call sites, and lets one of them fail.

Only the standard library is used, as every process of a run that is tried imports this module
before anything else (`hooks/sitecustomize.py`). The product knows nothing of it.
"""

import builtins
import errno
import io
import json
import mmap
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Final, NamedTuple, Self

VARIABLE: Final = "RIG_FAILING"
"""Name of the environment variable that holds an `Order` as JSON for the processes of a run."""
_ROOT: Final = str(Path(__file__).parents[2]) + os.sep
_PRODUCT: Final = tuple(_ROOT + name + os.sep for name in ("rig", "estimator", "control", "faults"))
_BY_LIBRARY: Final = (f"{os.sep}numba{os.sep}", f"{os.sep}lazy_loader{os.sep}")
"""Libraries whose own call sites are told apart, in place of the product's that led to them: the
cache of compiled code is read wherever a compiled function is called first, and faces of packages
are read wherever a package is imported."""
_HELPERS: Final = tuple(
    _ROOT + name
    for name in ("rig/surviving.py", "rig/recording/targets.py", "rig/recording/bounds.py")
)
"""Modules of the product that open, write or start something for whoever asks them: what counts is
who asked."""
_PROCESSES: Final = "rig.supervisor.processes."

_ERRORS: Final = {
    "open": (errno.EMFILE, errno.EIO),
    "create": (errno.ENOSPC, errno.EMFILE),
    "write": (errno.ENOSPC, errno.EIO),
    "fsync": (errno.EIO, errno.ENOSPC),
    "rename": (errno.ENOSPC, errno.EIO),
    "mkdir": (errno.ENOSPC, errno.EIO),
    "unlink": (errno.EIO, errno.EIO),
    "truncate": (errno.EIO, errno.EIO),
    "mmap": (errno.ENOMEM, errno.EMFILE),
    "socket": (errno.EMFILE, errno.ENOMEM),
    "bind": (errno.ENOMEM, errno.ENOMEM),
    "connect": (errno.ENOMEM, errno.ENOMEM),
    "send": (errno.ENOBUFS, errno.ENOMEM),
    "process": (errno.EAGAIN, errno.ENOMEM),
}
"""Errors of the system with which each kind of call fails: the first time that its place is
reached, and the last time. `thread` fails with a RuntimeError, as in Python itself. Each is one
that the kernel documents for the call."""
KINDS: Final = (*_ERRORS, "thread")


class Site(NamedTuple):
    """A call site: the innermost place in the product's code that led to a call.

    Attributes:
        process: the part of the session: supervisor, loop_process, field, recorder or publisher.
        kind: one of `KINDS`.
        file: path of the file below the checkout, or below the folder of a library.
        line: number of the line.
        function: name of the function.
    """

    process: str
    kind: str
    file: str
    line: int
    function: str

    @property
    def in_product(self) -> bool:
        """Whether the place is in the product's own code, not in a library that is being loaded."""
        return (_ROOT + self.file).startswith(_PRODUCT) and self.function != "<module>"

    def __str__(self) -> str:
        return f"{self.process}: {self.kind} at {self.file}:{self.line} ({self.function})"


class Order(NamedTuple):
    """What the processes of a run shall note and let fail.

    Attributes:
        notes: file to which a line of JSON is appended each time that a site is reached, if there
            is no target, and for the failure of the target, whose line is marked.
        target: the site that fails once; None for none.
        after: how often it is reached before it fails.
        bytes_of_address_space: limit on the address space of each process; 0 for none.
    """

    notes: str
    target: Site | None = None
    after: int = 0
    bytes_of_address_space: int = 0

    def to_json(self) -> str:
        """Return this order as a text for `VARIABLE`."""
        return json.dumps(self)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the order that `to_json` has written."""
        notes, target, after, limit = json.loads(text)
        return cls(notes, None if target is None else Site(*target), after, limit)


class Injection:
    """A context manager in which the sites of this process are noted, and one fails as ordered."""

    def __init__(self, order: Order) -> None:
        self._order = order
        self._reached = 0
        self._replaced: list[tuple[Any, str, Any]] = []
        self._write, self._open, self._close = os.write, os.open, os.close

    def __enter__(self) -> Self:
        for owner, name, kind in _PLAIN:
            self._replace(owner, name, self._refusing(kind, getattr(owner, name)))
        self._replace(os, "open", self._os_open(os.open))
        file_open = self._file_open(io.open)
        self._replace(io, "open", file_open)
        self._replace(builtins, "open", file_open)
        self._replace(mmap, "mmap", self._mapping(mmap.mmap))
        return self

    def __exit__(self, *_: object) -> None:
        for owner, name, before in reversed(self._replaced):
            setattr(owner, name, before)
        self._replaced.clear()

    def _replace(self, owner: Any, name: str, by: Any) -> None:
        self._replaced.append((owner, name, getattr(owner, name)))
        setattr(owner, name, by)

    def meets(self, kind: str, path: object = None) -> None:
        """Note the site from which this is called; raise its error if it is the one to fail."""
        site = _site(kind, sys._getframe(1))
        if site is None:
            return
        if self._order.target is None:
            self._note(site, fails=False)
        elif site == self._order.target:
            self._reached += 1
            if self._reached == self._order.after + 1:
                self._note(site, fails=True)
                raise _error(kind, path, first=self._order.after == 0)

    def _note(self, site: Site, *, fails: bool) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
        file = self._open(self._order.notes, flags, 0o644)
        self._write(file, json.dumps([*site, fails]).encode() + b"\n")
        self._close(file)

    def _refusing(self, kind: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            self.meets(kind, args[0] if args and isinstance(args[0], (str, Path)) else None)
            return original(*args, **options)

        return call

    def _os_open(self, original: Callable[..., int]) -> Callable[..., int]:
        def call(path: Any, flags: int, *args: Any, **options: Any) -> int:
            self.meets("create" if flags & os.O_CREAT else "open", path)
            return original(path, flags, *args, **options)

        return call

    def _mapping(self, original: Any) -> Any:
        injection = self

        class Mapping(original):  # type: ignore[misc]
            def __new__(cls, *args: Any, **options: Any) -> Any:
                injection.meets("mmap")
                return super().__new__(cls, *args, **options)

        return Mapping

    def _file_open(self, original: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that opens as `open` does; what it writes to passes `meets`, too."""
        injection = self

        class File(io.FileIO):
            def write(self, data: Any) -> Any:
                injection.meets("write", self.name)
                return super().write(data)

        def call(
            file: Any,
            mode: str = "r",
            buffering: int = -1,
            encoding: str | None = None,
            errors: str | None = None,
            newline: str | None = None,
            closefd: bool = True,
            opener: Any = None,
        ) -> Any:
            writes = any(letter in mode for letter in "wax+")
            if not isinstance(file, int) and opener is None:
                injection.meets("create" if writes else "open", file)
            if not writes:
                return original(file, mode, buffering, encoding, errors, newline, closefd, opener)
            raw = File(file, mode.replace("b", "").replace("t", ""), closefd, opener)
            if buffering == 0:
                return raw
            size = buffering if buffering > 1 else io.DEFAULT_BUFFER_SIZE
            buffer = io.BufferedRandom(raw, size) if "+" in mode else io.BufferedWriter(raw, size)
            if "b" in mode:
                return buffer
            encoding = io.text_encoding(encoding)
            text = io.TextIOWrapper(buffer, encoding, errors, newline, buffering == 1)
            text.mode = mode  # type: ignore[misc]
            return text

        return call


_PLAIN: Final = (
    (os, "write", "write"),
    (os, "fsync", "fsync"),
    (os, "rename", "rename"),
    (os, "replace", "rename"),
    (os, "mkdir", "mkdir"),
    (os, "unlink", "unlink"),
    (os, "remove", "unlink"),
    (os, "ftruncate", "truncate"),
    (os, "dup", "open"),
    (os, "pipe", "open"),
    (os, "memfd_create", "open"),
    (os, "fork", "process"),
    (subprocess, "_fork_exec", "process"),
    (threading, "_start_new_thread", "thread"),
    (socket.socket, "__init__", "socket"),
    (socket.socket, "bind", "bind"),
    (socket.socket, "connect", "connect"),
    (socket.socket, "send", "send"),
    (socket.socket, "sendall", "send"),
    (socket.socket, "sendto", "send"),
)
"""Functions that are replaced as they are: owner, name, and kind of call."""


def _error(kind: str, path: object, *, first: bool) -> Exception:
    if kind == "thread":
        return RuntimeError("can't start new thread")
    number = _ERRORS[kind][0 if first else 1]
    named = () if path is None or isinstance(path, int) else (os.fspath(path),)  # type: ignore[call-overload]
    return OSError(number, os.strerror(number), *named)


def _site(kind: str, frame: FrameType | None) -> Site | None:
    """Return the site of a call; None if no code of the product led to it."""
    library: FrameType | None = None
    while frame is not None:
        file = frame.f_code.co_filename
        if library is None and any(part in file for part in _BY_LIBRARY):
            library = frame
        if file.startswith(_PRODUCT) and file not in _HELPERS:
            at = library or frame
            return Site(_process(), kind, _shown(at), at.f_lineno, at.f_code.co_name)
        frame = frame.f_back
    return None


def _shown(frame: FrameType) -> str:
    file = frame.f_code.co_filename
    if file.startswith(_PRODUCT):
        return file.removeprefix(_ROOT)
    return file.rpartition("-packages/")[2]


def _process() -> str:
    """Return the part of the session that this process is, by its command line."""
    for argument in sys.orig_argv:
        if _PROCESSES in argument:
            return argument.partition(_PROCESSES)[2].partition(" ")[0]
    return "supervisor"


def arm_from_environment() -> None:
    """Enter an `Injection` for the rest of this process, if `VARIABLE` asks for one."""
    text = os.environ.get(VARIABLE)
    if not text:
        return
    order = Order.from_json(text)
    if order.bytes_of_address_space:
        import resource

        limit = order.bytes_of_address_space
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        return
    Injection(order).__enter__()
