"""A baseline's file that was changed, or that holds nonsense, is refused with what is wrong."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.accounts.nuisances import UNINFORMED
from estimator.baselines.baseline import PATTERN_FILTERS, Accepted, Baseline, BaselineError
from estimator.baselines.baseline_file import baseline_doubt, load_baseline, write_baseline
from estimator.leaks.pattern import HealthyLevel
from rig.plant import Model
from tests.estimator.learnt.made_up import noise

Content = dict[str, Any]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the file of a baseline that was learnt on once."""
    level = HealthyLevel(np.full(2, 3e4), np.full(2, 1e3), 10)
    levels = dict.fromkeys(PATTERN_FILTERS, level)
    first = Baseline(UNINFORMED, levels, {"one": "0"}, "nominal", noise=noise())
    accepted = (Accepted({"two": "1"}, (0.0, 0.001, 0.002)),)
    baseline = Baseline(
        UNINFORMED, levels, {}, "nominal", noise=noise(), commissioning=first, accepted=accepted
    )
    write_baseline(baseline, tmp_path / "rig.json")
    return tmp_path / "rig.json"


def problems(path: Path, change: Callable[[Content], object], *, old: bool) -> list[str]:
    """Return why a changed file is refused; an old file has no checksum."""
    content = json.loads(path.read_text())
    if old:
        del content["content_sha256"]
        content["baseline_version"] = 1
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(BaselineError) as caught:
        load_baseline(path, Model())
    return caught.value.problems


def test_a_file_that_was_changed_is_refused_with_the_remedy(path: Path) -> None:
    def moved(content: Content) -> None:
        content["tolerance_mean"][20] += 3.0

    (problem,) = problems(path, moved, old=False)
    assert problem == (
        f"{path}: not a baseline: content_sha256: the file was changed after it was written; "
        "make it anew with rig baseline"
    )


def test_indents_and_the_order_of_keys_do_not_count(path: Path) -> None:
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items())), indent=3))
    assert load_baseline(path, Model()).model == "nominal"


def test_a_file_from_before_checksums_is_read_and_said_to_be_unchecked(path: Path) -> None:
    assert baseline_doubt(path, load_baseline(path, Model())) == ""
    content = json.loads(path.read_text())
    del content["content_sha256"]
    content["baseline_version"] = 1
    path.write_text(json.dumps(content))
    loaded = load_baseline(path, Model())
    assert loaded.accepted[0].hidden == (0.0, 0.001, 0.002)
    assert baseline_doubt(path, loaded).startswith(f"{path}: has no checksum")


def test_a_file_whose_checksum_was_taken_out_is_refused(path: Path) -> None:
    (problem,) = problems(path, lambda content: content.pop("content_sha256"), old=False)
    assert problem == (
        f"{path}: not a baseline: content_sha256: there is no such key in it, and each file of "
        "version 2 is written with it: the file was changed; make it anew with rig baseline"
    )


def test_a_checksum_that_is_there_is_checked_in_every_version(path: Path) -> None:
    def older(content: Content) -> None:
        content["baseline_version"] = 1

    (problem,) = problems(path, older, old=False)
    assert "content_sha256: the file was changed after it was written" in problem


def sets(*place: str | int, to: object) -> Callable[[Content], object]:
    """Return a function that sets the value at a place of a file's content."""

    def change(content: Any) -> None:
        for key in place[:-1]:
            content = content[key]
        content[place[-1]] = to

    return change


COVARIANCE = "tolerance_covariance"
LEVEL = ("innovation_levels_Pa", "thesis-6")
NULL = ("nuisances", "spool_null_bias")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (sets("tolerance_mean", to=[1e150] * 23), "mean[0]: 1e+150 is outside -100 to 100 (and 22"),
        (sets("tolerance_mean", 3, to=float("nan")), "tolerance_mean[3]: nan is not finite"),
        (sets("tolerance_mean", 3, to=10**60), "mean[3]: a number of more than 30 digits is"),
        (sets("tolerance_mean", 3, to="1"), "tolerance_mean[3]: '1' is no number"),
        (sets("tolerance_mean", 3, to=True), "tolerance_mean[3]: True is no number"),
        (sets(COVARIANCE, 1, 2, to=0.5), f"{COVARIANCE}[1][2]: differs from [2][1]"),
        (sets(COVARIANCE, 1, 1, to=-1.0), f"{COVARIANCE}[1][1]: the variance -1 is not above 0"),
        (sets(COVARIANCE, 0, to=[float("inf")] * 23), "[0][0]: inf is not finite (and 22 more"),
        (sets(*LEVEL, "deviation", to=[1e3, -1.0]), "deviation[1]: -1.0 is outside above 0"),
        (sets(*LEVEL, "deviation", to=[1e3, 0.0]), "deviation[1]: 0.0 is outside above 0"),
        (sets(*LEVEL, "looks", to=0), "thesis-6: looks: 0 is outside 8"),
        (sets(*LEVEL, "looks", to=8.5), "thesis-6: looks: 8.5 is no whole number"),
        (sets(*NULL, "unit", to="mm"), "spool_null_bias: unit: 'mm' is not 'm'"),
        (sets(*NULL, "deviation", to=-1e-6), "spool_null_bias: deviation: -1e-06 is outside"),
        (sets("oil", to=1), "oil: is an unknown key"),
        (sets("noise", "peaks", "more", to=1), "noise: peaks: more: is an unknown key"),
        (sets("noise", "peaks", "count", to=10**60), "noise: peaks: count: a number of more"),
        (sets("noise", "peaks", "hours", to=0.0), "noise: peaks: hours: 0 is outside"),
        (
            sets("accepted", 0, "recordings", to=[1]),
            "accepted[0]: recordings: [1] is no JSON object",
        ),
        (sets("commissioning", "tolerance_mean", 0, to=1e9), "commissioning: tolerance_mean[0]"),
        (sets("commissioning", to=3), "commissioning: 3 is no JSON object"),
    ],
)
def test_nonsense_in_a_file_without_a_checksum_is_refused(
    path: Path, change: Callable[[Content], object], says: str
) -> None:
    (problem,) = problems(path, change, old=True)
    assert says in problem
    assert problem.startswith(f"{path}: ")


def test_a_covariance_that_is_none_is_refused(path: Path) -> None:
    def change(content: Content) -> None:
        content[COVARIANCE][0][1] = content[COVARIANCE][1][0] = 2.0

    (problem,) = problems(path, change, old=True)
    assert "tolerance_covariance: is not positive definite" in problem


def test_all_problems_are_told_at_once(path: Path) -> None:
    def change(content: Content) -> None:
        sets("tolerance_mean", 3, to=float("nan"))(content)
        sets(*NULL, "unit", to="mm")(content)
        sets("oil", to=1)(content)

    assert len(problems(path, change, old=True)) == 3
