"""No column of a sweep's table means two things."""

from math import inf
from pathlib import Path

import pytest

from faults import Criterion
from rig.configuration.sweeps.asked_columns import figures_judged_twice, met_column
from tests.rig.configuration.sweeps.test_asked_sweeps import SEGMENTED, read
from tests.rig.configuration.sweeps.test_sweep_files import problems_of

RMS = "  - {figure: rms_error, at_most: 3 mm}\n"
SPAN = "  span: {expression: span(position_m), unit: m}\n"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (SPAN, SPAN + "  rms error: {expression: max(position_m), unit: m}\n",
         "sweep.yaml:15:6 figure: rms_error makes the column figure_rms_error of the table, as the "
         "sweep's own figure rms error of line 13 does; rename one of them"),
        (SPAN, "  a b: {expression: max(position_m), unit: m}\n"
         "  a_b: {expression: min(position_m), unit: m}\n" + SPAN,
         "sweep.yaml:13:3 a_b: the sweep's own figure a_b makes the column figure_a_b of the "
         "table, as the sweep's own figure a b of line 12 does"),
        (SPAN, SPAN + "  overshoot in up: {expression: max(position_m), unit: m}\n",
         "overshoot in up makes the column figure_overshoot_in_up"),
        (RMS, RMS + "  - {figure: rms_error, at_most: 3.00001 mm}\n",
         "sweep.yaml:15:6 figure: rms_error at most 3 mm makes the column "
         "met_rms_error_at_most_3_mm of the table, as rms_error at most 3 mm of line 14 does; "
         "leave one of them out"),
    ],
)  # fmt: skip
def test_figures_whose_names_make_one_column_are_refused_with_both_names(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    found = problems_of(tmp_path, SEGMENTED.replace(old, new, 1))
    assert says in found, found
    assert len(found.splitlines()) == 1, found


def test_segments_and_limits_whose_names_make_one_column_are_refused(tmp_path: Path) -> None:
    span = "{figure: span, at_least: 0 mm, during: a_b}"
    text = (
        SEGMENTED.replace("name: sine,", "name: a b,")
        .replace("during: sine", "during: a b")
        .replace("name: rest,", "name: a_b,")
        .replace("    limits:\n", f"      - {span}\n    limits:\n")
        .replace("limits:\n      -", "limits:\n      - {channel: following_error_m, high: 9 mm, "
                 "during: a_b}\n      -")
    )  # fmt: skip
    found = problems_of(tmp_path, text)
    assert "span in a_b makes the column figure_span_in_a_b of the table, as span in a b" in found
    assert "following_error_m in a b makes the column outer_following_error_m_in_a_b" in found
    assert len(found.splitlines()) == 2, found


def test_a_sweep_without_such_a_pair_is_read(tmp_path: Path) -> None:
    sweep = read(tmp_path, SEGMENTED.replace(RMS, RMS + RMS.replace("3 mm", "300 mm")))
    twice = figures_judged_twice(each.criteria for each in sweep.motions)
    assert twice == {"rms_error"}
    names = [met_column(each, twice) for each in sweep.motions[1].criteria]
    assert names == ["met_rms_error_at_most_3_mm", "met_rms_error_at_most_0.3_m",
                     "met_latency", "met_leak"]  # fmt: skip


def test_a_figure_with_one_criterion_in_each_motion_keeps_its_column() -> None:
    strict, loose = (Criterion("rms_error", -inf, end, "m") for end in (3e-3, 5e-3))
    assert figures_judged_twice([[strict], [loose], [strict, strict]]) == frozenset()
    assert met_column(strict, frozenset()) == "met_rms_error"


def test_a_limit_given_twice_is_refused_at_its_own_line(tmp_path: Path) -> None:
    line = "  - {figure: rms_error, over: 5 s, high: 5 mm, action: warn}\n"
    found = problems_of(tmp_path, SEGMENTED.replace(line, line + line.replace("5 s", "2 s")))
    number = SEGMENTED.count("\n") + 1
    assert f"sweep.yaml:{number}:6 limits: watches rms_error, as another limit of" in found
    assert f"does, that of line {number - 1};" in found
