import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import McapWriter, read_recording
from rig.report.campaign.sections import Section, not_reached, sections_of
from rig.report.panel import Panel
from rig.runner.outcomes.outcome import CampaignOutcome, Status, TestOutcome

CampaignOf = Callable[..., CampaignOutcome]


def panel(section: Section, key: str) -> Panel:
    return next(panel for panel in section.panels if panel.key == key)


def names(panel: Panel) -> list[str]:
    return [trace.name for trace in panel.traces]


@pytest.fixture
def section(leaking: TestOutcome, run_directory: Path, campaign: CampaignOf) -> Section:
    return sections_of(campaign(leaking), run_directory)[0]


def test_a_leak_test_shows_its_motion_first_and_then_what_leaked(section: Section) -> None:
    shown = [panel.key for panel in section.panels]
    assert shown == ["motion", "pressures", "missing_flow", "leak_flow", "evidence", "innovation"]
    assert all(panel.unit and panel.caption for panel in section.panels)


def test_screen_units_are_mm_mpa_and_litres_per_minute(
    section: Section, leaking: TestOutcome
) -> None:
    position = panel(section, "motion").traces[1].values
    assert (np.nanmin(position), np.nanmax(position)) == pytest.approx((150, 450), abs=60)
    for trace in panel(section, "pressures").traces:
        assert 2.0 < np.nanmedian(trace.values) < 12.0
    flow = leaking.injected[0].mean_flow_m3_per_s
    assert flow is not None
    injected = next(t for t in panel(section, "leak_flow").traces if "injected" in t.name)
    late = injected.values[injected.time_s > 10.0]
    assert np.median(late) == pytest.approx(flow / LITRE_PER_MINUTE, rel=0.15)


def test_both_pressures_are_shown_measured_and_estimated(section: Section) -> None:
    assert set(names(panel(section, "pressures"))) == {
        "chamber 1, measured",
        "chamber 2, measured",
        "chamber 1, estimated",
        "chamber 2, estimated",
    }


def test_the_flow_found_stands_beside_the_flow_injected(
    section: Section, leaking: TestOutcome
) -> None:
    shown = panel(section, "leak_flow")
    assert {"95 % interval", "mean flow found", "chamber 1, injected"} <= set(names(shown))
    # The sound chambers would only clutter it.
    assert not any("chamber 2" in name or "internal" in name for name in names(shown))
    assert leaking.decision is not None
    interval = leaking.decision.interval_m3_per_s
    assert interval is not None
    band = shown.traces[names(shown).index("95 % interval")]
    lowest, highest = band.values.min(), band.values.max()
    assert (lowest, highest) == pytest.approx(tuple(b / LITRE_PER_MINUTE for b in interval))


def test_injection_onset_and_detection_are_marked_in_the_order_of_time(
    section: Section, leaking: TestOutcome
) -> None:
    assert leaking.detected_at_s is not None
    times = {mark["kind"]: mark["time"] for mark in section.marks}
    assert times["injected"] == 8.0
    assert times["onset"] == pytest.approx(8.0, abs=0.5)
    assert times["detected"] == leaking.detected_at_s
    order = [mark["time"] for mark in section.marks]
    assert order == sorted(order)
    assert all(f"{mark['time']:.1f} s" in mark["text"] for mark in section.marks)


def test_a_fault_that_was_taken_away_is_marked_too(
    leaking: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    ended = replace(leaking, injected=(replace(leaking.injected[0], until_s=12.0),))
    section = sections_of(campaign(ended), run_directory)[0]
    assert ("removed", 12.0) in [(mark["kind"], mark["time"]) for mark in section.marks]


def test_the_end_of_a_fault_after_the_recording_s_end_is_not_marked(
    leaking: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    ended = replace(leaking, injected=(replace(leaking.injected[0], until_s=1000.0),))
    section = sections_of(campaign(ended), run_directory)[0]
    assert "removed" not in [mark["kind"] for mark in section.marks]


def test_levels_of_a_leak_that_werenot_reached_are_noted() -> None:
    levels = [{"kind": "internal_leakage", "at_s": at_s} for at_s in (20.0, 40.0, 60.0)]
    (note,) = not_reached({"test": {"faults": levels}}, 39.0)
    assert note.startswith("Not reached, as the recording ends at 39.0 s: ")
    assert note.endswith(" from 40.0 s on, internal leak from 60.0 s on.")
    assert list(not_reached({"test": {"faults": levels}}, 60.0)) == []
    assert list(not_reached({}, 60.0)) == []


def test_the_thesis_filter_shows_its_averages_against_their_thresholds(
    by_thesis_filter: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    decision = by_thesis_filter.decision
    assert decision is not None
    shown = campaign(by_thesis_filter, filter="thesis-7")
    section = sections_of(shown, run_directory)[0]
    assert [panel.key for panel in section.panels] == [
        "motion",
        "pressures",
        "innovation",
        "leak_flow",
    ]
    innovation = panel(section, "innovation")
    for chamber in (1, 2):
        threshold = innovation.traces[names(innovation).index(f"chamber {chamber}, threshold")]
        learnt = decision.details[f"threshold_{chamber}_Pa"]
        assert threshold.values == pytest.approx([learnt * 1e-3] * 2)


def test_a_healthy_test_claims_no_found_flow(
    healthy: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    section = sections_of(campaign(healthy), run_directory)[0]
    assert section.marks == ()
    assert not any("found" in name for shown in section.panels for name in names(shown))


def test_the_first_test_that_failed_is_unfolded_else_the_first_leak(
    healthy: TestOutcome, leaking: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    def unfolded(*tests: TestOutcome) -> list[bool]:
        return [section.opened for section in sections_of(campaign(*tests), run_directory)]

    failed = replace(healthy, status=Status.FAILED)
    assert unfolded(healthy, leaking, leaking) == [False, True, False]
    assert unfolded(leaking, healthy, failed, failed) == [False, False, True, False]
    assert unfolded(healthy, healthy) == [True, False]


def test_an_aborted_test_is_drawn_as_far_as_it_was_recorded(
    leaking: TestOutcome, tmp_path: Path, run_directory: Path, campaign: CampaignOf
) -> None:
    assert leaking.recording is not None
    whole = read_recording(run_directory / leaking.recording)
    rows = np.column_stack(list(whole.channels.values()))[:3_000]
    with McapWriter(tmp_path / "cut.mcap", list(whole.channels), whole.metadata) as writer:
        writer.write(rows)
    aborted = replace(leaking, status=Status.ABORTED, recording="cut.mcap", recorded_s=3.0)
    section = sections_of(campaign(aborted), tmp_path)[0]
    assert section.notes == ()
    assert (section.recorded_until_s, section.end_s) == pytest.approx((2.999, 20.0))
    assert "ended after 3.0 s of 20 s" in section.story
    assert [shown.key for shown in section.panels][:2] == ["motion", "pressures"]


def test_of_a_damaged_recording_the_readable_part_is_drawn_with_a_note(
    leaking: TestOutcome, tmp_path: Path, run_directory: Path, campaign: CampaignOf
) -> None:
    assert leaking.recording is not None
    content = (run_directory / leaking.recording).read_bytes()
    (tmp_path / leaking.recording).write_bytes(content[: len(content) // 2])
    section = sections_of(campaign(leaking), tmp_path)[0]
    assert "recovered" in section.notes[0]
    assert 5.0 < section.recorded_until_s < 15.0
    assert section.panels


@pytest.mark.parametrize("content", [None, b"", b"not a recording"])
def test_a_recording_that_cannot_be_read_at_all_leaves_a_note(
    leaking: TestOutcome, tmp_path: Path, campaign: CampaignOf, content: bytes | None
) -> None:
    assert leaking.recording is not None
    if content is not None:
        (tmp_path / leaking.recording).write_bytes(content)
    section = sections_of(campaign(leaking), tmp_path)[0]
    assert section.panels == ()
    assert f"{leaking.recording} cannot be read" in section.notes[0]
    assert str(tmp_path) not in section.notes[0]


def test_a_test_that_was_not_run_needs_no_note(
    leaking: TestOutcome, tmp_path: Path, campaign: CampaignOf
) -> None:
    not_run = replace(leaking, status=Status.NOT_RUN, decision=None, injected=(), recording=None)
    section = sections_of(campaign(not_run), tmp_path)[0]
    assert (section.notes, section.panels, section.story) == ((), (), "")


def test_without_a_model_the_measured_panels_are_drawn_and_a_note_says_why_not_more(
    leaking: TestOutcome, tmp_path: Path, run_directory: Path, campaign: CampaignOf
) -> None:
    assert leaking.recording is not None
    whole = read_recording(run_directory / leaking.recording)
    with McapWriter(tmp_path / leaking.recording, list(whole.channels), {}) as writer:
        writer.write(np.column_stack(list(whole.channels.values())))
    section = sections_of(campaign(leaking), tmp_path)[0]
    assert [shown.key for shown in section.panels] == [
        "motion",
        "pressures",
        "leak_flow",
        "innovation",
    ]
    assert "no oil account" in section.notes[0]


def test_on_a_rig_without_truth_the_flow_meter_stands_for_the_leak(
    leaking: TestOutcome, tmp_path: Path, run_directory: Path, campaign: CampaignOf
) -> None:
    assert leaking.recording is not None
    whole = read_recording(run_directory / leaking.recording)
    channels = [name for name in whole.channels if not name.startswith("true_")]
    zero = 0.05 * LITRE_PER_MINUTE
    metered = {name: whole[name] + zero * name.startswith("flow_") for name in channels}
    with McapWriter(tmp_path / leaking.recording, channels, whole.metadata) as writer:
        writer.write(np.column_stack(list(metered.values())))
    flows = panel(sections_of(campaign(leaking), tmp_path)[0], "leak_flow")
    shown = names(flows)
    assert "chamber 1, flow meter" in shown
    assert not any("injected" in name for name in shown)
    # What it read before the leak was opened is no leak, and is stated.
    reported = re.search(r"before the bypass was opened \(chamber 1 (0\.\d\d) L/min", flows.caption)
    assert reported is not None
    assert float(reported[1]) >= 0.05
    (meter,) = (trace for trace in flows.traces if trace.name == "chamber 1, flow meter")
    assert abs(float(np.median(meter.values[: meter.values.size // 4]))) < 0.01
    nothing = replace(leaking, injected=())
    nothing_opened = panel(sections_of(campaign(nothing), tmp_path)[0], "leak_flow")
    assert not any("flow meter" in name for name in names(nothing_opened))


def test_a_large_campaign_is_drawn_more_coarsely_so_that_its_page_opens(
    leaking: TestOutcome, tmp_path: Path, run_directory: Path, campaign: CampaignOf
) -> None:
    assert leaking.recording is not None
    shutil.copy(run_directory / leaking.recording, tmp_path)
    never = replace(leaking, status=Status.NOT_RUN, recording=None)
    few = sections_of(campaign(leaking), tmp_path)[0]
    many = sections_of(campaign(leaking, *[never] * 47), tmp_path)[0]
    assert panel(many, "motion").traces[0].values.size == pytest.approx(
        panel(few, "motion").traces[0].values.size / 4, rel=0.1
    )


def test_what_a_motion_would_have_shown_is_known_of_found_leaks_too(
    healthy: TestOutcome, leaking: TestOutcome, run_directory: Path, campaign: CampaignOf
) -> None:
    for section in sections_of(campaign(healthy, leaking), run_directory):
        assert section.smallest is not None
        at_first, from_start = section.smallest
        for leak, begun in at_first.items():
            assert 0.0 < begun < from_start[leak]
