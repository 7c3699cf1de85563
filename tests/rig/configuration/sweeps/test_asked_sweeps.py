"""Sweeps read the segments, leak profiles, figures, criteria and limits of campaigns."""

from math import inf
from pathlib import Path

import numpy as np
import pytest

from control import Sequence
from rig.configuration import check
from rig.configuration.editing import editor_schema
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from tests.rig.configuration.sweeps.test_sweep_files import GOOD, problems_of

SEGMENTED = """\
name: night
rig: ideal
filter: product
cases: 8
duration: 30 s
leaks:
  pressure: 5 MPa
  profile:
    - {at: 12 s, flow: 0.1 L/min}
    - {at: {uniform: [14 s, 16 s]}, ramp: 2 s, flow: {uniform: [0.5 L/min, 1 L/min]}}
figures:
  span: {expression: span(position_m), unit: m}
criteria:
  - {figure: rms_error, at_most: 3 mm}
  - {figure: latency, at_most: 10 s}
  - {figure: leak, at_least: 0.2 L/min}
motions:
  - name: work
    segments:
      - {name: sine, setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}, cycles: 5}
      - loop: 2
        segments:
          - {name: rest, hold: 2 s}
          - {name: up, setpoint: {type: steps, levels: [0.3 m, 0.4 m], hold: 2 s}, duration: 3 s}
          - {blend: 1 s, setpoint: {type: constant, value: 0.3 m}, duration: 1 s}
    criteria:
      - {figure: overshoot, at_most: 10 %, during: up}
      - {figure: span, at_least: 90 mm, during: sine}
    limits:
      - {channel: following_error_m, high: 5 mm, inner_high: 1 mm, action: trip, during: sine}
  - {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz, position_gain: {uniform: [40 V/m, 80 V/m]}}
limits:
  - {figure: rms_error, over: 5 s, high: 5 mm, action: warn}
"""  # noqa: E501 (as a user would write it)


def read(folder: Path, text: str) -> Sweep:
    file = folder / "sweep.yaml"
    file.write_text(text)
    return load_sweep(file)


def test_segments_are_those_of_a_campaign(tmp_path: Path) -> None:
    work, sine = read(tmp_path, SEGMENTED).motions
    assert (work.type, sine.type) == ("segments", "sine")
    assert isinstance(work.sequence, Sequence)
    assert work.sequence.duration_s == pytest.approx(24.0)
    assert work.sequence.window_s("up") == pytest.approx((12.0, 22.0))
    # Beyond its segments a motion stays where the last one leads.
    assert work.sequence.sample(np.array([29.0])) == pytest.approx(0.3)


def test_criteria_and_limits_of_the_sweep_hold_for_all_motions_and_those_of_a_motion_for_it(
    tmp_path: Path,
) -> None:
    work, sine = read(tmp_path, SEGMENTED).motions
    everywhere = ["rms_error", "latency", "leak"]
    assert [each.label for each in sine.criteria] == everywhere
    assert [each.label for each in work.criteria] == [
        *everywhere, "overshoot in up", "span in sine"
    ]  # fmt: skip
    assert [each.watched for each in sine.limits] == ["rms_error"]
    assert [each.watched for each in work.limits] == ["rms_error", "following_error_m"]
    assert work.limits[1].windows_s == ((0.0, 10.0),)
    latency = sine.criteria[1]
    assert (latency.low, latency.high, latency.unit) == (-inf, 10.0, "s")


def test_a_leak_s_profile_has_levels_that_may_be_drawn(tmp_path: Path) -> None:
    leaks = read(tmp_path, SEGMENTED).leaks
    assert leaks is not None
    assert leaks.onset.support == (12.0, 12.0)
    assert [level.at.support for level in leaks.profile] == [(12.0, 12.0), (14.0, 16.0)]
    assert leaks.profile[1].ramp.support == (2.0, 2.0)
    assert leaks.size == leaks.profile[1].size
    assert leaks.pressure == (5e6, 5e6, 5e6)


def test_only_what_a_sweep_asks_is_part_of_its_meaning(tmp_path: Path) -> None:
    asked = read(tmp_path, SEGMENTED).meaning
    assert asked["figures"][0]["name"] == "span"
    assert asked["motions"][0]["criteria"][3]["figure"] == "overshoot"
    assert asked["leaks"]["profile"]
    plain = read(tmp_path, GOOD).meaning
    assert "figures" not in plain
    assert "profile" not in plain["leaks"]
    assert not {"criteria", "limits", "sequence"} & set(plain["motions"][0])


def test_check_tells_what_is_asked_and_all_that_is_drawn(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(SEGMENTED)
    said = str(check(file))
    for words in (
        "drawn of the motions: sine_position_gain, sine_phase",
        "2 levels one after the other",
        "work: 7 segments, 24 s",
        "work: following error at most",
        "figure span: span(position_m)",
        "\n  pass by rms_error at most 3 mm",
        "work: pass by overshoot in up at most 0.1",
        "\n  limit rms_error over 5 s: warn above 5 mm",
        "work: limit following_error_m: warn above 1 mm, trip above 5 mm, in sine",
    ):
        assert words in said, (words, said)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("cycles: 5}", "until: {channel: position_m, high: 0.4 m, at_most: 5 s}}", "laid out"),
        ("{name: rest, hold: 2 s}", "{wait_for: {verdict: healthy, at_most: 5 s}}", "laid out"),
        ("amplitude: 0.1 m, frequency: 0.5 Hz}, c", "amplitude: {uniform: [1 mm, 2 mm]}, "
         "frequency: 0.5 Hz}, c", "is drawn, and segments must meet without a jump"),
        ("loop: 2", "loop: 3", "last 31 s, and every case lasts 30 s"),
        ("type: constant, value: 0.3 m", "type: constant, value: 3 m", "of the rig ideal"),
        ("    criteria:\n", "    cycles: 4\n    criteria:\n", "give cycles to a segment"),
        ("at: 12 s, f", "at: 12 s, until: 20 s, f", "stays to the end of its case"),
        ("at: 12 s, f", "at: 12 s, ramp: 3 s, f", "may begin before the level before is reached"),
        ("at: 12 s, flow: 0.1 L/min", "at: 12 s, coefficient: 4e-9 m^3/(s Pa^0.5)", "mixes flows"),
        ("ramp: 2 s", "ramp: 12 s", "may come later than 4 s before the end"),
        ("  pressure: 5 MPa", "  onset: 12 s", "is given beside a profile"),
        ("figure: rms_error, at_most: 3 mm", "figure: bulk_modulus, at_most: 1 GPa",
         "is not computed of the cases of a sweep"),
        ("figure: rms_error, over", "figure: leak, over", "is not computed of the cases"),
        ("span(position_m)", "span(load_N)", "load_N"),
        ("span(position_m)", "span(innovation_pressure_1_Pa)", "innovation_pressure_1_Pa"),
        ("figure: rms_error, at_most: 3 mm", "figure: overshoot, at_most: 5 %",
         "needs steps of the setpoint, and the motion sine has none"),
        ("filter: product", "filter: thesis-7", "is not told by thesis-7"),
        ("figure: latency, at_most: 10 s", "figure: latency, at_most: 10 s, from_time: 3 s",
         "figure of the whole case"),
        ("figure: latency, at_most: 10 s", "figure: latency", "has no limit"),
        ("during: up}", "during: down}", "is no segment of this test"),
        ("trip, during: sine}", "trip, during: sine}\n      - {channel: following_error_m, "
         "high: 9 mm, during: sine}", "as another limit of work does"),
        ("figure: rms_error, over: 5 s", "figure: rms_error, each: cycle", "hold all along"),
        ("figure: rms_error, over: 5 s, high: 5 mm", "figure: overshoot, high: 5 %",
         "is not computed of the cases"),
        ("duration: 30 s", "duration: 700 s", "700 s is above 600 s, for which the samples"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_in_lanes_is_refused_with_its_remedy(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    assert SEGMENTED.count(old) >= 1
    assert says in problems_of(tmp_path, SEGMENTED.replace(old, new, 1))


def test_calibrations_correct_the_readings_that_product_takes(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("name: rig\nparent: ideal\ncalibrations: [pressure_1_example]\n")
    text = GOOD.replace("rig: ideal", "rig: ./rig.yaml")
    assert "thesis-7 takes the readings of lanes as they are" in problems_of(tmp_path, text)
    product = text.replace("cases: 8", "filter: product\ncases: 8")
    sweep = read(tmp_path, product)
    assert sweep.meaning["calibrations"][0]["channel"] == "pressure_1_Pa"
    assert "readings corrected by the calibration of pressure_1_Pa" in str(
        check(tmp_path / "sweep.yaml")
    )


def test_an_editor_is_told_the_keys_of_segments_that_a_sweep_takes() -> None:
    defined = editor_schema("sweep")["$defs"]
    assert {"setpoint", "cycles", "hold", "blend"} <= set(defined["SweptSegmentFile"]["properties"])
    assert not {"until", "wait_for"} & set(defined["SweptSegmentFile"]["properties"])
    assert {"loop", "segments"} == set(defined["SweptLoopFile"]["properties"])
    assert {"criteria", "limits"} <= set(defined["SweptSineFile"]["properties"])
    assert "profile" in defined["LeaksFile"]["properties"]


def test_mistakes_of_motions_and_of_what_is_asked_are_told_at_once(tmp_path: Path) -> None:
    text = (
        SEGMENTED.replace("loop: 2", "loop: 3")
        .replace("figure: rms_error, at_most: 3 mm", "figure: rms_eror, at_most: 3 mm")
        .replace("channel: following_error_m, high", "channel: following_eror_m, high")
    )
    found = problems_of(tmp_path, text)
    for line, words in ((14, "did you mean rms_error"), (19, "last 31 s"), (30, "did you mean")):
        assert any(f"sweep.yaml:{line}:" in e and words in e for e in found.splitlines()), found
