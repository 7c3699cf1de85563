"""The columns of a recording are checked here: complete, evenly sampled and plausible."""

import difflib
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .errors import RecordingProblem
from .plausibility import implausible_values
from .recording import FloatArray
from .sampling import GAP, PERIOD_TOLERANCE, SAMPLE_PERIOD_S, SHORTEST_S, period_of
from .table import Table
from .units import CONVERSIONS

LONGEST_GAP_S: Final = 600.0
"""Longest gap, s, within a recording whose rows need not be even; it fills memory with NaN."""
MIN_DURATION_S: Final = 1.0

MISSED: Final = "exchange_status"
"""Channel of a hardware loop: 0 where a fresh sample came, else a number for why none came."""

# The loop itself makes the values of these channels, so they are never missing.
_COMMANDED: Final = ("time_s", "command_V")

# These names, which other programs use, are too unlike the channels' names to be found as similar.
_ALIASES: Final = {
    "t": "time_s",
    "time": "time_s",
    "u": "command_V",
    "cmd": "command_V",
    "x": "position_m",
    "pos": "position_m",
    "p1": "pressure_1_Pa",
    "p2": "pressure_2_Pa",
}


def problems_of(
    table: Table, required: Sequence[str], *, of_rig: bool = True, longest_s: float | None = None
) -> list[RecordingProblem]:
    """Return all problems of a table: those of the whole file first, then line by line.

    With `longest_s` the rows may be of any period from 0.1 ms to that, and need not be even; then
    gaps between rows and missing values are no problems, as long as a channel has any value.

    Args:
        table: the table, with the problems that its reader found.
        required: channels that must be there, with a finite value in every row. A measured value
            may be NaN where `MISSED` says that no sample came.
        of_rig: whether values that no servo-hydraulic rig shows are problems too.
        longest_s: longest period of the rows, s; None if they must be 1 ms apart.
    """
    if not len(table):
        remedy = "record again; a recording is one line a millisecond"
        empty = RecordingProblem(table.path, None, "file", "no samples", "", remedy)
        return [*table.problems, *_missing_columns(table, required), empty]
    problems = list(table.problems)
    problems += _missing_columns(table, required)
    if "time_s" in table.columns:
        problems += (
            _time_problems(table) if longest_s is None else _uneven_problems(table, longest_s)
        )
    if of_rig:
        problems += implausible_values(table)
    for name in required:
        if name in table.columns:
            problems += (
                _missing_values(table, name)
                if longest_s is None or name == "time_s"
                else _unknown_values(table, name)
            )
    return sorted(problems, key=lambda problem: (problem.line is not None, problem.line or 0))


def _missing_columns(table: Table, required: Sequence[str]) -> Iterator[RecordingProblem]:
    present = [name for name in table.columns if name not in required]
    for name in required:
        if name in table.columns:
            continue
        limit = f"columns present: {', '.join(table.columns)}"
        near = _nearest(name, present)
        remedy = f"add the column; needed are {', '.join(required)}"
        if near is not None:
            remedy = f"rename {near!r} to {name}, if it is that{_conversion(near)}"
        yield RecordingProblem(table.path, None, name, "missing column", limit, remedy)


def _nearest(name: str, candidates: Sequence[str]) -> str | None:
    plain = {_plain(candidate): candidate for candidate in candidates}
    for short, candidate in plain.items():
        if _ALIASES.get(short) == name:
            return candidate
    found = difflib.get_close_matches(_plain(name), plain, n=1, cutoff=0.6)
    return plain[found[0]] if found else None


def _plain(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())


def _conversion(name: str) -> str:
    suffix = name.rpartition("_")[2]
    if suffix not in CONVERSIONS:
        return ""
    unit, factor = CONVERSIONS[suffix]
    return f", and multiply by {factor} ({suffix} to {unit})"


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the indices (first, last), both within, of every run of True in a mask, shape (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def _missing_values(table: Table, name: str) -> Iterator[RecordingProblem]:
    values = table.columns[name]
    limit = f"{name} must have a value in every row"
    missing = ~np.isfinite(values) & ~table.unread(name)
    if name not in _COMMANDED and MISSED in table.columns:
        # A sample that the loop recorded as missing is no problem, as its filter did without it.
        missing &= ~(np.isnan(values) & (table.columns[MISSED] != 0.0))
    for first, last in runs(missing):
        if np.isinf(values[first]):
            value, remedy = f"{values[first]:g}", "find out what overflowed, and record again"
        else:
            value, remedy = "empty or NaN", "record again without dropouts, or interpolate it"
        if last > first:
            value += f" in {last - first + 1} rows up to {table.line_of(last)}"
        yield RecordingProblem(table.path, table.line_of(first), name, value, limit, remedy)


def _unknown_values(table: Table, name: str) -> Iterator[RecordingProblem]:
    """Yield the problems of a channel that may lack values: infinite ones, or none at all."""
    values = table.columns[name]
    limit = f"{name} must have a number or nothing in every row"
    for first, last in runs(np.isinf(values)):
        value = f"{values[first]:g}"
        if last > first:
            value += f" in {last - first + 1} rows up to {table.line_of(last)}"
        remedy = "find out what overflowed, and record again"
        yield RecordingProblem(table.path, table.line_of(first), name, value, limit, remedy)
    if not np.isfinite(values).any() and not table.unread(name).any():
        remedy = "record it, or name another column"
        yield RecordingProblem(table.path, None, name, "has no values at all", "", remedy)


def _uneven_problems(table: Table, longest_s: float) -> list[RecordingProblem]:
    """Return the problems of times that need not be even."""
    known = np.flatnonzero(np.isfinite(table.columns["time_s"]))
    if len(known) < 2:
        return [_too_short(table, 0.0)]
    time_s = table.columns["time_s"][known]
    steps = np.diff(time_s)
    if float(np.median(steps)) <= 0.0:
        return [_not_advancing(table, steps, known)]
    back = [_backwards(table, known, k) for k in np.flatnonzero(steps <= 0.0).tolist()]
    if back:
        return back
    period = period_of(time_s)
    slack = 1.0 + PERIOD_TOLERANCE
    if not SHORTEST_S / slack <= period <= longest_s * slack:
        return [_wrong_period(table, period, longest_s)]
    problems = [_long_gap(table, known, k) for k in np.flatnonzero(steps > LONGEST_GAP_S).tolist()]
    duration = float(time_s[-1] - time_s[0]) + period
    if duration < MIN_DURATION_S - 0.5 * period:
        problems.append(_too_short(table, duration))
    return problems


def _wrong_period(table: Table, period: float, longest_s: float) -> RecordingProblem:
    value = f"a row every {period * 1e3:.6g} ms"
    limit = f"must be {SHORTEST_S * 1e3:g} ms to {longest_s * 1e3:g} ms"
    remedy = "average the rows of each ms" if period < SHORTEST_S else "record more often"
    for unit, unit_s in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _is_right(period, unit_s):
            remedy = f"the time looks like {unit}: multiply it by {unit_s:g}"
    return RecordingProblem(table.path, None, "time_s", value, limit, remedy)


def _long_gap(table: Table, known: NDArray[np.intp], k: int) -> RecordingProblem:
    time_s = table.columns["time_s"]
    before, after = float(time_s[known[k]]), float(time_s[known[k + 1]])
    value = f"gap of {after - before:.6g} s, {before:.9g} s to {after:.9g} s"
    limit = f"must be at most {LONGEST_GAP_S:g} s"
    remedy = "split the recording here"
    return RecordingProblem(
        table.path, table.line_of(int(known[k + 1])), "time_s", value, limit, remedy
    )


def _time_problems(table: Table) -> list[RecordingProblem]:
    # Rows without a time are reported elsewhere; steps between the others allow for rows between.
    known = np.flatnonzero(np.isfinite(table.columns["time_s"]))
    if len(known) < 2:
        return [_too_short(table, 0.0)]
    time_s = table.columns["time_s"][known]
    rows_apart = np.diff(known)
    steps = np.diff(time_s) / rows_apart
    mean = float((time_s[-1] - time_s[0]) / (known[-1] - known[0]))
    median = float(np.median(steps))
    if median <= 0.0:
        return [_not_advancing(table, steps, known)]
    # A gap changes the mean, jitter the median, so the rate is only wrong if both are wrong.
    period = mean if _is_right(mean) else median
    if not _is_right(period):
        problems = [_wrong_rate(table, period)]
    else:
        gaps = np.diff(time_s) > (rows_apart + GAP - 1.0) * period
        problems = [_backwards(table, known, k) for k in np.flatnonzero(steps <= 0.0).tolist()]
        problems += [_gap(table, known, k) for k in np.flatnonzero(gaps).tolist()]
        if not problems and not _is_right(mean):
            # Many steps of, say, 1.4 ms are no gaps each and do not change the median.
            problems = [_wrong_rate(table, mean)]
    duration = float(time_s[-1] - time_s[0]) + period
    # Half a period of slack for rounded time stamps.
    if duration < MIN_DURATION_S - 0.5 * period:
        problems.append(_too_short(table, duration))
    return problems


def _not_advancing(table: Table, steps: FloatArray, known: NDArray[np.intp]) -> RecordingProblem:
    row = int(known[1 + int(np.argmax(steps <= 0.0))])
    limit = "must increase in every row"
    remedy = "write time_s with at least 3 decimals, in the order of recording"
    value = "does not increase from most rows to the next"
    return RecordingProblem(table.path, table.line_of(row), "time_s", value, limit, remedy)


def _is_right(period: float, unit_s: float = 1.0) -> bool:
    """Return whether a period, in units of `unit_s` seconds, is 1 ms within the tolerance."""
    return abs(period * unit_s / SAMPLE_PERIOD_S - 1.0) <= PERIOD_TOLERANCE


def _wrong_rate(table: Table, period: float) -> RecordingProblem:
    remedy = (
        "resample to 1 kHz: interpolate the measured columns (numpy.interp), "
        "hold command_V from its own row to the next"
    )
    for unit, unit_s in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _is_right(period, unit_s):
            remedy = f"the time looks like {unit}: multiply it by {unit_s:g}"
    value = f"sampled at {1.0 / period:.6g} Hz (a row every {period * 1e3:.6g} ms)"
    return RecordingProblem(table.path, None, "time_s", value, "must be 1 kHz within 1 %", remedy)


def _backwards(table: Table, known: NDArray[np.intp], k: int) -> RecordingProblem:
    time_s = table.columns["time_s"]
    before, after = float(time_s[known[k]]), float(time_s[known[k + 1]])
    value = f"{after:.9g} s after {before:.9g} s"
    limit = "must increase in every row"
    remedy = "delete the repeated rows or sort by time_s"
    return RecordingProblem(
        table.path, table.line_of(int(known[k + 1])), "time_s", value, limit, remedy
    )


def _gap(table: Table, known: NDArray[np.intp], k: int) -> RecordingProblem:
    time_s = table.columns["time_s"]
    before, after = float(time_s[known[k]]), float(time_s[known[k + 1]])
    value = f"gap of {(after - before) * 1e3:.6g} ms, {before:.9g} s to {after:.9g} s"
    limit = f"expected step {SAMPLE_PERIOD_S * 1e3:g} ms"
    remedy = "split the recording here, or record again without dropped samples"
    return RecordingProblem(
        table.path, table.line_of(int(known[k + 1])), "time_s", value, limit, remedy
    )


def _too_short(table: Table, duration_s: float) -> RecordingProblem:
    value = f"{duration_s:.4g} s ({len(table)} rows)"
    limit = f"must be at least {MIN_DURATION_S:g} s"
    return RecordingProblem(table.path, None, "time_s", value, limit, "record for longer")
