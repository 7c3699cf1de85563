"""What came of criteria and limits is told as shares, by case, motion and band."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from faults import Criterion, TestLimit
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from rig.report.sweep.asked_words import asked_lines, figures_in_words, motions_in_words
from rig.sweep.asked_study import AskedStudy, FigureStudy, _quantiles, study_of_asked

RMS = Criterion("rms_error", -inf, 3e-3, "m")
SETTLING = Criterion("settling", -inf, 1.0, "s")
LIMIT = TestLimit("following_error_m", "m", high=5e-3, inner_high=1e-3, action="ramp_down")


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    base = load_sweep("leaks", Path(__file__).parent)
    sine, _, steps = base.motions
    return replace(
        base,
        motions=(
            replace(sine, criteria=(RMS,), limits=(LIMIT,)),
            replace(steps, criteria=(RMS, SETTLING)),
        ),
    )


def studied(sweep: Sweep) -> AskedStudy:
    columns: dict[str, Sequence[object]] = {
        "motion": ["sine", "sine", "steps", "steps"],
        "figure_rms_error": [1e-3, 4e-3, 2e-3, 1e-2],
        "met_rms_error": [1.0, 0.0, 1.0, 0.0],
        "figure_settling": [nan, nan, 0.5, inf],
        "met_settling": [nan, nan, 1.0, 0.0],
        "inner_following_error_m": [2.0, 1.0, nan, nan],
        "outer_following_error_m": [0.0, 1.0, nan, nan],
        "limit_passed": ["", "following_error_m above 5 mm: ramp_down", "", ""],
        "limit_at_s": [nan, 7.5, nan, nan],
        "passed": [1.0, 0.0, 1.0, 0.0],
    }
    table = pa.table({name: pa.array(list(values)) for name, values in columns.items()})
    study = study_of_asked(sweep, table)
    assert study is not None
    return study


def test_a_criterion_of_all_motions_and_one_of_a_single_motion_have_their_own_cases(
    sweep: Sweep,
) -> None:
    rms, settling = studied(sweep).criteria
    assert (rms.motion, rms.met.count, rms.met.of) == ("", 2, 4)
    assert (settling.motion, settling.met.count, settling.met.of) == ("steps", 1, 2)


def test_bands_are_counted_by_case_and_by_passing(sweep: Sweep) -> None:
    study = studied(sweep)
    (limit,) = study.limits
    assert limit.outer is not None
    assert limit.inner is not None
    assert (limit.outer.count, limit.outer.of, limit.outer_times) == (1, 2, 1)
    assert (limit.inner.count, limit.inner_times) == (2, 3)
    assert study.ended is not None
    assert (study.ended.count, study.ended.of, study.ended_at_s) == (1, 2, 7.5)


def test_figures_have_quantiles_and_never_settling_is_the_greatest(sweep: Sweep) -> None:
    rms, settling = studied(sweep).figures
    assert rms.median == pytest.approx(3e-3)
    assert (settling.cases, settling.infinite, settling.greatest) == (2, 1, inf)
    plain = studied(sweep).plain()
    assert plain["figures"][1]["greatest"] is None
    assert plain["passed"]["count"] == 2
    assert (
        plain["criteria"][0]["met"]["interval"][0] < 0.5 < plain["criteria"][0]["met"]["part"] + 1
    )


def test_the_terminal_says_all_of_it(sweep: Sweep) -> None:
    said = "\n".join(asked_lines(studied(sweep)))
    for words in (
        "passed, by their criteria and limits: 2 of 4",
        "rms_error at most 3 mm: met by 2 of 4",
        "settling at most 1 s (steps): met by 1 of 2",
        "limit following_error_m: warn above 1 mm, ramp down above 5 mm (sine): exceeded in 1 of 2",
        "inner band: 2 of 2 (34.2 to 100.0 %), 3 times",
        "settling of 2 cases (never in 1): median never, 95 % never, greatest never",
    ):
        assert words in said, (words, said)


@pytest.mark.parametrize(
    ("values", "median", "p95"),
    [
        ([1.0, 2.0, 4.0], 2.0, 3.8),
        ([*[0.9] * 28, *[inf] * 14], 0.9, inf),
        ([inf, inf], inf, inf),
        ([-inf, -inf, 1.0], -inf, 1.0),
        ([-inf, 1.0], 1.0, 1.0),
        ([-inf, inf], inf, inf),
        ([1.0, inf, 3.0], 3.0, inf),
    ],
)
def test_quantiles_are_over_all_cases_and_infinite_ones_are_the_last(
    values: list[float], median: float, p95: float
) -> None:
    assert _quantiles(np.array(values), [50.0, 95.0]) == pytest.approx([median, p95])


def test_a_figure_without_bound_is_not_called_never_or_not_known(sweep: Sweep) -> None:
    figure = FigureStudy("div", "div", "m", 4, -inf, inf, inf, 1, 2)
    study = replace(studied(sweep), figures=(figure,))
    assert figures_in_words(study) == [
        ("div", 4, "without bound in 1, below any bound in 2",
         "below any bound", "without bound", "without bound"),
    ]  # fmt: skip
    (told,) = study.plain()["figures"]
    assert (told["median"], told["infinite"], told["minus_infinite"]) == (None, 1, 2)


def test_two_criteria_of_one_figure_are_told_from_columns_of_their_own(sweep: Sweep) -> None:
    loose = replace(RMS, high=0.3)
    motion = replace(sweep.motions[0], criteria=(RMS, loose), limits=(LIMIT,))
    twice = replace(sweep, motions=(motion,))
    table = pa.table(
        {
            "motion": ["sine", "sine"],
            "figure_rms_error": [1e-3, 4e-3],
            "met_rms_error_at_most_3_mm": [1.0, 0.0],
            "met_rms_error_at_most_0.3_m": [1.0, 1.0],
            "inner_following_error_m": [0.0, 0.0],
            "outer_following_error_m": [0.0, 0.0],
            "limit_at_s": [nan, nan],
            "passed": [1.0, 0.0],
        }
    )
    study = study_of_asked(twice, table)
    assert study is not None
    assert [each.met.count for each in study.criteria] == [1, 2]


def test_a_sweep_that_asks_nothing_has_no_such_study() -> None:
    plain = load_sweep("leaks", Path(__file__).parent)
    assert study_of_asked(plain, pa.table({"motion": ["sine"]})) is None


def test_motions_are_named_with_their_control(sweep: Sweep) -> None:
    law = replace(sweep.control, feedforward="model", integral_time=0.5)
    opened = replace(sweep.motions[0], name="open", quantity="command")
    found = list(motions_in_words(replace(sweep, control=law, motions=(*sweep.motions, opened))))
    assert found[0].gain == "50 V/m"
    assert found[0].control == "feedforward model, integral_time 0.5 s"
    assert found[2].control == "the valve's command itself"
    assert np.isclose(float(found[0].share.removesuffix(" %")), 40.0)
    assert next(motions_in_words(sweep)).control == "nothing: gain times error alone"
