"""Detectors in lanes come to the verdicts that the replay of the same rows gives."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.product_lanes import ProductLanes
from estimator.leak_lanes.lane_detectors import LaneDetectors, samples_of_lane
from estimator.leaks.decision import Decision
from estimator.leaks.detection import OilAccountDetector
from estimator.leaks.drift_watch import DriftWatch
from estimator.leaks.replaying import judged
from rig.lanes import LANES
from rig.plant import LITRE_PER_MINUTE, NO_FAULT, NOMINAL, Model
from rig.plant.integrator import TICK
from tools.simulated.lanes import SimulatedLanes

Array = NDArray[np.float64]
History = list[tuple[float, Decision]]

SECONDS = 20
BLOCK = 500
ONSET = 8_000
NAMES = (
    "healthy",
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
    "healthy rig unlike its model",
    "external leak, readings missing and frozen, a chamber dry",
)


@dataclass(frozen=True)
class Judged:
    """Decisions after each half second of each lane, in lanes and by a replay of the same rows."""

    in_lanes: list[History]
    replayed: list[History]


def leak(flow: float, drop: float) -> float:
    """Return the coefficient of a leak that passes a flow in L/min at a drop in Pa."""
    return flow * LITRE_PER_MINUTE / sqrt(drop)


def rows() -> Array:
    """Return the readings (ticks, 6, LANES) of eight rigs, which `NAMES` describes."""
    unlike = NOMINAL._replace(bulk_modulus=0.87 * NOMINAL.bulk_modulus, spool_null_bias=3e-6)
    rigs = [NOMINAL, NOMINAL, unlike, NOMINAL, NOMINAL, NOMINAL, unlike, NOMINAL]
    rigs[4] = NOMINAL._replace(supply_droop=3e12)
    faults = [
        NO_FAULT,
        NO_FAULT._replace(external_leakage_1=leak(0.3, 6.9e6)),
        NO_FAULT._replace(external_leakage_2=leak(0.08, 6.9e6)),
        NO_FAULT._replace(internal_leakage=leak(0.2, 2.5e6)),
        NO_FAULT._replace(supply_leakage=leak(12.0, 13.8e6)),
        NO_FAULT._replace(return_blockage=2e13),
        NO_FAULT,
        NO_FAULT._replace(external_leakage_1=leak(0.6, 6.9e6)),
    ]
    lanes = SimulatedLanes(rigs, range(LANES), [0.3] * LANES, faults=faults, onsets=[ONSET] * LANES)
    t = np.arange(SECONDS * 1000 + 1) * TICK
    setpoint = np.stack(
        [0.3 + (0.05 + 0.01 * i) * np.sin((1.5 + 0.3 * i) * t) for i in range(LANES)], axis=1
    )
    # The ram of one lane is held for a while, so that its spool rests at null.
    setpoint[5500:7000, 3] = setpoint[5500, 3]
    open_loop = np.zeros_like(setpoint)
    # Full strokes against an end and back empty a chamber.
    strokes = slice(3000, 4200)
    setpoint[strokes, 7] = np.where(np.sin(9.0 * t[strokes]) > 0.0, 10.0, -10.0)
    open_loop[strokes, 7] = 1.0
    found = lanes.advance(setpoint, open_loop)
    found[6000:6100, 0, 7] = np.nan
    found[7000:7100, 1, 7] = found[7000, 1, 7]
    return np.asarray(found)


@pytest.fixture(scope="module")
def both() -> Judged:
    readings = rows()
    time_s: Array = np.arange(len(readings), dtype=np.float64) * TICK
    states = ProductLanes(Model()).advance(readings)
    detectors = LaneDetectors(Model(), 1.0)
    in_lanes: list[History] = [[] for _ in range(LANES)]
    for start in range(0, len(readings) - 1, BLOCK):
        part = slice(start + 1 if start else 0, start + BLOCK + 1)
        detectors.update(time_s[part], readings[part], states[part])
        for history, detector in zip(in_lanes, detectors.each, strict=True):
            history.append((float(time_s[part][-1]), detector.decide()))
    replayed = [
        list(judged(*samples_of_lane(time_s, readings, states, lane), OilAccountDetector(Model())))
        for lane in range(LANES)
    ]
    return Judged(in_lanes, replayed)


@pytest.mark.parametrize("lane", range(LANES), ids=NAMES)
def test_each_lane_has_the_verdicts_of_its_replay(both: Judged, lane: int) -> None:
    verdicts = [
        [(time_s, decision.verdict) for time_s, decision in history]
        for history in (both.in_lanes[lane], both.replayed[lane])
    ]
    assert verdicts[0] == verdicts[1]


def test_the_leaks_are_named(both: Judged) -> None:
    final = [history[-1][1].verdict for history in both.in_lanes]
    assert final[1:4] == list(NAMES[1:4])
    assert final[0] == final[6] == "healthy"
    assert final[4] == "supply_leakage"


@pytest.mark.parametrize("lane", range(LANES), ids=NAMES)
def test_sizes_onsets_and_statistics_differ_by_rounding_alone(both: Judged, lane: int) -> None:
    pairs = zip(both.in_lanes[lane], both.replayed[lane], strict=True)
    for (_, here), (_, there) in pairs:
        for name in ("leak_m3_per_s", "leak_std_m3_per_s", "onset_s", "statistic", "threshold"):
            ours, theirs = getattr(here, name), getattr(there, name)
            assert (ours is None) == (theirs is None)
            if ours is not None:
                assert ours == pytest.approx(theirs, rel=1e-5, abs=1e-12)
        assert here.probabilities == pytest.approx(there.probabilities, rel=1e-4, abs=1e-9)


def test_each_lane_sees_whether_its_encoder_passes_an_end_of_the_stroke(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Array] = []
    monkeypatch.setattr(DriftWatch, "see", lambda self, position: seen.append(position))
    time_s: Array = np.arange(2 * BLOCK + 1, dtype=np.float64) * TICK
    readings = np.zeros((2 * BLOCK + 1, 6, LANES))
    readings[:, 0] = np.linspace(0.1, 0.5, LANES)
    # Pressures that stand still would count as frozen, and their lanes would be on their own.
    readings[:, 1:3] = 6.9e6 + 1e5 * time_s[:, None, None]
    readings[:, 4] = 13.8e6
    states = ProductLanes(Model()).advance(readings)
    detectors = LaneDetectors(Model(), 1.0)
    for part in (slice(0, BLOCK + 1), slice(BLOCK + 1, None)):
        seen.clear()
        detectors.update(time_s[part], readings[part], states[part])
        np.testing.assert_array_equal(np.array(seen).T, readings[part, 0])
