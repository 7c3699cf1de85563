"""Any figure that a criterion may name may be a limit; where it cannot act, it is refused."""

from pathlib import Path

import pytest

from rig.configuration import load_campaign
from rig.configuration.campaigns.criteria import FIGURE_UNITS
from rig.configuration.campaigns.dry_run import plan_campaign
from rig.configuration.campaigns.foreseen import figure_warnings
from tests.rig.configuration.campaigns.test_limits import limit, problems_of_segments
from tests.rig.configuration.campaigns.written import only_test, problems_of

STEPS = "{type: steps, levels: [0.2 m, 0.4 m], hold: 20 s}"


@pytest.mark.parametrize(
    ("keys", "each", "over_s"),
    [
        ("figure: overshoot, high: 5 %", "step", 0.0),
        ("figure: settling, high: 2 s, each: step", "step", 0.0),
        ("figure: friction_coulomb, high: 900 N", "test", 0.0),
        ("figure: friction_stribeck_velocity, high: 0.1 m/s, each: test", "test", 0.0),
        ("figure: rms_error, high: 5 mm, each: test", "test", 0.0),
        ("figure: leak, high: 1 L/min, each: test", "test", 0.0),
        ("figure: loop_missed, high: 1 %, over: 1 s", "", 1.0),
        ("figure: loop_wakeup_p99, high: 0.2 ms", "", 10.0),
        ("figure: loop_command_p99, high: 0.2 ms, each: test", "test", 0.0),
    ],
)
def test_a_figure_is_judged_over_what_it_is_a_figure_of(
    tmp_path: Path, keys: str, each: str, over_s: float
) -> None:
    (read,) = only_test(tmp_path, limit(f"{keys}, action: warn"), STEPS).limits
    assert (read.each, read.over_s) == (each, over_s)


def test_every_figure_of_a_criterion_may_be_a_limit(tmp_path: Path) -> None:
    units = {"m": "mm", "": "%", "s": "s", "m^3/s": "L/min", "Pa": "Pa"}
    limits = [
        f"  - {{figure: {name}, high: 5 {'mm' if name in ('peak', 'valley') else units[unit]}}}"
        for name, unit in FIGURE_UNITS.items()
    ]
    text = "\n".join(["limits:", *limits])
    assert len(only_test(tmp_path, text, STEPS).limits) == len(FIGURE_UNITS)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            "figure: settling, high: 2 s",
            "figure: settling can never act: the test has no step, a jump by more than 1 mm in a "
            "tick; leave it out, or limit following_error_m",
        ),
        ("figure: overshoot, high: 5 %, each: cycle", "is a figure of a step alone; write `each"),
        ("figure: friction_coulomb, high: 1 N, each: segment", "is a figure of a test alone"),
        ("figure: friction_colomb, high: 1 N", "is no known figure"),
        ("figure: setling, high: 2 s", "did you mean settling?"),
        ("figure: rms_error, high: 1 mm, each: step", "is no figure of a step; write one of over"),
        ("figure: rms_error, high: 1 mm, each: cycle, for: 1 s", "one value for each cycle; leave"),
        ("figure: rms_error, high: 1 mm, each: cycle, over: 1 s", "leave `over` out"),
        ("figure: rms_error, high: 1 mm, each: test, hysteresis: 0.1 mm", "leave `hysteresis` out"),
        ("figure: rms_error, high: 1 mm, each: segment", "the test has no segments; write `each"),
        ("channel: position_m, high: 0.5 m, each: cycle", "has a value at each sample, and is"),
        ("figure: rms_error, high: 1 mm, each: turn", "choose one of step, cycle, segment, test"),
        ("figure: rms_error, high: 1 V, each: test", "is not a length"),
        ("figure: loop_missed, high: 5", "is beyond 1, and loop_missed is the share of the ticks"),
        ("figure: loop_missed, low: 200 %", "give a share, such as 0.1 % for one tick in 1000"),
    ],
)
def test_what_can_never_act_is_refused_with_line_and_remedy(
    tmp_path: Path, keys: str, said: str
) -> None:
    found = "\n".join(problems_of(tmp_path, limit(keys)))
    assert said in found
    assert found.startswith("campaign.yaml:8")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("each: cycle", "each: cycle can never act: the test has no whole cycle of a setpoint"),
        ("each: cycle, during: a", "the segment a has no whole cycle"),
        ("each: test, during: a", "leave `during` out, or write `each: segment`"),
    ],
)
def test_stretches_that_the_segments_do_not_have_are_refused(
    tmp_path: Path, keys: str, said: str
) -> None:
    (problem,) = problems_of_segments(tmp_path, f"figure: peak_error, high: 1 mm, {keys}")
    assert said in problem
    assert problem.startswith("campaign.yaml:11")


@pytest.mark.parametrize("each", ["", ", each: segment", ", each: test"])
def test_friction_during_a_segment_is_refused_with_the_remedy_that_helps(
    tmp_path: Path, each: str
) -> None:
    keys = f"figure: friction_coulomb, high: 900 N, during: a{each}"
    for problem in problems_of_segments(tmp_path, keys):
        assert "write `each: segment`" not in problem
        assert "`during` out" in problem


def test_an_overshoot_is_never_below_0(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, limit("figure: overshoot, high: -1 %"), STEPS)
    assert "high: -1 % is below 0, and overshoot never is; give 0 or more" in problem


def test_an_open_loop_has_no_steps_to_settle(tmp_path: Path) -> None:
    volts = "{type: steps, levels: [0 V, 1 V], hold: 5 s}"
    (problem,) = problems_of(tmp_path, limit("figure: settling, high: 1 s"), volts)
    assert "figure: settling compares with a setpoint in m, and this test has none" in problem


def test_rig_check_lists_what_each_figure_is_of(tmp_path: Path) -> None:
    keys = "figure: overshoot, inner_high: 3 %, high: 5 %, action: hold"
    only_test(tmp_path, limit(keys), STEPS)
    (plan,) = plan_campaign(*load_campaign(tmp_path / "campaign.yaml"))
    assert "  limit overshoot of each step: warn above 3 %, hold above 5 %" in plan.lines()


def test_figures_that_a_rig_or_a_filter_never_tells_are_warned_of(tmp_path: Path) -> None:
    text = """\
limits:
  - {figure: loop_missed, high: 1 %}
  - {figure: friction_coulomb, high: 900 N}
"""
    test = only_test(tmp_path, text)
    _, rig = load_campaign(tmp_path / "campaign.yaml")
    (simulated,) = figure_warnings(test, rig, "product")
    assert "loop_missed is not judged here" in simulated
    _, friction = figure_warnings(test, rig, "thesis-6")
    assert "friction_coulomb is never judged" in friction
