"""A test has no more limits than the supervisor can judge in time."""

from pathlib import Path

from tests.rig.configuration.campaigns.written import only_test, problems_of


def limits(number: int, over: str) -> str:
    one = f"  - {{figure: rms_error, high: 5 mm, over: {over}, action: warn}}"
    return "\n".join(["limits:", *([one] * number)])


def test_a_hundred_limits_are_read_and_one_more_is_refused(tmp_path: Path) -> None:
    assert len(only_test(tmp_path, limits(100, "1 s")).limits) == 100
    (problem,) = problems_of(tmp_path, limits(101, "1 s"))
    assert problem == (
        "campaign.yaml:7:5 limits: has 101 limits, and 100 can be judged in time; leave out those "
        "that matter least, or give them to another test"
    )


def test_limits_look_back_over_500_s_together(tmp_path: Path) -> None:
    assert only_test(tmp_path, limits(20, "25 s")).limits
    (problem,) = problems_of(tmp_path, limits(21, "25 s"))
    assert "looks back over 525 s in all limits together, and 500 s can be judged" in problem
    assert "give shorter `over`" in problem
