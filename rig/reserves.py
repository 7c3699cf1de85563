"""Keeps file descriptors back for the way out of a session, and refuses to begin with too few.

A process that may open no more files can neither write a trip report nor connect to a device anew
to make it safe. So some descriptors are taken at the beginning and given back on the way out.
"""

import errno
import os
import resource
from typing import Final

KEPT: Final = 12
"""Descriptors that are kept: two for each of up to three connections to devices that are made safe
side by side, three for the files of a trip report, three for results, journal and log."""
NEEDED: Final = 48
"""Descriptors that must be free as a session on hardware begins. Measured with the shipped rig
`emulated`, the supervisor has at most 32 open in a whole run, 6 of them before it begins. With
`KEPT` that is 38, and the rest is for a rig with more drivers."""
ADDRESS_SPACE_BYTES: Final = 2 << 30
"""Least limit of the address space, in bytes, with which a session on hardware begins. Measured
with the same rig, the supervisor has up to 1.42 GiB, most of it reserved by libraries and never
used; a run under a limit of 2.4 GiB goes as one without."""
_FULL: Final = (errno.EMFILE, errno.ENFILE)
SHORT: Final = (*_FULL, errno.ENOMEM, errno.EAGAIN, errno.EIO)
"""Errors that say nothing of the path given, but of what the system has left, or of its disk."""


class ShortageError(Exception):
    """Raised if the system grants a process too little to begin with.

    Attributes:
        state: what is short, with value and limit.
        action: the remedy.
    """

    def __init__(self, state: str, action: str) -> None:
        self.state, self.action = state, action
        super().__init__(f"{state}; {action}")


class Reserve:
    """Descriptors that are kept for the way out, from `take` to `release`."""

    def __init__(self) -> None:
        self._kept: list[int] = []

    def take(self) -> None:
        """Take the descriptors; first raise this process's limit if it is low and may be raised.

        Raises:
            ShortageError: too few descriptors are free, or the address space is too small.
        """
        _require_address_space()
        _require_descriptors()
        first = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
        self._kept = [first, *(os.dup(first) for _ in range(KEPT - 1))]

    def release(self) -> None:
        """Give the descriptors back, at the beginning of the way out; later calls do nothing."""
        kept, self._kept = self._kept, []
        for fd in kept:
            os.close(fd)


def _require_descriptors() -> None:
    used = len(os.listdir("/proc/self/fd"))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = used + NEEDED
    if soft < wanted and soft != resource.RLIM_INFINITY:
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, most), hard))
        soft = max(soft, most)
    if soft < wanted:
        state = f"this process may open {soft} files, of which {soft - used} are left"
        action = f"a session on hardware needs {NEEDED}; allow more, as by `ulimit -n {4 * wanted}`"
        raise ShortageError(state, action)


def _require_address_space() -> None:
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft != resource.RLIM_INFINITY and soft < ADDRESS_SPACE_BYTES:
        state = f"this process may have {soft / 2**30:.2f} GiB of address space"
        least = f"{ADDRESS_SPACE_BYTES / 2**30:g} GiB"
        action = f"a session on hardware needs {least}; allow more, as by `ulimit -v unlimited`"
        raise ShortageError(state, action)


def limits_address_space() -> bool:
    """Return whether this process may only have a limited address space."""
    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def refusal(error: OSError, option: str = "--out") -> str:
    """Return what the system refused, on which file, and the remedy, in one line.

    `option` is the command's option that tells where files are written.
    """
    what = f"{error.filename}: " if error.filename else ""
    return f"{what}{(error.strerror or str(error)).lower()}; {remedy_for(error, option)}"


def remedy_for(error: OSError, option: str = "--out") -> str:
    """Return the remedy for a file, thread or process that the system could not give or write.

    `option` is the command's option that tells where files are written.
    """
    if error.errno in _FULL:
        return "allow this program to open more files (`ulimit -n 1024`)"
    if error.errno == errno.ENOMEM:
        return "end other programs, or allow this one more memory (`ulimit -v unlimited`)"
    if error.errno == errno.EAGAIN:
        return "end other programs, or allow this user more processes (`ulimit -u unlimited`)"
    if error.errno == errno.EIO:
        return "look whether the disk is damaged (`dmesg`)"
    return f"free space, or give another {option}"
