"""The needle valves of a rig's bypasses are calibrated here by the rig's flow meters.

The zero of each meter is measured at rest with all balls shut. Then, for each bypass, the needle
goes through its openings up and down with the ball open. Each opening is measured during a slow
stroke in the direction that puts the greater pressure on the bypass. At rest the pressure across an
open bypass falls away, and little flows. The friction of a moving ram keeps up a pressure
difference of some 2.5 MPa, which drives flow through the bypass.
"""

import datetime
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

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

from .arming import bring
from .connected_rig import ConnectedRig
from .moves import preparing_moves
from .states import Event

Array = NDArray[np.float64]

BATCH_TICKS: Final = round(0.5 / TICK)
"""Ticks of a batch mean: five times a flow meter's lag, so that means are nearly independent."""
ZERO_S: Final = 40.0
"""Time in s in which the zeros are measured; it is long, as their error is in all measurements."""
TRIES: Final = 3
"""Most strokes for one measurement; the flow must settle in one of them."""
STROKE_S: Final = 6.0
RETURN_S: Final = 2.5
"""Time in s in which the ram returns to where a stroke begins and comes to rest there."""
SPEED: Final = 0.05
"""Speed of a stroke in m/s: fast enough for smooth friction, slow beside what the valve can do."""
_MARGIN_M: Final = 0.05
"""Distance in m of strokes from the position limits, as the loop may lag and overshoot."""
_BATCH_TICKS: Final = 250

_UNMETERED: Final = "rely on its data sheet: `needle: {maximum: ..., rangeability: ...}`"


class Way(NamedTuple):
    """The meter and the stroke by which the flow through a bypass is measured."""

    meter: str
    direction: float
    """Direction of the stroke that puts pressure on the bypass: 1 out, -1 in."""


WAYS: Final = {
    str(Verdict.EXTERNAL_LEAKAGE_1): Way("flow_1_m3_per_s", 1.0),
    str(Verdict.EXTERNAL_LEAKAGE_2): Way("flow_2_m3_per_s", -1.0),
    str(Verdict.INTERNAL_LEAKAGE): Way("flow_internal_m3_per_s", 1.0),
}
"""Fault -> how the flow through its bypass is measured, for bypasses with a flow meter."""


class Samples(NamedTuple):
    """The samples of a motion, one row per tick; NaN where a sample is missing."""

    flows: Array
    """Flows (n, 3) in m^3/s, in the order of `METERS`."""
    pressures: Array
    """Pressures (n, 2) of chambers 1 and 2 in Pa."""


class Strokes:
    """Moves the ram and the bypass valves of an armed and homed rig, as a calibration needs it.

    Every method that moves something waits for the end of the motion. It raises `TripError` if the
    rig trips or is stopped, or if the valves do not follow.
    """

    def __init__(self, rig: ConnectedRig) -> None:
        self._rig = rig
        limits = rig.configured.limits
        room = limits.position_max_m - limits.position_min_m - 2.0 * _MARGIN_M
        self._middle_m = 0.5 * (limits.position_min_m + limits.position_max_m)
        self._length_m = min(SPEED * STROKE_S, room)

    def shut_bypasses(self) -> None:
        """Shut ball valve and needle of every bypass, and wait for their feedback.

        A throttle in the return line is opened.
        """
        self._move(preparing_moves(self._rig.configured, ()))

    def open_bypass(self, kind: str, opening: float) -> None:
        """Open a bypass's ball valve, and its needle to `opening` (0 to 1); await their feedback.

        The bypass is the one that makes the fault `kind`; other bypasses stay as they are.
        """
        self._move({f"{kind}_ball": 1.0, f"{kind}_needle": opening})

    def feedback(self, kind: str) -> float:
        """Return the newest opening, 0 to 1, that the needle of a bypass has reported.

        The bypass is the one that makes the fault `kind`. The opening is NaN if no driver reads the
        needle, it was not read yet, or the last read failed.
        """
        return self._rig.slow(f"{kind}_needle")

    def rest(self, duration_s: float) -> Samples:
        """Bring the ram midway between its limits, hold it there, and return the samples meanwhile.

        `duration_s` is the time in s for which it is held; only this time is sampled.
        """
        return self._follow(np.full(round(duration_s / TICK), self._middle_m))

    def stroke(self, direction: float) -> Samples:
        """Move the ram at constant speed, out (1) or in (-1), and return the samples meanwhile.

        First the ram goes to where the stroke begins, which is not sampled. The stroke lasts
        `STROKE_S`; its middle is midway between the position limits. It is slower than `SPEED` if
        these leave too little room.
        """
        way = np.linspace(-0.5, 0.5, round(STROKE_S / TICK))
        return self._follow(self._middle_m + direction * self._length_m * way)

    def _move(self, outputs: dict[str, float]) -> None:
        bring(self._rig, outputs, "the bypass valves are not where they were sent", "look at them")

    def _follow(self, setpoint: Array) -> Samples:
        rig, rows = self._rig, []
        wire = rig.tracking(float(setpoint[0]), RETURN_S, setpoint=setpoint)
        with rig.reporting_stops():
            rig.check()
            rig.handle(Event.POSITION)
            wire.position()
            rig.handle(Event.POSITIONED)
            rig.handle(Event.RUN)
            while wire.ticks_left:
                rig.check()
                rows.append(wire.advance(_BATCH_TICKS))
            wire.safe_state()
            rig.handle(Event.DONE)
        table, columns = np.concatenate(rows), (METERS, ("pressure_1_Pa", "pressure_2_Pa"))
        return Samples(*(table[:, [wire.channels.index(n) for n in names]] for names in columns))


def calibratable(rig: Rig, asked: Sequence[str] = ()) -> dict[str, BypassValve]:
    """Return fault -> bypass valve for the bypasses of a rig whose needles are to be calibrated.

    A bypass can be calibrated if it has a flow meter (`WAYS`) that a driver reads, and a driver
    moves its valves.

    Args:
        rig: the rig.
        asked: the faults whose bypasses are to be calibrated; if empty, all that can be.

    Raises:
        CalibrationError: a bypass that was asked for cannot be calibrated, no bypass can be, or the
            rig's backend is not hardware.
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
    """Return the problem that prevents the calibration of a bypass; None if there is none."""
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
    strokes: Strokes,
    valves: Mapping[str, BypassValve],
    openings: Sequence[float],
    return_pressure_Pa: float,  # noqa: N803
    date: datetime.date,
    on_measured: Callable[[str, Measurement], None] = lambda kind, measurement: None,
) -> dict[str, NeedleCalibration]:
    """Measure the needles of bypass valves on the rig, and return fault -> calibrated needle.

    First all bypasses are shut, and the zeros of the meters are measured at rest for `ZERO_S`. Then
    the needles are measured one after the other (`measure_needle`). At the end all bypasses are
    shut; after an error they stay as they are.

    Args:
        strokes: moves the rig's ram and bypass valves.
        valves: fault -> bypass valve, for those to calibrate; see `calibratable`.
        openings: needle openings to measure at, from 0 to 1, increasing.
        return_pressure_Pa: pressure of the return line in Pa, into which external bypasses lead.
        date: day of the calibration.
        on_measured: is called with fault and measurement after each measurement.

    Raises:
        CalibrationError: a meter gives readings in less than half of the samples, a flow does not
            settle in `TRIES` strokes, a pressure drop is too small, or a flow is too small for the
            meter or too large for the valve.
        BypassError: the measured coefficients do not increase with the opening, or the largest
            opening is not 1.
        TripError: the rig tripped or was stopped, or the valves do not follow.
    """
    strokes.shut_bypasses()
    samples = strokes.rest(ZERO_S)
    zeros = {kind: meter_zero(_metered(samples, kind), BATCH_TICKS) for kind in valves}
    needles = {}
    for kind, valve in valves.items():
        measured = measure_needle(
            strokes, kind, openings, zeros[kind], return_pressure_Pa, partial(on_measured, kind)
        )
        needles[kind] = calibrated_needle(valve, measured, date)
    return needles


def measure_needle(
    strokes: Strokes,
    kind: str,
    openings: Sequence[float],
    zero: Estimate,
    return_pressure_Pa: float,  # noqa: N803
    on_measured: Callable[[Measurement], None] = lambda measurement: None,
) -> tuple[Measurement, ...]:
    """Measure a bypass at each needle opening, upwards, then downwards; return the measurements.

    There are two measurements for each opening, in the order in which they were made. At the end
    every bypass is shut; after an error the bypasses stay as they are.

    Args:
        strokes: moves the rig's ram and bypass valves.
        kind: the fault that the bypass makes, one of `WAYS`.
        openings: needle openings, 0 to 1, increasing.
        zero: zero of the bypass's meter, m^3/s.
        return_pressure_Pa: pressure of the return line in Pa, into which external bypasses lead.
        on_measured: is called after each measurement.

    Raises:
        CalibrationError: the meter gives readings in less than half of the samples of a stroke, or
            the flow at an opening settles in none of `TRIES` strokes.
        TripError: the rig tripped or was stopped, or the valves do not follow.
    """

    def measurement(opening: float, upwards: bool) -> Measurement:
        for _ in range(TRIES):
            samples = strokes.stroke(WAYS[kind].direction)
            flows, drops = _metered(samples, kind), _drop(samples, kind, return_pressure_Pa)
            try:
                found = measured_coefficient(flows, drops, zero, BATCH_TICKS)
            except UnsettledError:
                continue
            flow, coefficient, drop = found
            return Measurement(opening, upwards, strokes.feedback(kind), flow, drop, coefficient)
        raise _refusal(
            kind, f"opening {opening:g}", "the flow", f"did not settle in {TRIES} strokes",
            "look for air in the lines, a needle that creeps, or an unsteady supply",
        )  # fmt: skip

    measured = []
    up_and_down = [(each, True) for each in openings] + [(each, False) for each in openings[::-1]]
    for opening, upwards in up_and_down:
        strokes.open_bypass(kind, opening)
        measured.append(measurement(opening, upwards))
        on_measured(measured[-1])
    strokes.shut_bypasses()
    return tuple(measured)


def _metered(samples: Samples, kind: str) -> Array:
    """Return the flow through a bypass, (n,), m^3/s, as its meter read it, with the meter's zero.

    It is NaN where a sample is missing.

    Raises:
        CalibrationError: more than half of the samples are missing.
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
