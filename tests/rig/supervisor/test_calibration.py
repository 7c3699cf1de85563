"""How a rig is made to measure its needle valves, on one that only reckons."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from itertools import groupby

import numpy as np
import pytest

from faults.bypass import NOMINAL_BYPASSES
from faults.needle_calibration import CalibrationError, Estimate
from rig.configuration.rigs.rig import Rig, load_rig
from rig.supervisor.calibration import (
    BATCH_TICKS,
    TRIES,
    WAYS,
    Samples,
    Strokes,
    calibratable,
    calibrate,
    measure_needle,
)

KINDS = tuple(WAYS)
OPENINGS = (0.0, 0.25, 0.5, 0.75, 1.0)
RETURN_PA = 2e5
OFFSET, NOISE = 8e-7, 3e-7
"""Fixed error and noise of a meter, m^3/s."""
READING_TICKS = 100
STROKE_TICKS = 12 * BATCH_TICKS
DAY = date(2026, 3, 2)


class ReckonedRig(Strokes):
    """Motions of a rig with the nominal bypasses, in no time; keeps what it was asked.

    Attributes:
        asked: in order: ("shut",), ("rest",), ("open", kind, opening) and ("stroke", direction).
        unsettled: strokes still to come in which the flow drifts.
        silent: whether the meters tell nothing.
    """

    def __init__(self, unsettled: int = 0, silent: bool = False) -> None:
        self.asked: list[tuple[object, ...]] = []
        self.unsettled = unsettled
        self.silent = silent
        self._open: dict[str, float] = {}
        self._rng = np.random.default_rng(0)

    def shut_bypasses(self) -> None:
        self.asked.append(("shut",))
        self._open = {}

    def open_bypass(self, kind: str, opening: float) -> None:
        self.asked.append(("open", kind, opening))
        self._open[kind] = opening

    def feedback(self, kind: str) -> float:
        return self._open[kind]

    def rest(self, duration_s: float) -> Samples:
        self.asked.append(("rest",))
        return self._samples(round(1e3 * duration_s), 7e6, 7e6)

    def stroke(self, direction: float) -> Samples:
        self.asked.append(("stroke", direction))
        out = (6e6, 3.5e6)
        samples = self._samples(STROKE_TICKS, *(out if direction > 0.0 else out[::-1]))
        if self.unsettled:
            self.unsettled -= 1
            samples.flows[:] *= np.linspace(0.5, 1.5, STROKE_TICKS)[:, np.newaxis]
        return samples

    def _samples(self, ticks: int, pressure_1: float, pressure_2: float) -> Samples:
        drops = (pressure_1 - RETURN_PA, pressure_2 - RETURN_PA, pressure_1 - pressure_2)
        flows = np.empty((ticks, len(KINDS)))
        for index, (kind, drop) in enumerate(zip(KINDS, drops, strict=True)):
            noise = np.repeat(self._rng.standard_normal(ticks // READING_TICKS), READING_TICKS)
            valve = NOMINAL_BYPASSES[kind]
            flow = valve.effective(self._open[kind]) * np.sqrt(drop) if kind in self._open else 0.0
            flows[:, index] = np.maximum(flow + OFFSET + NOISE * noise, 0.0)
        if self.silent:
            flows[:] = np.nan
        pressures = np.array([pressure_1, pressure_2])
        return Samples(flows, pressures + 3e4 * self._rng.standard_normal((ticks, 2)))


def test_every_needle_is_found_as_it_is_within_the_errors_told() -> None:
    valves = {kind: NOMINAL_BYPASSES[kind] for kind in KINDS}
    found = calibrate(ReckonedRig(), valves, OPENINGS, RETURN_PA, DAY)
    assert tuple(found) == KINDS
    for kind, calibration in found.items():
        for point in calibration.points:
            true = NOMINAL_BYPASSES[kind].needle.coefficient(point.opening)
            assert abs(point.coefficient.value - true) <= 3.0 * point.coefficient.standard_error
        assert calibration.needle.maximum == pytest.approx(2.6e-8, rel=0.01)


def test_the_meters_are_zeroed_with_every_bypass_shut_and_one_is_open_at_a_time() -> None:
    rig = ReckonedRig()
    calibrate(rig, {kind: NOMINAL_BYPASSES[kind] for kind in KINDS}, OPENINGS, RETURN_PA, DAY)
    assert rig.asked[:2] == [("shut",), ("rest",)]
    moves = [step[:2] for step in rig.asked[2:] if step[0] in ("open", "shut")]
    assert [move for move, _ in groupby(moves)] == [
        move for kind in KINDS for move in (("open", kind), ("shut",))
    ]


def test_a_needle_goes_up_and_down_in_strokes_that_press_on_its_bypass() -> None:
    rig = ReckonedRig()
    told: list[float] = []
    measured = measure_needle(
        rig, "external_leakage_2", OPENINGS, Estimate(OFFSET, 0.0), RETURN_PA,
        lambda measurement: told.append(measurement.opening),
    )  # fmt: skip
    assert told == [*OPENINGS, *reversed(OPENINGS)]
    assert [each.upwards for each in measured] == [True] * 5 + [False] * 5
    assert {step for step in rig.asked if step[0] == "stroke"} == {("stroke", -1.0)}


def test_a_stroke_in_which_the_flow_does_not_settle_is_repeated() -> None:
    rig = ReckonedRig(unsettled=TRIES - 1)
    measure_needle(rig, "internal_leakage", (1.0,), Estimate(OFFSET, 0.0), RETURN_PA)
    assert rig.asked.count(("stroke", 1.0)) == 2 + TRIES - 1


def test_a_flow_that_never_settles_is_refused() -> None:
    rig = ReckonedRig(unsettled=100)
    with pytest.raises(CalibrationError, match="opening 1: the flow did not settle in 3 strokes"):
        measure_needle(rig, "internal_leakage", (1.0,), Estimate(OFFSET, 0.0), RETURN_PA)


def test_strokes_with_a_single_batch_of_readings_are_refused() -> None:
    class BriefRig(ReckonedRig):
        def stroke(self, direction: float) -> Samples:
            flows, pressures = super().stroke(direction)
            return Samples(flows[:BATCH_TICKS], pressures[:BATCH_TICKS])

    with pytest.raises(CalibrationError, match="opening 1: the flow did not settle in 3 strokes"):
        measure_needle(BriefRig(), "internal_leakage", (1.0,), Estimate(OFFSET, 0.0), RETURN_PA)


def test_a_meter_that_tells_nothing_is_named() -> None:
    valves = {"external_leakage_1": NOMINAL_BYPASSES["external_leakage_1"]}
    with pytest.raises(CalibrationError, match="flow_1_m3_per_s: the meter tells nothing"):
        calibrate(ReckonedRig(silent=True), valves, OPENINGS, RETURN_PA, DAY)


@pytest.fixture(scope="module")
def emulated() -> Rig:
    return load_rig("emulated")


def test_all_bypasses_with_a_meter_are_calibrated_unless_some_are_asked_for(emulated: Rig) -> None:
    assert tuple(calibratable(emulated)) == KINDS
    assert tuple(calibratable(emulated, ["internal_leakage"])) == ("internal_leakage",)


def test_what_cannot_be_calibrated_is_refused_all_at_once(emulated: Rig) -> None:
    def problems(rig: Rig, asked: tuple[str, ...] = ()) -> Iterator[str]:
        with pytest.raises(CalibrationError) as caught:
            calibratable(rig, asked)
        yield from (str(problem) for problem in caught.value.problems)

    unmetered = "its flow passes no flow meter; rely on its data sheet"
    for kind, told in zip(
        ("supply_leakage", "return_blockage"),
        problems(emulated, ("supply_leakage", "internal_leakage", "return_blockage")),
        strict=True,
    ):
        assert told.startswith(f"emulated {kind}: {unmetered}")
    blind = replace(emulated, drivers=tuple(d for d in emulated.drivers if d.name != "meters"))
    assert [told.split("; ")[0] for told in problems(blind)] == [
        f"emulated {kind}: {way.meter} is read by no driver" for kind, way in WAYS.items()
    ]
    (told,) = problems(replace(emulated, bypass_valves={}), ("internal_leakage",))
    assert "its bypass is not there, or no driver moves it" in told
    (told,) = problems(load_rig("simulated"))
    assert "give a rig with `backend: hardware`" in told
