"""Expressions of campaign files are computed, and nothing else is."""

import pickle
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, strategies as st

from faults.expressions import LONGEST, Expression, ExpressionError

COLUMNS = {"x_m": np.array([1.0, -2.0, np.nan, 4.0]), "y_m": np.array([1.0, 1.0, 1.0, 2.0])}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("max(abs(x_m - y_m))", 3.0),
        ("min(x_m)", -2.0),
        ("mean(x_m) * 2 + 1", 3.0),
        ("rms(y_m)", np.sqrt(7.0 / 4.0)),
        ("span(x_m)", 6.0),
        ("first(x_m) - last(x_m)", -3.0),
        ("median(y_m) ** 2", 1.0),
        ("percentile(y_m, 100)", 2.0),
        ("-std(y_m - y_m)", 0.0),
        ("missing(x_m) + missing(y_m)", 0.25),
    ],
)
def test_a_figure_is_one_number_of_all_samples_that_are_known(text: str, value: float) -> None:
    expression = Expression(text)
    assert expression.is_number
    assert expression.of(COLUMNS) == pytest.approx(value)


def test_a_quantity_has_a_value_at_each_sample() -> None:
    expression = Expression("sqrt(abs(x_m)) + y_m")
    assert (expression.is_number, expression.channels) == (False, ("x_m", "y_m"))
    assert expression.of(COLUMNS)[[0, 3]].tolist() == [2.0, 4.0]


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')", "x_m.__class__", "(lambda: 1)()", "[x_m]", "x_m[0]",
        "x_m if 1 else 2", "x_m and y_m", "x_m < 1", "'a' * 9", "f'{x_m}'", "open(x_m)", "x_m := 1",
        "abs(x_m, y_m)", "abs(x=x_m)", "max(*x_m)", "max(3)", "max(max(x_m))", "percentile(x_m)",
        "percentile(x_m, 101)", "percentile(x_m, y_m)", "", "1 +", "True", "1j", "x_m; y_m", "~x_m",
        "x_m @ y_m", "x_m // 2", "x_m % 2", "{1}", "(" * 300, "-" * 99 + "x_m", "a" * (LONGEST + 1),
        "\x00",
    ],
)  # fmt: skip
def test_everything_else_is_refused_with_a_remedy(text: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        Expression(text)
    assert caught.value.limit
    assert caught.value.remedy


def test_a_power_without_bound_is_infinite_and_takes_no_time() -> None:
    assert Expression("max(x_m) ** 9 ** 9 ** 9").of(COLUMNS) == np.inf


def test_of_no_known_samples_nothing_is_known() -> None:
    assert np.isnan(Expression("max(x_m)").of({"x_m": np.full(3, np.nan)}))
    assert np.isnan(Expression("mean(x_m)").of({"x_m": np.empty(0)}))


def test_an_expression_can_be_sent_to_another_process() -> None:
    expression = Expression("max(x_m)")
    assert pickle.loads(pickle.dumps(expression)).of(COLUMNS) == 4.0


@given(st.text(max_size=60))
def test_no_text_does_more_than_be_refused(text: str) -> None:
    with suppress(ExpressionError):
        Expression(text)
