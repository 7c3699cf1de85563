"""Of a rig on hardware the report shows what the kernel granted and how the loop kept its time."""

import json
import re

import numpy as np
import pytest

from rig.loop.timing import TIMING, Timing, in_short
from rig.recording import Event, Recording
from rig.report.wording import loop_conditions


@pytest.fixture
def recording() -> Recording:
    timing = Timing(("wakeup_s", "exchange_s", "compute_s", "sent_s"), 1e-3)
    rows = np.full((1000, 4), 50e-6)
    rows[10] = np.nan
    timing.take(rows)
    grants = [
        {"name": "SCHED_FIFO 80", "granted": False},
        {"name": "locked memory", "granted": True},
    ]
    return Recording(
        {"time_s": 1e-3 * np.arange(1000.0)},
        {"loop": {"grants": grants}},
        [Event(1.0, TIMING, json.dumps(timing.summary()))],
    )


def test_what_was_refused_is_shown_beside_what_was_granted(recording: Recording) -> None:
    reported = dict(loop_conditions(recording))
    assert reported["Loop ran with"] == "without SCHED_FIFO 80, locked memory"


def test_missed_ticks_and_percentiles_are_reported_in_short(recording: Recording) -> None:
    reported = dict(loop_conditions(recording))["Loop timing"]
    # A percentile is known to its histogram's bin, 5 % wide.
    assert re.match(
        r"1 of 1000 ticks missed, wakes after (48|49|50) us \(p99 (48|49|50) us\)", reported
    )


def test_where_no_tick_was_counted_none_is_said_to_be_missed() -> None:
    columns = ("wakeup_s", "exchange_s", "compute_s", "sent_s")
    summary = Timing(columns, 1e-3).summary()
    assert in_short(summary) == ""
    ended = Recording({"time_s": np.arange(2.0)}, {}, [Event(0.0, TIMING, json.dumps(summary))])
    assert dict(loop_conditions(ended)) == {"Loop timing": "no tick was counted"}


def test_a_simulated_rig_has_no_loop_to_report() -> None:
    assert not list(loop_conditions(Recording({"time_s": 1e-3 * np.arange(10.0)})))
