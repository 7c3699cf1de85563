"""Trials are what their plan says, and an interrupted study goes on where it stopped."""

from pathlib import Path

import numpy as np
import pytest

from rig.plant import LEAKS
from tools.studies import leak_trials
from tools.studies.confusion import plans
from tools.studies.leak_trials import Judgement, Plan, Trial, judged, record, trials

HEALTHY = Plan(3, None, 1.0, 10.0, 12.0)


def made_up(plan: Plan) -> Trial:
    held = ((0.5, "inconclusive"), (8.0, plan.fault or "healthy"))
    return Trial(plan, True, plan.size, {"product": Judgement(held, (0.0, 1.5), None, None)})


@pytest.mark.parametrize("fault", LEAKS)
def test_a_leak_passes_about_what_was_asked_for_from_its_onset_on(fault: str) -> None:
    plan = Plan(5, fault, 0.2, 10.0, 16.0)
    recording, _, flow = record(plan)
    column = list(recording.channels)[-3 + LEAKS.index(fault)]
    leaking = np.abs(recording[column])
    assert not leaking[: 10_000 - 1].any()
    assert leaking[10_001:].all()
    assert 0.05 < flow < 0.4


def test_the_same_plan_gives_the_same_recording_and_another_seed_another() -> None:
    one, same = (record(HEALTHY)[0] for _ in range(2))
    other = record(Plan(4, None, 1.0, 10.0, 12.0))[0]
    assert one.content_hash() == same.content_hash()
    assert one.content_hash() != other.content_hash()


def test_a_rig_without_a_sensor_records_none_of_it() -> None:
    plan = Plan(3, None, 1.0, 5.0, 6.0, spool_sensor=False, supply_sensor=False)
    recording = record(plan)[0]
    assert np.isnan(recording["spool_m"]).all()
    assert np.isnan(recording["supply_pressure_Pa"]).all()


@pytest.mark.parametrize("judge", leak_trials.SETTINGS)
def test_a_healthy_rig_is_judged_every_half_second(judge: str) -> None:
    found = judged(record(HEALTHY)[0], judge)
    assert found.alarm_s() is None
    assert len(found.ratios) == 24
    assert found.first_s(found.verdict) is not None


def test_a_study_runs_only_what_it_has_not_kept(tmp_path: Path) -> None:
    plans = [Plan(seed, "internal_leakage", 0.1 * seed, 10.0, 20.0) for seed in (1, 2, 3)]
    ran: list[int] = []

    def counted(plan: Plan) -> Trial:
        ran.append(plan.seed)
        return made_up(plan)

    first = trials(plans[:2], tmp_path, 1, counted)
    file = next(tmp_path.iterdir())
    file.write_text(file.read_text() + '{"plan": {"se')  # as a kill leaves it
    again = trials(plans, tmp_path, 1, counted)
    assert trials(plans, tmp_path, 1, counted) == again
    assert ran == [1, 2, 3]
    assert again[:2] == first
    assert again == [made_up(plan) for plan in plans]


@pytest.mark.parametrize("seed", [100_035, 100_057])
def test_a_drop_of_an_unmeasured_supply_that_resembles_an_internal_leak_is_not_called_one(
    seed: int,
) -> None:
    """On these drawn rigs an internal leak explains more of both accounts than the drop does."""
    plan = next(plan for plan in plans(500) if plan.seed == seed)
    assert not plan.supply_sensor
    judgement = judged(record(plan)[0], "product")
    assert judgement.verdict == "unknown_fault"
    assert not {verdict for _, verdict in judgement.held} & {*LEAKS, "multiple"}
