"""Passes requests of other processes to a schedule: to add a run, or to go on after a halt.

They are lines of JSON in a file beside the schedule's journal. Every user who may write to that
file may make requests.
"""

import fcntl
import json
import os
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from rig.recording import read_bounded
from rig.unique_keys import json_of

ADDITIONS: Final = "additions.jsonl"
_LONGEST_LINE: Final = 65_536


def add(folder: Path, **asked: Any) -> str:
    """Write a request for the schedule whose runs are in a folder, and return the request's id.

    Args:
        folder: the schedule's folder; it is made if it is missing.
        asked: the request by its keys: `campaign` with or without `rig` and `name`, or `resume`;
            and `by`, who makes it, for the schedule's journal.

    Raises:
        OSError: the request cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    request = uuid.uuid4().hex
    line = json.dumps({"id": request, **asked}).encode() + b"\n"
    file = os.open(folder / ADDITIONS, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        size = os.fstat(file).st_size
        # A kill may have left half a line.
        if size and os.pread(file, 1, size - 1) != b"\n":
            line = b"\n" + line
        os.write(file, line)
        os.fsync(file)
    finally:
        os.close(file)
    return request


def asked_of(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield all requests ever written for the schedule of a folder, oldest first.

    Requests that the schedule has taken already are among them. Lines that are no request, have no
    id, or are longer than 64 KiB are left out; without a file there are none.
    """
    try:
        lines = read_bounded(folder / ADDITIONS).splitlines()
    except FileNotFoundError:
        return
    for line in lines:
        try:
            request = json_of(line) if len(line) <= _LONGEST_LINE else None
        except (ValueError, RecursionError):
            continue
        if isinstance(request, dict) and isinstance(request.get("id"), str):
            yield request
