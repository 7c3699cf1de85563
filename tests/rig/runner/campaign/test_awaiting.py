"""A test that ends with what it awaits, and one that waits before it begins."""

from pathlib import Path

import numpy as np
import pytest

from faults import Condition, Until, Verdict
from rig.configuration import ConfigError, load_campaign
from rig.recording import read_recording
from rig.runner.campaign import run_campaign
from rig.runner.campaign.simulated_bench import SimulatedBench
from rig.runner.outcomes import Status, TestOutcome
from tests.rig.configuration.campaigns.written import only_test, problems_of

SETPOINT = "setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}"
UNTIL = f"""\
name: awaiting
rig: simulated
tests:
  - name: a
    settle: 1 s
    {SETPOINT}
    KEYS
"""


def run(folder: Path, keys: str, **more: object) -> TestOutcome:
    (folder / "c.yaml").write_text(UNTIL.replace("KEYS", keys))
    campaign, rig = load_campaign(folder / "c.yaml")
    return run_campaign(campaign, rig, folder / "out", **more).tests[0]  # type: ignore[arg-type]


def test_a_channel_in_its_range_ends_a_test_that_then_counts(tmp_path: Path) -> None:
    test = run(tmp_path, "until: {channel: position_m, low: 0.35 m, for: 50 ms, at_most: 20 s}")
    assert 0.1 < test.recorded_s < 2.0
    assert test.criteria[0].met
    assert str(test.criteria[0]).startswith("until position_m ")
    assert test.status in (Status.PASSED, Status.FAILED)


def test_what_does_not_come_in_time_fails_the_test(tmp_path: Path) -> None:
    test = run(tmp_path, "until: {verdict: internal_leakage, at_most: 5 s}\n    expect: healthy")
    assert (test.status, test.recorded_s) == (Status.FAILED, 5.0)
    assert str(test.missed[0]) == "until internal_leakage never, at most 5 s"


def test_a_verdict_ends_a_test(tmp_path: Path) -> None:
    leak = "faults: [{type: internal_leakage, at: 6 s, flow: 1.5 L/min, pressure: 6.9 MPa}]"
    test = run(tmp_path, f"until: {{verdict: internal_leakage, at_most: 30 s}}\n    {leak}")
    assert test.status == Status.PASSED
    assert 6.0 < test.recorded_s < 20.0


SEGMENTS = """\
name: segments
rig: simulated
tests:
  - name: a
    settle: 1 s
    segments:
      - name: rising
        setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.25 Hz}
        until: {channel: position_m, low: 0.33 m, for: 20 ms, at_most: 30 s}
      - {name: back, setpoint: {type: constant, value: 0.25 m}, blend: 1 s, duration: 2 s}
      - {name: rest, wait_for: {verdict: internal_leakage, at_most: 2 s}}
      - {hold: 1 s}
    criteria:
      - {figure: valley, during: back, at_least: 0.24 m, at_most: 0.28 m}
    limits:
      - {channel: position_m, high: 0.31 m, during: rising, action: warn}
      - {channel: position_m, low: 0.29 m, during: back, for: 0.5 s, action: warn}
      - {figure: rms_error, high: 1 mm, over: 0.5 s, during: back, action: warn}
"""


def test_a_segment_ends_with_what_it_awaits_and_the_next_one_begins(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(SEGMENTS)
    campaign, rig = load_campaign(tmp_path / "c.yaml")
    (test,) = run_campaign(campaign, rig, tmp_path / "out").tests
    came, never, valley = test.criteria
    assert came.figure == "until position_m in rising"
    assert came.met
    assert (str(never), never.met) == ("until internal_leakage in rest never, at most 2 s", False)
    assert (test.status, valley.met) == (Status.FAILED, True)
    rising, back, rest, hold = test.segments
    assert [each.ended_early for each in test.segments] == [True, False, False, False]
    # What comes between two looks ends the segment at the next one, 50 ms later at most.
    assert 0.0 <= rising.end_s - came.value <= 0.051
    assert back.begin_s == pytest.approx(rising.end_s + 1.0)
    assert rest.end_s - rest.begin_s == pytest.approx(2.0)
    assert hold.end_s == pytest.approx(test.recorded_s)
    limits = {(each.watched, each.limit): each for each in test.limits}
    assert limits["position_m", 0.31].at_s < rising.end_s
    assert limits["position_m", 0.29].at_s == pytest.approx(back.begin_s + 0.5)
    assert limits["rms_error", 1e-3].at_s >= back.begin_s + 0.5
    recording = read_recording(tmp_path / "out/a.mcap")
    steps = np.abs(np.diff(recording.channels["setpoint_m"]))
    # The blend is the fastest motion: half a cosine of 0.1 m in 1 s.
    assert steps.max() < 0.5 * np.pi * 0.1 * 1e-3 + 0.1 * 2 * np.pi * 0.25 * 1e-3
    assert recording.channels["setpoint_m"][-1] == pytest.approx(0.25)


def test_a_test_waits_for_its_channel_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []

    def warming(bench: SimulatedBench, channel: str) -> float:
        looked.append(channel)
        return 320.0 if len(looked) > 3 else 290.0

    monkeypatch.setattr(SimulatedBench, "reading", warming)
    monkeypatch.setattr(
        "rig.configuration.campaigns.awaited.measured_by", lambda rig: ("oil_temperature_K",)
    )
    test = run(
        tmp_path,
        "duration: 5 s\n    wait_for: {channel: oil_temperature_K, low: 313 K, at_most: 1 min}",
    )
    assert looked == ["oil_temperature_K"] * 4
    assert test.recorded_s == 5.0
    assert "(awaited)" in (tmp_path / "out/journal.jsonl").read_text()


def test_what_is_awaited_is_read(tmp_path: Path) -> None:
    keys = "wait_for: {channel: position_m, low: 0.1 m, at_most: 10 min}"
    assert only_test(tmp_path, keys).wait_for == (
        Condition("position_m", 0.1, for_s=0.0, give_up_s=600.0),
    )
    text = f"{{name: a, {SETPOINT}, until: {{verdict: healthy, for: 5 s, at_most: 1 min}}}}"
    (tmp_path / "u.yaml").write_text(f"name: u\nrig: simulated\ntests: [{text}]\n")
    (test,) = load_campaign(tmp_path / "u.yaml")[0].tests
    assert (test.until, test.duration_s) == (Until(verdict=Verdict.HEALTHY, for_s=5.0), 60.0)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("until: {verdict: healthy, at_most: 60 s}", "is given beside a duration"),
        ("wait_for: 3", "wait_for: 3 is not a list"),
        ("wait_for: {channel: position_m, low: 0.1 m}", "lacks the key at_most"),
        ("wait_for: {channel: position_m, at_most: 5 s}", "has no limit"),
        ("wait_for: {channel: oil_temperature_K, low: 300 K, at_most: 5 s}", "is not measured"),
        ("wait_for: {channel: position_m, low: 1 V, at_most: 5 s}", "is not a length"),
        ("wait_for: {channel: position_m, low: 0.1 m, at_least: 5 s}", "is not a known key"),
        ("wait_for: {channel: position_m, low: 0.3 m, high: 0.1 m, at_most: 5 s}", "low must be"),
    ],
)
def test_what_is_wrong_is_refused(tmp_path: Path, keys: str, said: str) -> None:
    assert said in "\n".join(problems_of(tmp_path, keys))


@pytest.mark.parametrize(
    ("until", "said"),
    [
        ("{verdict: leaky, at_most: 60 s}", "is not a choice here"),
        ("{verdict: healthy}", "lacks the key at_most"),
        ("{verdict: healthy, at_most: 2 h}", "at_most: 2 h is above 1 h"),
        ("{at_most: 60 s}", "lacks the key channel"),
        ("{channel: position_m, at_most: 60 s}", "has no limit"),
        ("{channel: position_m, low: 0.5 m, high: 0.1 m, at_most: 60 s}", "swap them"),
        ("{verdict: healthy, channel: position_m, at_most: 60 s}", "channel: is not a known key"),
        ("3", "is not a mapping"),
    ],
)
def test_an_until_that_cannot_be_used_is_refused(tmp_path: Path, until: str, said: str) -> None:
    (tmp_path / "u.yaml").write_text(UNTIL.replace("KEYS", f"until: {until}"))
    with pytest.raises(ConfigError) as caught:
        load_campaign(tmp_path / "u.yaml")
    assert said in str(caught.value)
