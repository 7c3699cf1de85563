"""How much a reader of recordings takes, so that a small file cannot fill the machine's memory."""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

from .errors import RecordingError

SHARE_OF_MEMORY: Final = 0.25
"""Part of the machine's memory that a recording's values, or its text, may take. While a CSV file
is read, its text, a table and the columns made from that are in memory, which is three times as
much; the fourth quarter is left to all else."""
LARGEST_CHUNK: Final = 1 << 28
"""Most bytes of an MCAP chunk once it is decompressed: 256 MiB. A chunk of a recording with the
most channels, 2047, has 1000 samples of 10 bytes a channel, 20 MB, and its events."""
LARGEST_JSON: Final = 1 << 26
"""Most bytes of a recording's metadata and events as JSON: 64 MiB, which are half a million events
of 120 letters. Objects made of JSON take up to 20 times as much memory."""
LARGEST_RESULTS: Final = 1 << 28
"""Most bytes of a file that a run writes beside its recordings, such as results or journal:
256 MiB, which are a million lines of 250 letters."""
LONGEST_LINE: Final = 1 << 20
"""Most bytes of a line in a CSV file: 1 MiB, which is 2047 cells of 500 letters each."""

_CONTAINER_LIMIT: Final = Path("/sys/fs/cgroup/memory.max")
"""File in which Linux tells how much memory a container may take, in bytes, or `max`."""


def most_bytes() -> int:
    """Return how many bytes the values, or the text, of a recording may take on this machine.

    It is `SHARE_OF_MEMORY` of the memory that the machine has, or of what its container may take if
    that is less.
    """
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    # There may be no such container, or it may have no limit.
    with suppress(OSError, ValueError):
        memory = min(memory, int(_CONTAINER_LIMIT.read_text()))
    return int(memory * SHARE_OF_MEMORY)


def read_bounded(path: Path, most: int = LARGEST_RESULTS) -> bytes:
    """Return the content of a regular file that has at most so many bytes.

    The size is asked for first, as a file may have holes that take nothing on the disk. A device,
    which may have no end, or a pipe, which may never begin, is not read.

    Raises:
        OSError: the file cannot be read, is no regular file or is larger; `strerror` says which.
    """
    # Opening a pipe would otherwise wait until somebody writes to it.
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        state = os.fstat(file.fileno())
        if not stat.S_ISREG(state.st_mode):
            kind = "a pipe" if stat.S_ISFIFO(state.st_mode) else "a device"
            raise OSError(errno.EINVAL, f"it is {kind}", str(path))
        content = file.read(most + 1) if state.st_size <= most else b""
    if max(state.st_size, len(content)) > most:
        raise OSError(errno.EFBIG, f"it is larger than {in_bytes(most)}", str(path))
    return content


def too_large(path: str, what: str, size: int, most: int | None = None) -> RecordingError:
    """Return the error of a recording that is too large to be read.

    Args:
        path: the file.
        what: what is too large, such as "its values".
        size: its size in bytes, or the least that it is known to have.
        most: most bytes that it may have; `most_bytes` if not given.
    """
    limit = f"at most {in_bytes(most or most_bytes())}"
    if most is None:
        limit += f", {SHARE_OF_MEMORY:.0%} of this machine's memory"
    remedy = "is it a recording? Split it, or read it on a machine with more memory"
    if most is not None:
        remedy = "is it a recording? Fetch it again, or export it again from its source"
    return RecordingError.of_file(path, f"too large: {what} take {in_bytes(size)}", remedy, limit)


def in_bytes(size: int) -> str:
    """Return a size in bytes as text with a unit, such as `6.01 GB`."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"
