"""Implausible values are found here; mostly a column is in another unit than its name says."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from .errors import RecordingProblem
from .table import Table


@dataclass(frozen=True, slots=True)
class _Span:
    """The largest plausible magnitude of a channel, its unit, and a remedy for larger values."""

    upper: float
    unit: str
    remedy: str


_SPOOL: Final = _Span(0.01, "m", "looks like mm (divide by 1000) or um (divide by 1e6)")
_STROKE: Final = _Span(10.0, "m", "looks like mm: divide by 1000")
_COMMAND: Final = _Span(50.0, "V", "looks like mV (divide by 1000) or a percentage")
_PRESSURE: Final = _Span(1e8, "Pa", "find out the sensor's scale")
_SPANS: Final = {
    "position_m": _STROKE,
    "setpoint_m": _STROKE,
    "spool_m": _SPOOL,
    "command_V": _COMMAND,
    "pressure_1_Pa": _PRESSURE,
    "pressure_2_Pa": _PRESSURE,
    "supply_pressure_Pa": _PRESSURE,
}
# A rig under pressure exceeds this in some chamber at some time, also if sensor noise is 30 kPa.
_PRESSURE_FLOOR_PA: Final = 5e4
# Up to this largest chamber pressure, the number is likely to be in this unit, for 5 to 35 MPa.
_PRESSURE_UNITS: Final = (
    (40.0, "MPa (multiply by 1e6) or bar (by 1e5)"),
    (700.0, "bar: multiply by 1e5"),
    (5000.0, "psi (multiply by 6894.757) or kPa (by 1e3)"),
    (_PRESSURE_FLOOR_PA, "kPa: multiply by 1e3"),
)


def implausible_values(table: Table) -> Iterator[RecordingProblem]:
    """Yield a problem, with the likely unit, for each channel whose values are implausible.

    Position, setpoint, spool, command and pressures are checked for too large magnitudes. Chamber
    pressures (both together) and supply pressure are also checked for a maximum below 0.05 MPa.
    """
    for name, span in _SPANS.items():
        if name in table.columns:
            yield from _beyond(table, name, span)
    yield from _too_low(table, ["pressure_1_Pa", "pressure_2_Pa"])
    yield from _too_low(table, ["supply_pressure_Pa"])


def _beyond(table: Table, name: str, span: _Span) -> Iterator[RecordingProblem]:
    magnitude = np.abs(table.columns[name])
    # Infinity is left out here; it is reported by the check of required channels.
    beyond = (magnitude > span.upper) & np.isfinite(magnitude)
    count = int(np.count_nonzero(beyond))
    if not count:
        return
    first = int(np.argmax(beyond))
    largest = float(magnitude[beyond].max())
    value = f"magnitudes up to {largest:.6g} in {count} rows"
    limit = f"implausible above {span.upper:g} {span.unit}"
    # A wrong unit makes the whole column implausible, a bad sensor or a spike only some rows.
    everywhere = count > 0.1 * len(magnitude)
    remedy = span.remedy if everywhere else "check the sensor; cut these rows off or record again"
    yield RecordingProblem(table.path, table.line_of(first), name, value, limit, remedy)


def _too_low(table: Table, names: Sequence[str]) -> Iterator[RecordingProblem]:
    present = [table.columns[name] for name in names if name in table.columns]
    finite = [np.abs(values[np.isfinite(values)]) for values in present]
    largest = max((float(values.max()) for values in finite if values.size), default=0.0)
    if not 0.0 < largest < _PRESSURE_FLOOR_PA:
        return
    unit = next(text for limit, text in _PRESSURE_UNITS if largest <= limit)
    limit = f"a rig under pressure reaches more than {_PRESSURE_FLOOR_PA:g} Pa"
    value = f"at most {largest:.6g} in the whole recording"
    for name in names:
        if name in table.columns:
            yield RecordingProblem(table.path, None, name, value, limit, f"looks like {unit}")
