"""A limit that can never act, or always acts, is refused with line, value, limit and remedy."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from tests.rig.configuration.campaigns.written import HEAD, load, only_test, problems_of

SEGMENTS = """\
tests:
  - name: t
    start_position: 0.3 m
    segments:
      - {name: a, hold: 8 s}
      - {name: b, hold: 12 s}
      - {name: a, hold: 8 s}
    limits:
      - {LIMIT}
"""


def limit(keys: str) -> str:
    return f"limits:\n  - {{{keys}}}"


def problems_of_segments(folder: Path, keys: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(folder, HEAD + SEGMENTS.replace("LIMIT", keys))
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]


def test_a_figure_that_looks_back_over_more_than_its_segment_is_refused(tmp_path: Path) -> None:
    (problem,) = problems_of_segments(tmp_path, "figure: rms_error, high: 1 mm, during: a")
    assert problem == (
        "campaign.yaml:11:9 over: rms_error can never act: it looks back `over` 10 s, which is "
        "the default, and the segment a lasts 8 s at most; "
        "give an `over` below 8 s, or let the segment a last longer"
    )


@pytest.mark.parametrize("keys", ["over: 8 s", "over: 5 s, for: 4 s", "over: 8.5 s, for: 1 s"])
def test_time_to_look_back_and_to_last_must_fit_into_the_segment(tmp_path: Path, keys: str) -> None:
    (problem,) = problems_of_segments(tmp_path, f"figure: rms_error, high: 1 mm, during: a, {keys}")
    assert "can never act" in problem
    assert "the segment a lasts 8 s at most" in problem


@pytest.mark.parametrize("keys", ["over: 7.9 s", "over: 5 s, for: 3 s"])
def test_a_limit_whose_times_fit_into_its_segment_is_taken(tmp_path: Path, keys: str) -> None:
    text = SEGMENTS.replace("LIMIT", f"figure: rms_error, high: 1 mm, during: a, {keys}")
    (test,) = load(tmp_path, HEAD + text).tests
    assert test.limits[0].windows_s == ((0.0, 8.0), (20.0, 28.0))


def test_a_figure_that_looks_back_over_more_than_the_test_is_refused(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, limit("figure: rms_error, high: 1 mm, over: 50 s"))
    assert "over: rms_error can never act: it looks back `over` 50 s, and the test lasts 40 s" in (
        problem
    )
    assert problem.endswith("give an `over` below 40 s, or let the test last longer")


def test_a_channel_that_must_be_beyond_for_longer_than_the_test_is_refused(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, limit("channel: load_N, high: 5 kN, for: 41 s"))
    assert "for: load_N can never act: it needs `for` 41 s, and the test lasts 40 s" in problem
    assert only_test(tmp_path, limit("channel: load_N, high: 5 kN, for: 40 s")).limits


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("channel: following_error_m, high: -3 mm", "high: -3 mm is below 0"),
        ("figure: rms_error, high: 5 mm, inner_high: -3 mm", "inner_high: -3 mm is below 0"),
        ("figure: peak_error, high: -1 mm", "high: -1 mm is below 0"),
        ("channel: following_error_m, low: -3 mm", "low: -3 mm can never act"),
    ],
)
def test_a_distance_is_never_below_0(tmp_path: Path, keys: str, words: str) -> None:
    (problem,) = problems_of(tmp_path, limit(keys))
    assert problem.startswith("campaign.yaml:8")
    assert words in problem
    assert "counts in both directions" in problem


def test_other_channels_may_have_limits_below_0(tmp_path: Path) -> None:
    assert only_test(tmp_path, limit("channel: load_N, high: -3 kN")).limits


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
