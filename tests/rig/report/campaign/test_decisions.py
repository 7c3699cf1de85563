"""What was decided while a test ran, and what the loop did about it, is drawn over time."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.loop.decided import DECIDED
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from rig.report.campaign.leaks import compensation, flow_as_decided, probability
from rig.report.campaign.page import render
from rig.report.campaign.sections import sections_of
from rig.report.panel import TestData, ribbon
from rig.runner.outcomes.outcome import CampaignOutcome, TestOutcome
from rig.runner.outcomes.reactions import FaultAction

Array = NDArray[np.float64]
CampaignOf = Callable[..., CampaignOutcome]

TIME_S: Array = np.linspace(0.0, 3.999, 4000)
UNKNOWN = np.full(TIME_S.size, np.nan)


def data_of(outcome: TestOutcome, **channels: Array) -> TestData:
    nothing = dict.fromkeys(DECIDED, UNKNOWN)
    recording = Recording({"time_s": TIME_S, **nothing, **channels})
    return TestData(outcome, recording, "product")


def held(*values: float) -> Array:
    """Return values that are each held for as long as the others."""
    return np.repeat(np.array(values), TIME_S.size // len(values))


def test_the_probability_of_health_and_of_each_likely_fault_is_drawn(leaking: TestOutcome) -> None:
    data = data_of(
        leaking,
        probability_healthy=held(np.nan, 0.99, 0.01, 0.0),
        probability_external_leakage_1=held(np.nan, 0.0, 0.98, 1.0),
        probability_internal_leakage=held(np.nan, 0.01, 0.01, 0.0),
    )
    panel = probability(data)
    assert panel is not None
    assert [trace.name for trace in panel.traces] == ["healthy", "external leak 1"]
    assert np.nanmax(panel.traces[1].values) == 100.0


def test_a_detector_that_shows_no_probability_gets_no_empty_plot(leaking: TestOutcome) -> None:
    assert probability(data_of(leaking)) is None
    assert compensation(data_of(leaking)) is None
    silent = data_of(leaking, command_V=TIME_S, compensation_V=0.0 * TIME_S)
    assert compensation(silent) is None


def test_what_is_added_for_a_leak_is_drawn_beside_the_command(leaking: TestOutcome) -> None:
    data = data_of(leaking, command_V=TIME_S, compensation_V=held(0.0, 0.2, 0.3, 0.0))
    panel = compensation(data)
    assert panel is not None
    assert [trace.name for trace in panel.traces] == ["valve command", "of it for the leak"]


def test_a_leak_s_flow_is_drawn_with_its_interval_as_it_was_held_at_the_time(
    leaking: TestOutcome,
) -> None:
    flow = held(np.nan, 0.5, 0.4, np.nan) * LITRE_PER_MINUTE
    half = held(0.0, 0.2, 0.1, 0.0) * LITRE_PER_MINUTE
    band, mean = flow_as_decided(
        data_of(
            leaking,
            decided_at_s=held(np.nan, 1.0, 2.0, 3.0),
            decided_leak_m3_per_s=flow,
            decided_leak_low_m3_per_s=flow - half,
            decided_leak_high_m3_per_s=flow + half,
        )
    )
    known = np.isfinite(mean.values)
    assert mean.time_s[known] == pytest.approx([1.0, 1.999, 2.0, 2.999])
    assert mean.values[known] == pytest.approx([0.5, 0.5, 0.4, 0.4])
    outline = band.values[np.isfinite(band.values)]
    assert outline == pytest.approx([0.3, 0.3, 0.3, 0.3, 0.5, 0.5, 0.7, 0.7])


def test_an_interval_that_ends_and_comes_again_is_drawn_as_two() -> None:
    lower = np.array([0.0, 1.0, np.nan, 2.0, 3.0])
    drawn = ribbon("interval", "found", np.arange(5.0), lower, lower + 1.0)
    assert np.flatnonzero(np.isnan(drawn.values)).tolist() == [4, 9]
    assert drawn.time_s[:4].tolist() == [0.0, 1.0, 1.0, 0.0]
    assert drawn.values[5:9].tolist() == [2.0, 3.0, 4.0, 3.0]


@pytest.mark.parametrize(
    ("actions", "spans", "words"),
    [
        (
            (
                FaultAction(9.5, 10.0, "tolerating external_leakage_1 0.42 L/min"),
                FaultAction(10.0, 12.0, "tolerating external_leakage_1 0.4 L/min"),
            ),
            [(9.5, 12.0, "tolerating")],
            "tolerated from 9.5 s to 12.0 s",
        ),
        (
            (FaultAction(9.5, None, "holding the ram"),),
            [(9.5, 19.999, "holding")],
            "held from 9.5 s on",
        ),
    ],
)
def test_what_the_loop_did_is_shaded_and_said(
    leaking: TestOutcome,
    run_directory: Path,
    campaign: CampaignOf,
    actions: tuple[FaultAction, ...],
    spans: list[tuple[float, float, str]],
    words: str,
) -> None:
    outcome = campaign(replace(leaking, actions=actions))
    (section,) = sections_of(outcome, run_directory)
    assert [tuple(span.values()) for span in section.spans] == spans
    assert words in render(outcome, run_directory)
