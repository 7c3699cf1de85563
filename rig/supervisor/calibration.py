"""Calibrating the needle valves of a rig's bypasses by its flow meters.

The meters are zeroed at rest with all balls shut. Then, for each bypass, the needle goes through
its openings up and down with the ball open, and each is measured during a slow stroke in the
direction that puts the greater pressure on the bypass.
"""

import datetime
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from control import RequestProblem
from faults import (
    BypassValve,
    CalibrationError,
    Estimate,
    Measurement,
    NeedleCalibration,
    UnsettledError,
    Verdict,
    calibrated_needle,
    measured_coefficient,
    meter_zero,
)
from rig.configuration import Rig
from rig.io import METERS
from rig.plant import TICK

from .strokes import Samples

Array = NDArray[np.float64]

BATCH_TICKS: Final = round(0.5 / TICK)
"""Five times the lag of a flow meter: successive means hardly know of each other."""
ZERO_S: Final = 40.0
"""Long beside a stroke: what the zero is off by is in every measurement."""
TRIES: Final = 3
"""Strokes in which a measurement must settle."""


_UNMETERED: Final = "rely on its data sheet: `needle: {maximum: ..., rangeability: ...}`"

OnMeasured = Callable[[str, Measurement], None]


class Way(NamedTuple):
    """How the flow through a bypass is measured."""

    meter: str
    direction: float
    """Direction of the stroke that puts pressure on the bypass: 1 out, -1 in."""


WAYS: Final = {
    str(Verdict.EXTERNAL_LEAKAGE_1): Way("flow_1_m3_per_s", 1.0),
    str(Verdict.EXTERNAL_LEAKAGE_2): Way("flow_2_m3_per_s", -1.0),
    str(Verdict.INTERNAL_LEAKAGE): Way("flow_internal_m3_per_s", 1.0),
}
"""The bypasses with a flow meter, by the fault each makes."""


class Motions(Protocol):
    """What a calibration asks of a rig; see `rig.supervisor.strokes.Strokes`."""

    def shut_bypasses(self) -> None:
        """Shut every ball valve and needle."""

    def open_bypass(self, kind: str, opening: float) -> None:
        """Open the ball valve of a bypass, and its needle as far as given."""

    def feedback(self, kind: str) -> float:
        """Return where the needle of a bypass says it is."""

    def rest(self, duration_s: float) -> Samples:
        """Hold the ram and return what is read."""

    def stroke(self, direction: float) -> Samples:
        """Move the ram and return what is read meanwhile."""


def calibratable(rig: Rig, asked: Sequence[str] = ()) -> dict[str, BypassValve]:
    """Return the bypass valves to calibrate, by the fault each makes.

    These are all that can be calibrated if none is asked for.

    Raises:
        CalibrationError: one that was asked for cannot be calibrated, or none can be.
    """
    if rig.backend != "hardware":
        raise _refusal(rig.name, "backend", rig.backend, "has no valves to measure",
                       "give a rig with `backend: hardware`")  # fmt: skip
    problems = {kind: _obstacle(rig, kind) for kind in asked or WAYS}
    kinds = [kind for kind, problem in problems.items() if problem is None]
    found = [problem for problem in problems.values() if problem is not None]
    if found and (asked or not kinds):
        raise CalibrationError(found)
    return {kind: rig.bypass_valves[kind] for kind in kinds}


def _obstacle(rig: Rig, kind: str) -> RequestProblem | None:
    """Return what keeps a valve from being calibrated."""
    if kind not in WAYS:
        return RequestProblem(rig.name, kind, "its flow", "passes no flow meter", _UNMETERED)
    if kind not in rig.injectable:
        return RequestProblem(rig.name, kind, "its bypass", "is not there, or no driver moves it",
                       "describe it under `bypass_valves`, and its driver")  # fmt: skip
    meter = WAYS[kind].meter
    if not any(meter in spec.inputs for spec in rig.drivers):
        return RequestProblem(rig.name, kind, meter, "is read by no driver", "add the flow meters")
    return None


def calibrate(
    motions: Motions,
    valves: Mapping[str, BypassValve],
    openings: Sequence[float],
    return_pressure_Pa: float,  # noqa: N803
    date: datetime.date,
    on_measured: OnMeasured = lambda kind, measurement: None,
) -> dict[str, NeedleCalibration]:
    """Return the needles of bypass valves as measured, by the fault each makes.

    Args:
        motions: the rig.
        valves: those to calibrate; see `calibratable`.
        openings: to measure at, from 0 to 1, increasing.
        return_pressure_Pa: that external bypasses lead to.
        date: of the calibration.
        on_measured: is called with each measurement as it comes.

    Raises:
        CalibrationError: what was measured is no calibration; says why.
        BypassError: what was measured does not increase with the opening.
        TripError: the rig tripped or was stopped.
    """
    zeros = measure_zeros(motions, valves)
    return {
        kind: calibrated_needle(
            valve,
            measure_needle(
                motions, kind, openings, zeros[kind], return_pressure_Pa,
                partial(on_measured, kind),
            ),
            date,
        )
        for kind, valve in valves.items()
    }  # fmt: skip


def measure_zeros(motions: Motions, kinds: Iterable[str]) -> dict[str, Estimate]:
    """Return what the meter of each bypass reads without flow, m^3/s; every bypass is shut.

    Raises:
        CalibrationError: a meter reads nothing.
        TripError: the rig tripped or was stopped.
    """
    motions.shut_bypasses()
    samples = motions.rest(ZERO_S)
    return {kind: meter_zero(_metered(samples, kind), BATCH_TICKS) for kind in kinds}


def measure_needle(
    motions: Motions,
    kind: str,
    openings: Sequence[float],
    zero: Estimate,
    return_pressure_Pa: float,  # noqa: N803
    on_measured: Callable[[Measurement], None] = lambda measurement: None,
) -> tuple[Measurement, ...]:
    """Return what a bypass passes at each needle opening, up and down; it is shut at the end.

    Args:
        motions: the rig.
        kind: the bypass, one of `WAYS`.
        openings: 0 to 1, increasing.
        zero: of its meter.
        return_pressure_Pa: that external bypasses lead to.
        on_measured: is called with each measurement as it comes.

    Raises:
        CalibrationError: a meter reads nothing, or the flow does not settle.
        TripError: the rig tripped or was stopped.
    """
    measured = []
    for opening, upwards in _up_and_down(openings):
        motions.open_bypass(kind, opening)
        measured.append(_measure(motions, kind, opening, upwards, zero, return_pressure_Pa))
        on_measured(measured[-1])
    motions.shut_bypasses()
    return tuple(measured)


def _up_and_down(openings: Sequence[float]) -> Iterator[tuple[float, bool]]:
    yield from ((opening, True) for opening in openings)
    yield from ((opening, False) for opening in reversed(openings))


def _measure(
    motions: Motions,
    kind: str,
    opening: float,
    upwards: bool,
    zero: Estimate,
    return_pressure_Pa: float,  # noqa: N803
) -> Measurement:
    for _ in range(TRIES):
        samples = motions.stroke(WAYS[kind].direction)
        drop = _drop(samples, kind, return_pressure_Pa)
        try:
            flow, coefficient, drop_Pa = measured_coefficient(  # noqa: N806
                _metered(samples, kind), drop, zero, BATCH_TICKS
            )
        except UnsettledError:
            continue
        return Measurement(opening, upwards, motions.feedback(kind), flow, drop_Pa, coefficient)
    raise _refusal(
        kind, f"opening {opening:g}", "the flow", f"did not settle in {TRIES} strokes",
        "look for air in the lines, a needle that creeps, or an unsteady supply",
    )  # fmt: skip


def _metered(samples: Samples, kind: str) -> Array:
    """Return the flow through a bypass as metered.

    Raises:
        CalibrationError: half of it or more is missing.
    """
    meter = WAYS[kind].meter
    flow = samples.flows[:, METERS.index(meter)]
    if np.isfinite(flow).mean() < 0.5:
        raise _refusal(
            kind, meter, "the meter", "tells nothing", "check the flow meter and its line"
        )
    return flow


def _drop(samples: Samples, kind: str, return_pressure_Pa: float) -> Array:  # noqa: N803
    pressure_1, pressure_2 = samples.pressures.T
    if kind == Verdict.INTERNAL_LEAKAGE:
        return pressure_1 - pressure_2
    return (pressure_1 if kind == Verdict.EXTERNAL_LEAKAGE_1 else pressure_2) - return_pressure_Pa


def _refusal(kind: str, field: str, value: str, limit: str, remedy: str) -> CalibrationError:
    return CalibrationError([RequestProblem(kind, field, value, limit, remedy)])
