"""A sweep that cannot be resumed is told what of it was changed."""

from dataclasses import replace
from math import inf
from pathlib import Path

from faults import Criterion, TestLimit
from rig.configuration.sweeps.distributions import Distribution
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep, SweptMotion
from rig.sweep.changes import changes

SWEEP = load_sweep("leaks", Path(__file__).parent)
RMS = Criterion("rms_error", -inf, 3e-3, "m")


def changed(now: Sweep, before: Sweep = SWEEP) -> list[str]:
    return list(changes(before.meaning, now.meaning))


def everywhere(sweep: Sweep, **changed: object) -> Sweep:
    return replace(sweep, motions=tuple(_with(each, changed) for each in sweep.motions))


def _with(motion: SweptMotion, changed: dict[str, object]) -> SweptMotion:
    return replace(motion, **changed)  # type: ignore[arg-type]


def test_a_criterion_of_all_motions_is_named_and_not_the_motions() -> None:
    asked = everywhere(SWEEP, criteria=(RMS,))
    assert changed(asked) == ["criteria on rms_error"]
    assert changed(SWEEP, asked) == ["criteria on rms_error"]
    assert changed(everywhere(SWEEP, criteria=(replace(RMS, high=1e-3),)), asked) == [
        "criteria on rms_error"
    ]


def test_what_differs_in_one_motion_is_named_with_it() -> None:
    first, *rest = SWEEP.motions
    limit = TestLimit("following_error_m", "m", high=5e-3)
    values = {**first.values, "amplitude": (Distribution("fixed", (0.01,)),)}
    mine = replace(SWEEP, motions=(replace(first, limits=(limit,), values=values), *rest), seed=9)
    assert set(changed(mine)) == {
        "seed",
        f"amplitude of the motion {first.name}",
        f"limits on following_error_m of the motion {first.name}",
    }


def test_motions_that_come_or_go_and_settings_left_out_are_named() -> None:
    assert changed(replace(SWEEP, motions=SWEEP.motions[1:])) == [
        "the names or the order of motions"
    ]
    controlled = replace(SWEEP, control=replace(SWEEP.control, integral_time=1.0))
    assert changed(SWEEP, controlled) == ["control"]
