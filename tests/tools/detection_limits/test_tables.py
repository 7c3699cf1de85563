"""The tables on the limits of detection count every leak."""

from tools.detection_limits.study import NAMES, ONSET_S, SECONDS, SIZES
from tools.detection_limits.tables import outcomes
from tools.studies.leak_trials import Judgement, Plan, Trial


def leak(flow: float) -> Trial:
    plan = Plan(1, "internal_leakage", SIZES[1], ONSET_S, SECONDS, judges=tuple(NAMES))
    held = ((0.5, "healthy"), (ONSET_S + 2.0, "internal_leakage"))
    return Trial(plan, False, flow, dict.fromkeys(NAMES, Judgement(held, (0.0,), flow, 0.01)))


def test_a_leak_that_passes_more_than_was_planned_is_counted_too() -> None:
    last = outcomes([leak(0.3), leak(1.2 * SIZES[1])]).splitlines()[-1]
    assert last.startswith("| 0.2 and more | 2 | 2 | 2 | 2.0 / 2.0 s |")
