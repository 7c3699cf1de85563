"""The default detector names what was done to a rig it does not know, and only that."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.leaks.detection import OilAccountDetector, leak_flow
from estimator.leaks.replaying import ReplayResult, replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.simulated.drawn_rigs import drawn_rig
from tools.simulated.recordings import TRUE_LEAKS, recorded

Array = NDArray[np.float64]

LEAKS = FAULT_COLUMNS[:3]
DROP = {"external_leakage_1": 6.9e6, "external_leakage_2": 6.9e6, "internal_leakage": 2.5e6}
ONSET_S = 12.0
TRUTH = NOMINAL._replace(
    spool_null_bias=1.5e-6,
    bulk_modulus=6.6e8,
    discharge_coefficient=0.606,
    friction_asymmetry=120.0,
    viscous=385.0,
    supply_droop=8e11,
)
"""A rig a little unlike the model the detector assumes, as real ones are."""


def setpoint(kind: str, ticks: int, rng: np.random.Generator) -> tuple[Array, bool]:
    """Return a motion (m, or V in open loop) and whether it is open loop."""
    time_s = np.arange(ticks) * TICK
    if kind == "sine":
        return 0.3 + 0.15 * np.sin(np.pi * time_s + 0.1), False
    if kind == "small sine":
        return 0.3 + 0.02 * np.sin(2.0 * np.pi * time_s), False
    if kind == "steps":
        return rng.uniform(0.1, 0.5, 100)[(time_s / 1.5).astype(int)], False
    if kind == "multisine":
        waves = [np.sin(2.0 * np.pi * f * time_s + rng.uniform(0, 6)) for f in (0.2, 0.5, 0.9)]
        return 0.3 + 0.05 * sum(waves), False
    if kind == "open loop":
        return 3.0 * np.sin(2.0 * np.pi * 0.7 * time_s + 0.1), True
    return np.full(ticks, 0.3), False


@dataclass(frozen=True)
class Case:
    """One run of a rig: its truth, motion, faults (column to coefficient, from ONSET_S on)."""

    motion: str = "sine"
    faults: tuple[tuple[str, float], ...] = ()
    truth: Parameters = TRUTH
    spool_sensor: bool = True
    supply_sensor: bool = False
    seconds: float = 24.0
    until_s: float = np.inf
    again_s: float = np.inf
    seed: int = 1


def run(case: Case) -> Recording:
    ticks = round(case.seconds / TICK)
    faults = np.zeros((ticks, len(FAULT_COLUMNS)))
    time_s = np.arange(ticks) * TICK
    acting = (time_s >= ONSET_S) & (time_s < case.until_s) | (time_s >= case.again_s)
    for name, coefficient in case.faults:
        faults[acting, FAULT_COLUMNS.index(name)] = coefficient
    wanted, open_loop = setpoint(case.motion, ticks, np.random.default_rng(case.seed))
    rig = simulated_rig(
        Model(parameters=case.truth),
        case.seed,
        spool_sensor=case.spool_sensor,
        supply_pressure_sensor=case.supply_sensor,
    )
    return recorded(rig, Motion(wanted, open_loop, faults, 0.3, 1500))


def leaking(leak: str, flow: float, **case: Any) -> Case:
    """Return a case with a leak of so many L/min at its reference drop."""
    return Case(faults=((leak, flow * LITRE_PER_MINUTE / np.sqrt(DROP[leak])),), **case)


def judged(case: Case) -> tuple[Recording, ReplayResult]:
    recording = run(case)
    return recording, replay(recording, Model())


def true_flow(recording: Recording, leak: str) -> float:
    later = recording.time_s >= ONSET_S + 2.0
    return float(np.abs(recording[TRUE_LEAKS[leak]])[later].mean())


OTHER_CHAMBER = {"sine", "multisine"}
"""Motions whose leak at chamber 2 is in the long suite; that of the others at chamber 1 is."""


@pytest.mark.parametrize(
    ("motion", "leak"),
    [
        pytest.param(
            motion, leak,
            marks=pytest.mark.long
            if leak == LEAKS[1 if motion in OTHER_CHAMBER else 0]
            else (),
        )
        for motion in ("sine", "steps", "multisine", "open loop")
        for leak in LEAKS
    ],
)  # fmt: skip
def test_a_small_leak_is_named_dated_and_sized_in_every_motion(motion: str, leak: str) -> None:
    recording, result = judged(leaking(leak, 0.2, motion=motion))
    decision = result.decision
    assert decision.verdict == leak
    assert decision.onset_s == pytest.approx(ONSET_S, abs=0.5)
    assert result.detected_at_s is not None
    assert ONSET_S < result.detected_at_s <= ONSET_S + 6.0
    low, high = decision.interval_m3_per_s or (0.0, 0.0)
    assert low <= true_flow(recording, leak) <= high


@pytest.mark.parametrize("leak", LEAKS)
def test_it_needs_no_spool_sensor(leak: str) -> None:
    _, result = judged(leaking(leak, 0.3, spool_sensor=False))
    assert result.decision.verdict == leak


@pytest.mark.parametrize("leak", LEAKS)
def test_a_spring_in_the_way_does_not_hide_a_leak(leak: str) -> None:
    truth = TRUTH._replace(spring_stiffness=2e4, spring_contact=0.22)
    recording, result = judged(leaking(leak, 0.2, truth=truth))
    assert result.decision.verdict == leak
    assert result.decision.leak_m3_per_s == pytest.approx(true_flow(recording, leak), rel=0.2)


@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(4, 8))]
)
def test_healthy_rigs_of_all_kinds_stay_healthy(seed: int) -> None:
    truth = drawn_rig(np.random.default_rng(seed))
    motion = ("sine", "steps", "multisine", "open loop")[seed % 4]
    _, result = judged(Case(motion, truth=truth, spool_sensor=seed % 3 > 0, seed=seed))
    assert {decision.verdict for _, decision in result.history[10:]} <= {"healthy", "inconclusive"}
    assert result.decision.verdict == "healthy"


@pytest.mark.parametrize("seed", [1, 3])
def test_two_leaks_at_once_are_called_so(seed: int) -> None:
    """And not a fault of the supply line, which would explain some of both."""
    faults = tuple((leak, 0.6 * LITRE_PER_MINUTE / np.sqrt(DROP[leak])) for leak in LEAKS[:2])
    _, result = judged(Case("multisine", faults, seed=seed))
    assert result.decision.verdict == "multiple"
    assert "external_leakage_2_coefficient" in result.decision.details


@pytest.mark.parametrize(
    ("fault", "coefficient"),
    [("supply_leakage", 20.0 * LITRE_PER_MINUTE / np.sqrt(13.8e6)), ("return_blockage", 1e13)],
)
@pytest.mark.parametrize("measured", [True, False])
def test_line_faults_are_named_if_the_supply_pressure_is_measured_and_never_called_leaks(
    fault: str, coefficient: float, measured: bool
) -> None:
    truth = TRUTH._replace(supply_droop=2e12)
    case = Case(faults=((fault, coefficient),), truth=truth, supply_sensor=measured)
    _, result = judged(case)
    assert result.decision.verdict == (fault if measured else "unknown_fault")
    assert not {decision.verdict for _, decision in result.history} & {*LEAKS, "multiple"}


@pytest.mark.parametrize("leak", ["", "external_leakage_2"])
def test_a_supply_leak_too_small_for_the_accounts_is_named_alone_and_beside_a_leak(
    leak: str,
) -> None:
    faults = [("supply_leakage", 10.0 * LITRE_PER_MINUTE / np.sqrt(13.8e6))]
    if leak:
        faults += leaking(leak, 0.4).faults
    truth = TRUTH._replace(supply_droop=1.5e12)
    _, result = judged(Case(faults=tuple(faults), truth=truth, supply_sensor=True))
    decision = result.decision
    assert decision.verdict == ("multiple" if leak else "supply_leakage")
    assert decision.probabilities[decision.verdict] > 0.99
    assert sum(decision.probabilities.values()) == pytest.approx(1.0)
    assert decision.statistic > decision.threshold
    assert decision.onset_s == pytest.approx(ONSET_S, abs=0.6)
    if leak:
        assert decision.details["supply_leakage_coefficient"] > 2e4
        assert f"{leak}_coefficient" in decision.details


@pytest.mark.parametrize("faults", [(), (("external_leakage_1", 2e-9),)])
def test_a_ram_that_stands_still_shows_nothing(faults: tuple[tuple[str, float], ...]) -> None:
    _, result = judged(Case("hold", faults))
    assert result.decision.verdict == "inconclusive"
    assert result.decision.details["travel_m"] < result.decision.details["travel_needed_m"]


def test_a_leak_that_has_gone_again_is_still_reported() -> None:
    _, result = judged(replace(leaking("external_leakage_1", 0.5), seconds=34.0, until_s=20.0))
    assert result.decision.verdict == "external_leakage_1"
    assert result.decision.onset_s == pytest.approx(ONSET_S, abs=0.5)


def test_chambers_exchanged_exchange_the_verdict() -> None:
    recording = run(leaking("external_leakage_1", 0.3))
    mirrored = dict(recording.channels)
    mirrored["position_m"] = NOMINAL.stroke_max - recording["position_m"]
    mirrored["command_V"] = -recording["command_V"]
    mirrored["spool_m"] = -recording["spool_m"]
    mirrored["pressure_1_Pa"] = recording["pressure_2_Pa"]
    mirrored["pressure_2_Pa"] = recording["pressure_1_Pa"]
    here, there = (replay(each, Model()).decision for each in (recording, Recording(mirrored)))
    assert here.verdict == "external_leakage_1"
    assert there.verdict == "external_leakage_2"
    assert there.leak_m3_per_s == pytest.approx(here.leak_m3_per_s, rel=0.02)


def test_a_gap_in_a_sensor_does_not_raise_an_alarm() -> None:
    recording = run(Case())
    for channel in ("pressure_1_Pa", "spool_m", "position_m"):
        recording.channels[channel][9000:9300] = np.nan
    assert replay(recording, Model()).decision.verdict == "healthy"


def sampled_seldom(recording: Recording, apart: int) -> Recording:
    """Return what a device records that has a sample at every n-th tick only."""
    channels = {name: values.copy() for name, values in recording.channels.items()}
    for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m"):
        channels[name][np.arange(recording.time_s.size) % apart != 0] = np.nan
    return Recording(channels)


@pytest.mark.parametrize("motion", ["sine", "steps", "open loop"])
def test_a_slow_device_shows_a_small_leak_as_well(motion: str) -> None:
    recording = run(leaking("external_leakage_1", 0.2, motion=motion))
    for apart in (2, 4, 5):
        decision = replay(sampled_seldom(recording, apart), Model()).decision
        assert decision.verdict == "external_leakage_1"
        assert decision.onset_s == pytest.approx(ONSET_S, abs=0.5)
        low, high = decision.interval_m3_per_s or (0.0, 0.0)
        assert low <= true_flow(recording, "external_leakage_1") <= high


@pytest.mark.parametrize("motion", ["sine", "steps", "open loop"])
def test_a_slow_device_shows_that_a_rig_is_healthy_unless_it_is_too_slow(motion: str) -> None:
    recording = run(Case(motion))
    for apart, verdict in ((2, "healthy"), (4, "healthy"), (5, "healthy"), (10, "inconclusive")):
        assert replay(sampled_seldom(recording, apart), Model()).decision.verdict == verdict


def test_a_sensor_that_is_gone_for_good_leaves_nothing_to_claim() -> None:
    recording = run(Case())
    recording.channels["pressure_1_Pa"][10000:] = np.nan
    assert replay(recording, Model()).decision.verdict == "inconclusive"


def test_the_filters_own_leak_states_follow_the_leak() -> None:
    recording, result = judged(leaking("internal_leakage", 0.5))
    flows = leak_flow(result.run, NOMINAL)
    later = recording.time_s >= ONSET_S + 4.0
    found = np.abs(flows["internal_leakage"][later]).mean()
    assert found == pytest.approx(true_flow(recording, "internal_leakage"), rel=0.2)


def test_a_detector_that_has_seen_too_little_says_so() -> None:
    recording = run(Case(seconds=2.0))
    assert replay(recording, Model()).decision.verdict == "inconclusive"
    assert OilAccountDetector(Model()).decide().verdict == "inconclusive"


@pytest.mark.parametrize("leak", LEAKS)
def test_what_is_there_now_is_told_from_what_was(leak: str) -> None:
    """A leak of 2 L/min is confirmed 5 s after it was found, and gone when it is shut."""
    _, result = judged(leaking(leak, 2.0, until_s=22.0, seconds=32.0))
    which = LEAKS.index(leak)
    present = {time: decision.present_leaks[which] for time, decision in result.history}
    true = 2.0 * LITRE_PER_MINUTE / np.sqrt(DROP[leak])
    assert all(present[time] == 0.0 for time in present if time < ONSET_S + 6.0)
    assert present[21.0] == pytest.approx(true, rel=0.1)
    assert all(present[time] == 0.0 for time in present if time > 26.0)
    assert result.decision.verdict == leak
    others = [d.present_leaks[i] for _, d in result.history for i in range(3) if i != which]
    assert not any(others)


def test_a_leak_that_opens_again_is_there_again() -> None:
    leak = leaking("external_leakage_1", 1.0, seconds=54.0, until_s=22.0, again_s=36.0)
    _, result = judged(leak)
    present = {time: decision.present_leaks[0] for time, decision in result.history}
    assert not any(coefficient for time, coefficient in present.items() if 25.0 < time < 41.0)
    true = LITRE_PER_MINUTE / np.sqrt(DROP["external_leakage_1"])
    assert present[48.0] == pytest.approx(true, rel=0.1)
    assert present[53.0] == pytest.approx(true, rel=0.1)


def test_a_leak_that_has_gone_is_not_taken_for_another_one() -> None:
    """In a small motion, one that stays and began at the start explains its blocks as well."""
    case = leaking("external_leakage_1", 2.0, motion="small sine", truth=NOMINAL, seconds=60.0)
    _, result = judged(replace(case, until_s=32.0))
    assert result.decision.verdict == "external_leakage_1"
    present = {time: decision.present_leaks for time, decision in result.history}
    assert present[31.0][0] > 0.0
    assert not any(any(leaks) for time, leaks in present.items() if time > 36.0)


def test_a_great_leak_stays_confirmed_where_it_drains_a_chamber() -> None:
    case = leaking("internal_leakage", 4.0, motion="small sine", truth=NOMINAL, seconds=44.0)
    _, result = judged(case)
    assert all(d.present_leaks[2] > 0.0 for time, d in result.history if time >= 22.0)


def test_probabilities_add_up_and_go_with_the_verdict() -> None:
    _, result = judged(leaking("external_leakage_2", 0.1))
    for time, decision in result.history:
        told = decision.probabilities
        assert told or decision.verdict == "inconclusive"
        assert not told or sum(told.values()) == pytest.approx(1.0)
        if time < ONSET_S and told:
            assert told["healthy"] > 0.9
        if decision.verdict == "external_leakage_2":
            assert told["external_leakage_2"] > 0.9
        if told and told["healthy"] < 0.5:
            assert decision.verdict != "healthy"
            assert decision.suspected in ("external_leakage_2", None)
    assert result.decision.probabilities["external_leakage_2"] > 0.99


@pytest.mark.parametrize("channel", ["pressure_1_Pa", "pressure_2_Pa"])
def test_a_frozen_pressure_is_no_measurement(channel: str) -> None:
    recording = run(Case())
    frozen = dict(recording.channels)
    frozen[channel] = np.where(recording.time_s > 8.0, 6.9e6, recording[channel])
    assert replay(Recording(frozen), Model()).decision.verdict == "inconclusive"


def test_no_leak_is_greater_than_what_a_bypass_passes() -> None:
    """The encoder stops, while the valve goes on to feed the chambers."""
    recording = run(Case(seconds=32.0))
    stuck = dict(recording.channels)
    stuck["position_m"] = np.where(
        recording.time_s > 20.0, recording["position_m"][20000], recording["position_m"]
    )
    decision = replay(Recording(stuck), Model()).decision
    assert decision.verdict in ("unknown_fault", "inconclusive")
