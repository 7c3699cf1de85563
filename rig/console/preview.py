"""Shows what a start of an offered campaign would do, by `rig check`, before anything moves."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

CHECK_S: Final = 120.0
"""Longest time in s that a check may take. One with compiling, as of a campaign in open loop, whose
motion is simulated, takes some twenty on a machine that does nothing else."""
WAIT_S: Final = 3.0
"""Longest time in s for which a request waits for the check's end, before it is told to ask again:
much less than a connection has (`REQUEST_S` of running.py)."""
FRESH_S: Final = 10.0
"""Time in s for which a result is told again: whoever asks again gets it, and a file that was
changed is checked anew soon."""
NICENESS: Final = 10
"""Lowered priority of the check, so that neither the console nor a rig beside it waits for it."""
MOST_LINES: Final = 200
"""Most lines of problems that are shown."""
PENDING: Final[Mapping[str, Any]] = {"pending": True}


class _Check:
    """A check under way, or ended."""

    def __init__(self, words: Sequence[str]) -> None:
        self.words = list(words)
        self.ended = threading.Event()
        self.ended_at = 0.0
        self.found: Mapping[str, Any] = {}
        threading.Thread(target=self._run, name="check", daemon=True).start()

    def _run(self) -> None:
        self.found = {"problems": ["the check has failed; see the console's log"]}
        try:
            self.found = checked(self.words)
        finally:
            self.ended_at = time.monotonic()
            self.ended.set()


class Preview:
    """Checks offered campaigns, one at a time, each in a process of its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: _Check | None = None

    def of(self, words: Sequence[str]) -> Mapping[str, Any]:
        """Return what a start would do; it may be called from any thread.

        Args:
            words: the campaign and its options, as `rig check` takes them.

        Returns:
            Either `plan`, the object that `rig check --json` prints, or `problems`, its lines on
            what is wrong, or `pending`: this check, or another one, is under way; ask again. All
            are JSON values.
        """
        with self._lock:
            last = self._last
            if last is not None and not last.ended.is_set() and last.words != list(words):
                return PENDING
            is_over = last is not None and last.ended.is_set()
            if last is None or (
                is_over
                and (last.words != list(words) or time.monotonic() > last.ended_at + FRESH_S)
            ):
                last = self._last = _Check(words)
        return last.found if last.ended.wait(WAIT_S) else PENDING


def checked(words: Sequence[str]) -> Mapping[str, Any]:
    """Return `plan` or `problems` of a campaign, by a `rig check` that is waited for."""
    command = [sys.executable, "-m", "rig.cli", "check", "--json", *words]
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
    except OSError as error:
        return {"problems": [f"it cannot be checked: {error.strerror or error}"]}
    with process:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        try:
            out, told = process.communicate(timeout=CHECK_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return {"problems": [f"the check took more than {CHECK_S:g} s"]}
    if process.returncode == 0:
        with suppress(ValueError, IndexError):
            return {"plan": json.loads(out)[0]}
    lines = told.decode(errors="replace").splitlines()[:MOST_LINES]
    return {"problems": lines or ["the check gives no reason"]}
