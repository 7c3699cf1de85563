"""The columns of a recording are checked here: complete, evenly sampled and plausible."""

import difflib
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .errors import RecordingProblem
from .recording import FloatArray, Table
from .sampling import GAP, PERIOD_TOLERANCE, SAMPLE_PERIOD_S, SHORTEST_S, period_of
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

_PRESSURES: Final = ("pressure_1_Pa", "pressure_2_Pa", "supply_pressure_Pa")
_SPANS: Final = {
    **dict.fromkeys(("position_m", "setpoint_m"), (10.0, "m", "looks like mm: divide by 1000")),
    "spool_m": (0.01, "m", "looks like mm (divide by 1000) or um (divide by 1e6)"),
    "command_V": (50.0, "V", "looks like mV (divide by 1000) or a percentage"),
    **dict.fromkeys(_PRESSURES, (1e8, "Pa", "find out the sensor's scale")),
}
"""Channel -> its largest plausible magnitude, the unit of that, and a remedy for larger values."""
# A rig under pressure exceeds this in some chamber at some time, also if sensor noise is 30 kPa.
_PRESSURE_FLOOR_PA: Final = 5e4
# Up to this largest chamber pressure, the number is likely to be in this unit, for 5 to 35 MPa.
_PRESSURE_UNITS: Final = (
    (40.0, "MPa (multiply by 1e6) or bar (by 1e5)"),
    (700.0, "bar: multiply by 1e5"),
    (5000.0, "psi (multiply by 6894.757) or kPa (by 1e3)"),
    (_PRESSURE_FLOOR_PA, "kPa: multiply by 1e3"),
)


def problems_of(
    table: Table, required: Sequence[str], *, of_rig: bool, longest_s: float | None
) -> list[RecordingProblem]:
    """Return all problems of a table: those of the whole file first, then line by line.

    With `longest_s` the rows may be of any period from 0.1 ms to that, and need not be even. Gaps
    between rows are then no problems up to 10 minutes, nor are missing values (NaN) in a channel
    other than `time_s` that has any value.

    Args:
        table: the table, with the problems that its reader found; what else is found is added.
        required: channels that must be there, with a finite value in every row. A measured value
            may be NaN where `MISSED` says that no sample came.
        of_rig: whether values that no servo-hydraulic rig shows are problems too.
        longest_s: longest period of the rows, s; None if they must be 1 ms apart.
    """
    _check_columns(table, required)
    if not len(table):
        table.report("file", "no samples", "record again; a recording is one line a millisecond")
        return table.problems
    if "time_s" in table.columns:
        _check_times(table, longest_s)
    if of_rig:
        for name in _SPANS:
            if name in table.columns:
                _check_magnitude(table, name)
        _check_pressures(table, _PRESSURES[:2])
        _check_pressures(table, _PRESSURES[2:])
    for name in required:
        if name in table.columns:
            _check_values(table, name, longest_s is not None and name != "time_s")
    return sorted(table.problems, key=lambda found: (found.line is not None, found.line or 0))


def _check_columns(table: Table, required: Sequence[str]) -> None:
    present = [name for name in table.columns if name not in required]
    for name in required:
        if name not in table.columns:
            near = _nearest(name, present)
            remedy = f"add the column; needed are {', '.join(required)}"
            if near is not None:
                remedy = f"rename {near!r} to {name}, if it is that{_conversion(near)}"
            limit = f"columns present: {', '.join(table.columns)}"
            table.report(name, "missing column", remedy, limit)


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


def _check_magnitude(table: Table, name: str) -> None:
    """Report values of a channel of `_SPANS` that are implausibly large, with their likely unit.

    If no more than a tenth of the rows have such values, the remedy blames the sensor instead.
    """
    upper, unit, remedy = _SPANS[name]
    magnitude = np.abs(table.columns[name])
    # Infinity is left out here; it is reported by the check of required channels.
    beyond = (magnitude > upper) & np.isfinite(magnitude)
    count = int(np.count_nonzero(beyond))
    if not count:
        return
    # A wrong unit makes the whole column implausible, a bad sensor or a spike only some rows.
    if count <= 0.1 * len(magnitude):
        remedy = "check the sensor; cut these rows off or record again"
    value = f"magnitudes up to {float(magnitude[beyond].max()):.6g} in {count} rows"
    limit = f"implausible above {upper:g} {unit}"
    table.report(name, value, remedy, limit, int(np.argmax(beyond)))


def _check_pressures(table: Table, names: Sequence[str]) -> None:
    """Report pressures, together, that stay below 0.05 MPa all the time, with their likely unit."""
    names = [name for name in names if name in table.columns]
    finite = [np.abs(table.columns[name][np.isfinite(table.columns[name])]) for name in names]
    largest = max((float(values.max()) for values in finite if values.size), default=0.0)
    if 0.0 < largest < _PRESSURE_FLOOR_PA:
        unit = next(text for limit, text in _PRESSURE_UNITS if largest <= limit)
        value = f"at most {largest:.6g} in the whole recording"
        limit = f"a rig under pressure reaches more than {_PRESSURE_FLOOR_PA:g} Pa"
        for name in names:
            table.report(name, value, f"looks like {unit}", limit)


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the indices (first, last), both within, of every run of True in a mask, shape (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def _check_values(table: Table, name: str, may_lack: bool) -> None:
    """Report the rows of a channel without a finite value.

    A channel that may lack values is reported only where it is infinite, or if it has none at all.
    """
    values, unread = table.columns[name], table.unread(name)
    if may_lack:
        limit, missing = f"{name} must have a number or nothing in every row", np.isinf(values)
    else:
        limit, missing = f"{name} must have a value in every row", ~np.isfinite(values) & ~unread
        if name not in _COMMANDED and MISSED in table.columns:
            # A sample that the loop recorded as missing is no problem: its filter did without it.
            missing &= ~(np.isnan(values) & (table.columns[MISSED] != 0.0))
    for first, last in runs(missing):
        value, remedy = "empty or NaN", "record again without dropouts, or interpolate it"
        if np.isinf(values[first]):
            value, remedy = f"{values[first]:g}", "find out what overflowed, and record again"
        if last > first:
            value += f" in {last - first + 1} rows up to {table.line_of(last)}"
        table.report(name, value, remedy, limit, first)
    if may_lack and not np.isfinite(values).any() and not unread.any():
        table.report(name, "has no values at all", "record it, or name another column")


def _check_times(table: Table, longest_s: float | None) -> None:
    # Rows without a time are reported elsewhere; steps between the others allow for rows between.
    known = np.flatnonzero(np.isfinite(table.columns["time_s"]))
    steps = np.diff(table.columns["time_s"][known])
    if longest_s is None:
        steps = steps / np.diff(known)
    if not len(steps):
        _check_duration(table, 0.0, 0.0)
    elif float(np.median(steps)) <= 0.0:
        remedy = "write time_s with at least 3 decimals, in the order of recording"
        value, limit = "does not increase from most rows to the next", "must increase in every row"
        table.report("time_s", value, remedy, limit, int(known[1 + int(np.argmax(steps <= 0.0))]))
    elif longest_s is None:
        _check_even(table, known, steps)
    else:
        _check_uneven(table, known, steps, longest_s)


def _check_even(table: Table, known: NDArray[np.intp], steps: FloatArray) -> None:
    """Report what is wrong with times that must be 1 ms apart and last for 1 s at least.

    `known` are the rows that have a time, (n,), and `steps` the differences of their times in s,
    (n - 1,), each divided by the number of rows from one to the next.
    """
    time_s = table.columns["time_s"][known]
    mean = float((time_s[-1] - time_s[0]) / (known[-1] - known[0]))
    # A gap changes the mean, jitter the median, so the rate is only wrong if both are wrong.
    period = mean if _is_right(mean) else float(np.median(steps))
    back = steps <= 0.0
    gaps = np.diff(time_s) > (np.diff(known) + GAP - 1.0) * period
    if not _is_right(period):
        _report_rate(table, period)
    elif back.any() or gaps.any():
        _report_backwards(table, known, back)
        value = "gap of {ms:.6g} ms, {before:.9g} s to {after:.9g} s"
        remedy = "split the recording here, or record again without dropped samples"
        limit = f"expected step {SAMPLE_PERIOD_S * 1e3:g} ms"
        _report_steps(table, known, gaps, value, remedy, limit)
    elif not _is_right(mean):
        # Many steps of, say, 1.4 ms are no gaps each and do not change the median.
        _report_rate(table, mean)
    _check_duration(table, float(time_s[-1] - time_s[0]) + period, period)


def _check_uneven(
    table: Table, known: NDArray[np.intp], steps: FloatArray, longest_s: float
) -> None:
    """Report what is wrong with times that may be uneven, but must increase, for 1 s at least.

    `known` are the rows that have a time, (n,), and `steps` the differences of their times in s,
    (n - 1,).
    """
    back = steps <= 0.0
    if back.any():
        _report_backwards(table, known, back)
        return
    time_s = table.columns["time_s"][known]
    period = period_of(time_s)
    slack = 1.0 + PERIOD_TOLERANCE
    if not SHORTEST_S / slack <= period <= longest_s * slack:
        remedy = "average the rows of each ms" if period < SHORTEST_S else "record more often"
        value = f"a row every {period * 1e3:.6g} ms"
        limit = f"must be {SHORTEST_S * 1e3:g} ms to {longest_s * 1e3:g} ms"
        table.report("time_s", value, _remedy_of_unit(period, remedy), limit)
        return
    value = "gap of {step:.6g} s, {before:.9g} s to {after:.9g} s"
    limit = f"must be at most {LONGEST_GAP_S:g} s"
    _report_steps(table, known, steps > LONGEST_GAP_S, value, "split the recording here", limit)
    _check_duration(table, float(time_s[-1] - time_s[0]) + period, period)


def _is_right(period: float, unit_s: float = 1.0) -> bool:
    """Return whether a period, a number of units of `unit_s` seconds, is 1 ms within 1 %."""
    return abs(period * unit_s / SAMPLE_PERIOD_S - 1.0) <= PERIOD_TOLERANCE


def _remedy_of_unit(period: float, otherwise: str) -> str:
    """Return the remedy for a wrong period, a number that was taken for s.

    If the number would be right (1 ms) in ms, us or ns, it is to convert the times; else it is
    `otherwise`.
    """
    for unit, unit_s in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _is_right(period, unit_s):
            return f"the time looks like {unit}: multiply it by {unit_s:g}"
    return otherwise


def _report_rate(table: Table, period: float) -> None:
    remedy = (
        "resample to 1 kHz: interpolate the measured columns (numpy.interp), "
        "hold command_V from its own row to the next"
    )
    value = f"sampled at {1.0 / period:.6g} Hz (a row every {period * 1e3:.6g} ms)"
    table.report("time_s", value, _remedy_of_unit(period, remedy), "must be 1 kHz within 1 %")


def _report_backwards(table: Table, known: NDArray[np.intp], back: NDArray[np.bool_]) -> None:
    value, remedy = (
        "{after:.9g} s after {before:.9g} s",
        "delete the repeated rows or sort by time_s",
    )
    _report_steps(table, known, back, value, remedy, "must increase in every row")


def _report_steps(
    table: Table,
    known: NDArray[np.intp],
    wrong: NDArray[np.bool_],
    value: str,
    remedy: str,
    limit: str,
) -> None:
    """Report each wrong step from one of the `known` rows (n,) to the next; `wrong` is (n - 1,).

    In the text `value`, `before`, `after` and `step` stand for times in s, and `ms` for the step.
    """
    for k in np.flatnonzero(wrong).tolist():
        before, after = table.columns["time_s"][known[k : k + 2]].tolist()
        step = after - before
        found = value.format(before=before, after=after, step=step, ms=step * 1e3)
        table.report("time_s", found, remedy, limit, int(known[k + 1]))


def _check_duration(table: Table, duration_s: float, period: float) -> None:
    # Half a period of slack for rounded time stamps.
    if duration_s < MIN_DURATION_S - 0.5 * period:
        value = f"{duration_s:.4g} s ({len(table)} rows)"
        limit = f"must be at least {MIN_DURATION_S:g} s"
        table.report("time_s", value, "record for longer", limit)
