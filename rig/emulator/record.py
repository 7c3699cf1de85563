"""The emulator's record of what it received and did, from which a test can prove it afterwards.

Each line is one JSON object with `at_ns` (CLOCK_MONOTONIC), `event`, and details of the event. It
is passed to the kernel at once, so that it outlives a kill of the emulator.
"""

import json
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TextIO

_REMEMBERED: Final = 10_000
"""Number of events that stay in memory for the control port; they last for hours, since exchanges
are only counted."""


class Record:
    """Takes note of events, in memory and in a file if one is given.

    Args:
        path: file to which events are appended; None for no file.
        trace: CSV file, written anew, with one line for every command received; None for no file.
        clock: returns the time in ns.

    Raises:
        OSError: a file cannot be written.
    """

    def __init__(
        self,
        path: Path | None = None,
        trace: Path | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.events: deque[dict[str, Any]] = deque(maxlen=_REMEMBERED)
        self._clock = clock
        self._file: TextIO | None = path.open("a", buffering=1, encoding="utf-8") if path else None
        self._trace: TextIO | None = trace.open("w", encoding="utf-8") if trace else None
        if self._trace is not None:
            self._trace.write("time_ns,command_V,output_V,valve_enabled\n")

    def note(self, event: str, at_ns: int | None = None, **details: Any) -> None:
        """Take note of an event that happened now, or at a moment given in ns."""
        entry = {"at_ns": self._clock() if at_ns is None else at_ns, "event": event, **details}
        self.events.append(entry)
        if self._file is not None:
            self._file.write(json.dumps(entry) + "\n")

    def command(self, at_ns: int, command_V: float, output_V: float, enabled: bool) -> None:  # noqa: N803
        """Write a received command, the valve output after it, and the enable to the trace file.

        Without a trace file, nothing is done.
        """
        if self._trace is not None:
            self._trace.write(f"{at_ns},{command_V:.9g},{output_V:.9g},{enabled:d}\n")

    def flush(self) -> None:
        """Pass the trace to the kernel; events have been passed already."""
        if self._trace is not None:
            self._trace.flush()

    def close(self) -> None:
        """Close the files; repeated calls do no harm."""
        for file in (self._file, self._trace):
            if file is not None:
                file.close()
        self._file = self._trace = None
