"""A leak that came and went stays on record: what, when, how long and how large."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.intermittent import Episode, Intermittent
from estimator.leaks.detection import Decision
from estimator.leaks.found import found_in
from estimator.leaks.replaying import ReplayResult, replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, LEAKS, NOMINAL, Model
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from tools.simulated.recordings import recorded

DROP = {"external_leakage_1": 6.9e6, "external_leakage_2": 6.9e6, "internal_leakage": 2.5e6}
HEALTHY = Decision("healthy")


def judged(leak: str, first_s: float, on_s: float, seed: int, motion: str) -> ReplayResult:
    """Return what is made of a leak of 0.25 L/min that is open for some of every 10 s."""
    time_s = np.arange(round(40.0 / TICK)) * TICK
    faults = np.zeros((time_s.size, len(FAULT_COLUMNS)))
    there = (time_s >= first_s) & ((time_s - first_s) % 10.0 < on_s)
    faults[there, FAULT_COLUMNS.index(leak)] = 0.25 * LITRE_PER_MINUTE / np.sqrt(DROP[leak])
    waves = [np.sin(2.0 * np.pi * f * time_s + seed) for f in (0.2, 0.5, 0.9)]
    wanted = {
        "sine": 0.3 + 0.15 * np.sin(np.pi * time_s + 0.1),
        "multisine": 0.3 + 0.05 * sum(waves),
    }[motion]
    truth = NOMINAL._replace(spool_null_bias=1.5e-6, bulk_modulus=6.6e8, supply_droop=8e11)
    rig = simulated_rig(Model(parameters=truth), seed)
    return replay(recorded(rig, Motion(wanted, False, faults, 0.3, 1500)), Model())


@pytest.mark.parametrize("motion", ["sine", "multisine"])
@pytest.mark.parametrize(("leak", "first_s"), [*zip(LEAKS, (12.0, 12.4, 12.1), strict=True)])
def test_a_leak_that_comes_and_goes_does_not_end_healthy(
    leak: str, first_s: float, motion: str
) -> None:
    result = judged(leak, first_s, 2.0, 3, motion)
    decision = result.decision
    assert decision.verdict == leak
    assert decision.onset_s == pytest.approx(first_s, abs=0.5)
    assert decision.returns is not None
    starts = [each.start_s for each in decision.returns.episodes]
    assert starts == pytest.approx([first_s, first_s + 10.0, first_s + 20.0], abs=0.4)
    flow = (decision.leak_m3_per_s or 0.0) / LITRE_PER_MINUTE
    assert flow == pytest.approx(0.25, rel=0.2)
    (found,) = [each for each in result.found if each.confirmed]
    assert found.decision.verdict == leak
    assert found.decision.returns == decision.returns
    assert found.active
    assert found.detected_at_s == result.detected_at_s


def found(
    verdict: str, onset_s: float, ended_s: float | None = None, statistic: float = 9.0
) -> Decision:
    return Decision(verdict, onset_s, statistic=statistic, threshold=6.0, ended_s=ended_s)


def test_what_was_named_for_less_than_5_s_is_listed_but_not_confirmed() -> None:
    history = [(10.0, HEALTHY), (10.5, found(LEAKS[0], 9.0)), (11.0, HEALTHY), (40.0, HEALTHY)]
    (only,) = found_in(history)
    assert not only.confirmed
    assert not only.active
    assert (only.detected_at_s, only.ended_s) == (10.5, 10.5)


def test_a_leak_that_returns_is_another_one() -> None:
    first = [(0.5 * k, found(LEAKS[0], 9.0, statistic=k)) for k in range(20, 40)]
    gone = [(0.5 * k, found(LEAKS[0], 9.0, 19.5)) for k in range(40, 60)]
    again = [(0.5 * k, found(LEAKS[0], 28.0)) for k in range(60, 80)]
    early, late = found_in([*first, *gone, *again])
    assert (early.decision.onset_s, early.ended_s, early.confirmed) == (9.0, 19.5, True)
    assert early.decision.statistic == 39
    assert (late.decision.onset_s, late.detected_at_s, late.active) == (28.0, 30.0, True)


def test_a_misnaming_in_between_does_not_end_a_fault() -> None:
    names = [LEAKS[0]] * 4 + [LEAKS[2]] + [LEAKS[0]] * 20
    history = [(10.0 + 0.5 * k, found(name, 9.0)) for k, name in enumerate(names)]
    leak, misnamed = found_in(history)
    assert leak.active
    assert leak.confirmed
    assert misnamed.ended_s == misnamed.detected_at_s == 12.0
    assert not misnamed.stays


def test_the_record_of_a_leak_that_comes_and_goes_has_its_openings() -> None:
    opened = (Episode(9.0, 11.0, 1e-6), Episode(19.0, 21.0, 1e-6), Episode(29.0, None, 1e-6))
    returns = Intermittent(
        LEAKS[0], 30.0, 14.4, 26.0, opened, 3, 0.2, (0.1, 0.3), 1e-6, 1e-8, 4e-10
    )
    strong = [(0.5 * k, found(LEAKS[0], 9.0, statistic=50.0)) for k in range(20, 40)]
    weak = [(20.0 + 0.5 * k, replace(found(LEAKS[0], 9.0), returns=returns)) for k in range(20)]
    (only,) = found_in([*strong, *weak])
    assert only.decision.returns == returns
    assert only.active
