"""What is asked of a case becomes columns of the table."""

from math import inf, isnan, nan

import numpy as np
import pytest

from faults import Criterion, Expression, OwnFigure, TestLimit
from rig.sweep.asked import Asked, Known, columns_told, judged_case, readings_kept

TIME_S = np.arange(10_001) * 1e-3
SETPOINT = np.where(TIME_S < 2.0, 0.3, 0.4)
POSITION = np.where(TIME_S < 2.5, 0.3, np.where(TIME_S < 4.0, 0.41, 0.4))
HEALTHY = Known(nan, nan, leaky=False)
ASKED = Asked(
    own=(OwnFigure("span", Expression("span(position_m)"), "m"),),
    criteria=(
        Criterion("peak_error", -inf, 0.05, "m"),
        Criterion("overshoot", -inf, 0.2, ""),
        Criterion("peak_error", -inf, 0.02, "m", from_s=3.0),
        Criterion("latency", -inf, 5.0, "s"),
        Criterion("leak", 1e-6, inf, "m^3/s"),
    ),
    limits=(
        TestLimit("following_error_m", "m", high=0.05, inner_high=0.005, action="ramp_down"),
        TestLimit("peak of pressure_1_Pa", "Pa", high=1e6, action="warn", over_s=1.0,
                  expression=Expression("max(pressure_1_Pa)")),
    ),
)  # fmt: skip


def judged(known: Known) -> dict[str, float | str]:
    readings = {"position_m": POSITION, "pressure_1_Pa": np.full(TIME_S.size, 2e6)}
    return judged_case(ASKED, readings, SETPOINT, known)


def test_figures_are_kept_and_compared_with_what_was_asked() -> None:
    found = judged(HEALTHY)
    assert found["figure_span"] == pytest.approx(0.11)
    assert found["figure_peak_error"] == pytest.approx(0.1)
    assert found["figure_peak_error_from_3_s"] == pytest.approx(0.01)
    assert found["figure_overshoot"] == pytest.approx(0.1)
    assert (found["met_peak_error"], found["met_overshoot"]) == (0.0, 1.0)
    assert found["met_peak_error_from_3_s"] == 1.0
    assert found["passed"] == 0.0


def test_what_only_a_leak_gives_is_not_asked_of_a_healthy_case() -> None:
    assert not {"met_latency", "met_leak", "figure_latency"} & set(judged(HEALTHY))
    missed = judged(Known(nan, nan, leaky=True))
    assert (missed["met_latency"], missed["met_leak"]) == (0.0, 0.0)
    named = judged(Known(2e-6, 3.0, leaky=True))
    assert (named["figure_latency"], named["met_latency"], named["met_leak"]) == (3.0, 1.0, 1.0)


def test_a_case_is_marked_with_the_limit_at_which_a_test_would_have_ended() -> None:
    found = judged(HEALTHY)
    assert found["limit_passed"] == "following_error_m above 50 mm: ramp_down"
    assert found["limit_at_s"] == pytest.approx(2.0)
    assert found["outer_following_error_m"] == 1.0
    assert found["inner_following_error_m"] == 1.0
    # A warning is counted, and ends nothing.
    assert found["outer_peak_of_pressure_1_Pa"] == 1.0
    kept = judged_case(ASKED, {"position_m": SETPOINT}, SETPOINT, HEALTHY)
    assert kept["limit_passed"] == ""
    assert isnan(float(kept["limit_at_s"]))
    assert kept["passed"] == 1.0


def test_every_column_is_told_and_only_readings_that_are_needed_are_kept() -> None:
    told = columns_told([ASKED])
    assert set(judged(Known(2e-6, 3.0, leaky=True))) == set(told)
    assert told["figure_peak_error"][0] == "m"
    assert readings_kept([ASKED]) == ("position_m", "pressure_1_Pa")
    assert readings_kept([Asked()]) == ()
    assert columns_told([Asked()]) == {}


def test_two_criteria_of_one_figure_have_a_column_each() -> None:
    strict, loose = (Criterion("peak_error", -inf, end, "m") for end in (0.05, 0.3))
    asked = Asked(criteria=(strict, loose), judged_twice=frozenset({"peak_error"}))
    found = judged_case(asked, {"position_m": POSITION}, SETPOINT, HEALTHY)
    assert found["met_peak_error_at_most_50_mm"] == 0.0
    assert found["met_peak_error_at_most_0.3_m"] == 1.0
    assert found["passed"] == 0.0
    assert set(columns_told([asked])) == set(found)


def test_a_case_in_open_loop_is_judged_by_its_channels() -> None:
    asked = Asked(
        criteria=(Criterion("peak", -inf, 0.5, "m", channel="position_m"),), quantity="command"
    )
    found = judged_case(asked, {"position_m": POSITION}, SETPOINT, HEALTHY)
    assert found == {
        "figure_peak_of_position_m": 0.41,
        "met_peak_of_position_m": 1.0,
        "passed": 1.0,
    }
