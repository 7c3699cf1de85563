"""Statistics of the loop's stages say what the rows say."""

import json
from math import nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.loop.timing import PERCENTILES, StageTimes, Timing
from rig.loop.wire.layout import wire_channels
from rig.plant.integrator import TICK

CHANNELS = wire_channels(("position_m",), open_loop=False)
times_s = st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=300)


def rows_of(wakeup: list[float]) -> Any:
    rows = np.zeros((len(wakeup), len(CHANNELS)))
    rows[:, CHANNELS.index("wakeup_s")] = wakeup
    rows[:, CHANNELS.index("exchange_s")] = 1e-4
    return rows


@given(times_s)
def test_percentiles_are_within_a_bin_of_the_exact_ones(times: list[float]) -> None:
    stage = StageTimes()
    stage.take(np.array(times))
    for percent in PERCENTILES:
        exact = np.percentile(times, percent, method="inverted_cdf")
        assert stage.percentile(percent) == pytest.approx(exact, rel=0.05)


@given(times_s, st.integers(0, 300))
def test_statistics_do_not_depend_on_how_the_rows_are_batched(times: list[float], at: int) -> None:
    whole, parts = Timing(CHANNELS, TICK), Timing(CHANNELS, TICK)
    whole.take(rows_of(times))
    parts.take(rows_of(times[:at]))
    parts.take(rows_of(times[at:]))
    assert whole.summary() == parts.summary()


def test_the_greatest_time_is_exact() -> None:
    stage = StageTimes()
    stage.take(np.array([1e-5, 0.0123456789, 1e-4]))
    assert stage.summary()["max_s"] == 0.0123456789


def test_a_row_without_wakeup_is_a_missed_tick_and_nothing_else() -> None:
    timing = Timing(CHANNELS, TICK)
    timing.take(rows_of([1e-5, np.nan, 1e-5]))
    summary = timing.summary()
    assert (summary["ticks"], summary["missed"]) == (3, 1)
    assert summary["stages"]["wakeup"]["count"] == 2
    assert summary["stages"]["period"]["count"] == 0


def test_the_squares_of_missed_ticks_in_a_row_are_summed_however_rows_are_batched() -> None:
    missed = [1e-5, nan, nan, nan, 1e-5, nan, 1e-5, nan, nan]
    for at in range(len(missed) + 1):
        timing = Timing(CHANNELS, 1e-3)
        timing.take(rows_of(missed[:at]))
        timing.take(rows_of(missed[at:]))
        assert (timing.missed, timing.missed_squares) == (6, 9 + 1 + 4)


def test_the_period_is_that_between_wakings() -> None:
    timing = Timing(CHANNELS, TICK)
    timing.take(rows_of([0.0, 1e-4, 0.0]))
    period = timing.summary()["stages"]["period"]
    assert period["max_s"] == pytest.approx(1.1e-3)
    assert period["count"] == 2


def test_the_summary_goes_into_a_recordings_metadata() -> None:
    timing = Timing(CHANNELS, TICK)
    timing.take(rows_of([1e-5] * 10))
    assert json.loads(json.dumps(timing.summary())) == timing.summary()


def test_nothing_timed_has_no_percentile() -> None:
    summary = Timing(CHANNELS, TICK).summary()
    assert summary["stages"]["exchange"]["p99_s"] is None
    assert summary["stages"]["exchange"]["max_s"] is None
