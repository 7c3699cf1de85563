"""The health of the loop and of the session's parts is read from the board for the live stream."""

import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.loop import Action, Board, Cause, Word, channel_name, explain

from .safety_thread import trips_of

Array = NDArray[np.float64]

TIMED: Final = ("wakeup_s", "sent_s", "exchange_s", "compute_s", "age_s")
"""Columns of a row that hold a tick's timings; the rows of a simulated rig have none."""
BEATS: Final = {
    "loop": Word.LOOP_BEAT,
    "field": Word.FIELD_BEAT,
    "supervisor": Word.SUPERVISOR_BEAT,
    "recorder": Word.RECORDER_BEAT,
}
STEPS: Final = {
    "valve null": Word.VALVE_NULL_AT,
    "bypass shut": Word.BYPASS_SHUT_AT,
    "pump unloaded": Word.PUMP_UNLOADED_AT,
}


class Health:
    """A collector of the rows between two messages `health`, whose content it makes.

    docs/stream.md describes that content.
    """

    def __init__(self, board: Board) -> None:
        self._board, self._words = board, board.words
        self._rows: list[Array] = []
        self._timed: dict[str, int] = {}
        self._since = time.monotonic()

    def take(self, rows: Array, channels: Sequence[str]) -> None:
        """Add the next rows, float64 (n, channels), SI; the first `channels` hold for all calls."""
        if not self._timed:
            self._timed = {name: channels.index(name) for name in TIMED if name in channels}
        self._rows.append(rows)

    def content(self) -> dict[str, Any]:
        """Return a message's content: the present state, and the timings since the last call."""
        words, now = self._words, time.monotonic()
        rows = np.concatenate(self._rows) if self._rows else None
        self._rows, since, self._since = [], self._since, now
        cause = Cause(int(words[Word.ACTION_CAUSE]))
        return {
            "rate_hz": 0.0 if rows is None else len(rows) / max(now - since, 1e-3),
            "rows": int(words[Word.ROWS]),
            "recorded": int(words[Word.RECORDED]),
            "missed": int(words[Word.MISSED]),
            "exchange_errors": int(words[Word.EXCHANGE_ERRORS]),
            "homed": bool(words[Word.HOMED]),
            "timing": {} if rows is None else self._timing(rows),
            "silent_s": {
                name: 1e-9 * (time.monotonic_ns() - int(words[word]))
                for name, word in BEATS.items()
                if words[word]
            },
            "action": Action(int(words[Word.ACTION])).name.lower(),
            "cause": cause.name,
            "sentence": explain(cause, self._channel).sentence if cause else "",
            "trips": self._trips(),
        }

    def _timing(self, rows: Array) -> dict[str, dict[str, float]]:
        found = {}
        for name, column in self._timed.items():
            times = rows[:, column]
            times = times[np.isfinite(times)]
            if times.size:
                p50, p99, most = np.percentile(times, (50.0, 99.0, 100.0))
                found[name.removesuffix("_s")] = {"p50_s": p50, "p99_s": p99, "max_s": most}
        return found

    @property
    def _channel(self) -> str:
        return channel_name(int(self._words[Word.ACTION_CHANNEL]))

    def _trips(self) -> dict[str, Any]:
        """Return who tripped and why, in order of time, and which steps of the trip were confirmed.

        Times are in s after the first trip; the time of an unconfirmed step is None. {} if nobody
        tripped.
        """
        found = [
            (at_ns, who, cause) for who, (cause, at_ns) in trips_of(self._board).items()
        ]  # fmt: skip
        if not found:
            return {}
        found.sort()
        first_ns = found[0][0]
        return {
            "first_out": [
                {
                    "by": who,
                    "cause": cause.name,
                    "sentence": explain(cause, self._channel).sentence,
                    "remedy": explain(cause, self._channel).remedy,
                    "after_s": 1e-9 * (at_ns - first_ns),
                }
                for at_ns, who, cause in found
            ],
            "confirmed": {
                what: 1e-9 * (int(self._words[word]) - first_ns) if self._words[word] else None
                for what, word in STEPS.items()
            },
        }
