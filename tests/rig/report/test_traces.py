import base64
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from rig.report.panel import POINTS, Trace, band, envelope, line, packed, steps

Array = NDArray[np.float64]

signals = arrays(
    np.float64,
    st.integers(1, 400),
    elements=st.floats(-1e6, 1e6) | st.just(float("nan")),
)
even_numbers = st.integers(1, 30).map(lambda half: 2 * half)


def time_of(samples: int) -> Array:
    return np.arange(samples, dtype=np.float64) * 1e-3


def unpacked(typed: dict[str, str]) -> Array:
    assert typed["dtype"] == "f4"
    return np.frombuffer(base64.b64decode(typed["bdata"]), "<f4").astype(np.float64)


@given(signals, even_numbers)
def test_a_thinned_signal_keeps_its_least_and_greatest_value(values: Array, points: int) -> None:
    _, thin = envelope(time_of(values.size), values, points)
    assert thin.size <= max(points, 2)
    assert np.isnan(thin).all() == np.isnan(values).all()
    if not np.isnan(values).all():
        assert np.nanmin(thin) == np.nanmin(values)
        assert np.nanmax(thin) == np.nanmax(values)


@given(signals, even_numbers)
def test_a_thinned_signal_consists_of_samples_at_their_own_times(
    values: Array, points: int
) -> None:
    time_s = time_of(values.size)
    thin_time, thin = envelope(time_s, values, points)
    assert (np.diff(thin_time) >= 0.0).all()
    chosen = np.rint(thin_time * 1e3).astype(int)
    np.testing.assert_array_equal(thin, values[chosen])


@given(st.integers(0, 39_999), st.booleans())
def test_a_spike_of_one_sample_in_40_s_is_still_drawn(at: int, upwards: bool) -> None:
    values = np.sin(time_of(40_000))
    values[at] = 9.0 if upwards else -9.0
    thin_time, thin = envelope(time_of(40_000), values)
    assert thin.size <= POINTS
    assert thin_time[np.argmax(np.abs(thin))] == pytest.approx(at * 1e-3)


def test_a_gap_longer_than_a_bucket_stays_a_gap() -> None:
    values = np.ones(10_000)
    values[4_000:5_000] = np.nan
    thin_time, thin = envelope(time_of(10_000), values, 100)
    inside = (thin_time >= 4.2) & (thin_time < 4.8)
    assert inside.any()
    assert np.isnan(thin[inside]).all()
    assert not np.isnan(thin[(thin_time < 4.0) | (thin_time >= 5.1)]).any()


def test_a_short_signal_is_left_as_it_is() -> None:
    time_s, values = np.arange(10.0), np.arange(10.0)
    assert envelope(time_s, values, 10) == (time_s, values)


@given(arrays(np.float64, 20, elements=st.floats(-1e9, 1e9)))
def test_what_the_screen_gets_is_right_to_seven_digits(values: Array) -> None:
    np.testing.assert_allclose(unpacked(packed(values)), values, rtol=1e-7, atol=1e-30)


def test_an_estimate_that_diverged_is_drawn_as_far_as_it_is_finite() -> None:
    shown = unpacked(packed(np.array([1.0, 1e200, -np.inf, np.nan])))
    assert shown[0] == 1.0
    assert np.isfinite(shown[:2]).all()
    assert shown[1] > 1e20
    assert np.isnan(shown[2:]).all()


def test_a_staircase_holds_each_value_over_its_block_and_breaks_at_a_gap() -> None:
    stairs = steps("missing", "chamber_1", np.array([0.0, 0.5, 2.0]), np.array([0.5, 1.0, 2.5]),
                   np.array([1.0, 2.0, 3.0]))  # fmt: skip
    np.testing.assert_array_equal(stairs.time_s, [0.0, 0.5, 0.5, 1.0, 2.0, 2.0, 2.5])
    np.testing.assert_array_equal(stairs.values, [1.0, 1.0, 2.0, 2.0, np.nan, 3.0, 3.0])


def test_a_staircase_of_an_hour_keeps_its_gaps_and_corners() -> None:
    start = 0.5 * np.arange(7200.0)
    start[3600:] += 10.0
    stairs = steps("missing", "chamber_1", start, start + 0.5, start)
    assert np.isnan(stairs.values).sum() == 1
    assert stairs.values.size == 2 * 7200 + 1


@pytest.mark.parametrize(
    "trace",
    [
        line("position", "ink", np.arange(3.0), np.arange(3.0), dash="dash", opacity=0.4),
        Trace("chamber 1", "chamber_1", "dots", np.arange(3.0), np.arange(3.0)),
        band("95 % interval", "found", 1.0, 2.0, 0.1, 0.2),
    ],
    ids=lambda trace: trace.shape,
)
def test_every_kind_of_trace_is_one_that_plotly_knows(trace: Trace) -> None:
    drawn: Any = go.Figure(data=[trace.plotly]).data[0]
    assert drawn.name == trace.name
    assert drawn.meta["role"] == trace.role
