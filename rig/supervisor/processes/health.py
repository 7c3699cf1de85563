"""The health of the loop and of the session's parts, with their trips, as the board has it."""

import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.loop import Action, Board, Cause, Word, channel_name, explain

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
"""The steps of a trip, with the word of the time at which the device confirmed it."""
TRIPS: Final = {
    "loop": (Word.LOOP_TRIP, Word.LOOP_TRIP_AT),
    "field": (Word.FIELD_TRIP, Word.FIELD_TRIP_AT),
    "supervisor": (Word.SUPERVISOR_TRIP, Word.SUPERVISOR_TRIP_AT),
}
"""The parts that may trip, with the words of the cause and the time of their trip."""


def trip(words: NDArray[np.int64], who: str, cause: Cause) -> None:
    """Write on the board's words that a part trips now, and why, unless it has tripped already.

    Args:
        words: the board's words.
        who: the part, one of `TRIPS`.
        cause: the cause.
    """
    word, at = TRIPS[who]
    if not words[word]:
        words[at] = time.monotonic_ns()
        words[word] = cause


def trips_of(board: Board) -> Mapping[str, tuple[Cause, int]]:
    """Return part -> (cause, time) for each part that has tripped, the first one first.

    Times are CLOCK_MONOTONIC in ns.
    """
    found = {
        who: (Cause(int(board.words[word])), int(board.words[at]))
        for who, (word, at) in TRIPS.items()
        if board.words[word]
    }
    return dict(sorted(found.items(), key=lambda trip: trip[1][1]))


def trips_told(board: Board) -> dict[str, Any]:
    """Return who tripped and why, in order of time, and which steps of the trip were confirmed.

    Times are in s after the first trip; the time of an unconfirmed step is None. {} if nobody
    tripped. A session that has read no row yet cannot trip: where it ends as it connects, its
    processes note that they are alone.
    """
    found = trips_of(board)
    if not found or not board.words[Word.ROWS]:
        return {}
    channel = loop_channel(board)
    first_ns = next(iter(found.values()))[1]
    return {
        "first_out": [
            {
                "by": who,
                "cause": cause.name,
                "sentence": explain(cause, channel).sentence,
                "remedy": explain(cause, channel).remedy,
                "after_s": 1e-9 * (at_ns - first_ns),
            }
            for who, (cause, at_ns) in found.items()
        ],
        "confirmed": {
            what: 1e-9 * (int(board.words[word]) - first_ns) if board.words[word] else None
            for what, word in STEPS.items()
        },
    }


def loop_channel(board: Board) -> str:
    """Return the name of the channel that the loop's action concerns; empty if it concerns none."""
    return channel_name(int(board.words[Word.ACTION_CHANNEL]))


def stage_times(rows: Array, channels: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return statistics in s of each column in `TIMED`: name -> {"p50": median, "p99", "max"}.

    "p99" is the 99th percentile. Columns that the rows do not have, or that are NaN throughout, are
    left out.

    Args:
        rows: float64 (n, channels).
        channels: names of the rows' columns.
    """
    found: dict[str, dict[str, float]] = {}
    for name in (name for name in TIMED if name in channels):
        times = rows[:, channels.index(name)]
        times = times[np.isfinite(times)]
        if times.size:
            figures = np.percentile(times, (50.0, 99.0, 100.0)).tolist()
            found[name] = dict(zip(("p50", "p99", "max"), figures, strict=True))
    return found


class Health:
    """Makes the content of the live stream's messages `health`, which docs/stream.md describes.

    It collects rows between two messages for the statistics of their timings; all else is read from
    the board.

    Args:
        board: the board.
        channels: names of the rows' columns.
    """

    def __init__(self, board: Board, channels: Sequence[str]) -> None:
        self._board, self._words = board, board.words
        self._channels = channels
        self._rows: list[Array] = []
        self._since = time.monotonic()

    def take(self, rows: Array) -> None:
        """Add the next rows, float64 (n, channels), SI."""
        self._rows.append(rows)

    def content(self) -> dict[str, Any]:
        """Return the content of a message: the present state, and timings of the rows taken so far.

        These rows are forgotten then, so that the next content has the timings of later rows only.
        """
        words, now = self._words, time.monotonic()
        rows = np.concatenate([np.empty((0, len(self._channels))), *self._rows])
        self._rows, since, self._since = [], self._since, now
        cause = Cause(int(words[Word.ACTION_CAUSE]))
        return {
            "rate_hz": len(rows) / max(now - since, 1e-3),
            "rows": int(words[Word.ROWS]),
            "recorded": int(words[Word.RECORDED]),
            "missed": int(words[Word.MISSED]),
            "exchange_errors": int(words[Word.EXCHANGE_ERRORS]),
            "homed": bool(words[Word.HOMED]),
            "timing": {
                name.removesuffix("_s"): {f"{figure}_s": value for figure, value in stage.items()}
                for name, stage in stage_times(rows, self._channels).items()
            },
            "silent_s": {
                name: 1e-9 * (time.monotonic_ns() - int(words[word]))
                for name, word in BEATS.items()
                if words[word]
            },
            "action": Action(int(words[Word.ACTION])).name.lower(),
            "cause": cause.name,
            "sentence": explain(cause, loop_channel(self._board)).sentence if cause else "",
            "trips": trips_told(self._board),
        }
