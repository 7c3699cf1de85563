"""Campaign files: what is written once becomes tests, each of which the rig can do."""

import gzip
import hashlib
import json
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from control.setpoints import Chirp, Constant, FromFile, Multisine, Pseudorandom, Sine, Steps
from estimator.accounts.nuisances import UNINFORMED
from estimator.baselines.baseline import PATTERN_FILTERS, Baseline
from estimator.baselines.baseline_file import write_baseline
from estimator.leaks.pattern import HealthyLevel
from faults.campaign import OnFault
from faults.verdict import Verdict
from rig.configuration import ConfigError
from rig.configuration.campaigns.campaign import load_campaign, plain
from tests.rig.configuration.campaigns.written import (
    HEAD,
    SINE,
    TEST,
    fault,
    load,
    only_test,
    problems_of,
)

# Tests, matrices, repeats


def test_a_healthy_test_needs_a_name_a_duration_and_a_setpoint_only(tmp_path: Path) -> None:
    test = only_test(tmp_path)
    assert test.setpoint == Sine(0.3, 0.2, 0.5)
    assert (test.duration_s, test.settle_s, test.start_position_m) == (40.0, 2.0, 0.3)
    assert (test.faults, test.load, test.expect) == ((), None, Verdict.HEALTHY)


def test_a_matrix_is_every_combination_named_by_its_labels(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        HEAD
        + f"""
defaults: {{duration: 40 s, setpoint: {SINE}}}
tests:
  - name: ${{leak}}/${{level}}
    matrix:
      leak: [external_leakage_1, internal_leakage]
      level: {{low: 0.3 L/min, high: 0.8 L/min}}
    faults:
      - type: ${{leak}}
        at: 18 s
        flow: ${{level}}
        pressure: 6.9 MPa
""",
    )
    assert [test.name for test in campaign.tests] == [
        "external_leakage_1/low",
        "external_leakage_1/high",
        "internal_leakage/low",
        "internal_leakage/high",
    ]
    assert [test.expect for test in campaign.tests[1:3]] == [
        Verdict.EXTERNAL_LEAKAGE_1,
        Verdict.INTERNAL_LEAKAGE,
    ]
    assert campaign.tests[1].faults[0].coefficient == pytest.approx(0.8 / 6e4 / sqrt(6.9e6))


def test_an_axis_may_hold_whole_setpoints_and_parts_of_texts(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        HEAD
        + """
tests:
  - name: ${motion} ${seconds}
    duration: ${seconds} s
    matrix:
      motion:
        rest: {type: constant, value: 0.3 m}
        open: {type: sine, amplitude: 3 V, frequency: 1 Hz}
      seconds: [10, 20]
    setpoint: ${motion}
""",
    )
    assert [(test.name, test.duration_s) for test in campaign.tests] == [
        ("rest 10", 10.0),
        ("rest 20", 20.0),
        ("open 10", 10.0),
        ("open 20", 20.0),
    ]
    assert campaign.tests[0].setpoint == Constant(0.3)
    assert campaign.tests[2].setpoint == Sine(0.0, 3.0, 1.0, quantity="command")


def test_repeats_differ_in_seed_and_noise_only(tmp_path: Path) -> None:
    text = HEAD + TEST + "    repeats: 3\n    seed: 7\n"
    tests = load(tmp_path, text).tests
    assert [(test.name, test.repeat, test.seed) for test in tests] == [
        ("a #1", 1, 7),
        ("a #2", 2, 8),
        ("a #3", 3, 9),
    ]
    assert {test.test_name for test in tests} == {"a"}
    assert len({test.setpoint for test in tests}) == 1


def test_another_test_in_the_file_changes_no_tests_seed(tmp_path: Path) -> None:
    before = load(tmp_path, HEAD + TEST).tests
    more = f"  - name: b\n    duration: 9 s\n    setpoint: {SINE}\n"
    after = load(tmp_path, HEAD + TEST.replace("tests:\n", f"tests:\n{more}")).tests
    assert after[1] == before[0]
    assert after[0].seed != after[1].seed


def test_a_tests_own_keys_win_over_the_defaults(tmp_path: Path) -> None:
    campaign = load(tmp_path, HEAD + "defaults: {settle: 1 s, duration: 9 s}\n" + TEST)
    assert (campaign.tests[0].settle_s, campaign.tests[0].duration_s) == (1.0, 40.0)


# Setpoints


@pytest.mark.parametrize(
    ("setpoint", "expected"),
    [
        ("{type: constant, value: 300 mm}", Constant(0.3)),
        (
            "{type: sine, amplitude: 3 V, frequency: 0.5 Hz, phase: 0.1}",
            Sine(0.0, 3.0, 0.5, 0.1, "command"),
        ),
        (
            "{type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 500 mHz}",
            Sine(0.3, 0.1, 0.5),
        ),
        (
            "{type: chirp, amplitude: 3 V, start_frequency: 0.5 Hz, end_frequency: 10.5 Hz}",
            Chirp(0.0, 3.0, 0.5, 0.25, 0.0, "command"),
        ),
        (
            "{type: chirp, amplitude: 3 V, start_frequency: 0.5 Hz, end_frequency: 10.5 Hz,"
            " sweep_time: 20 s}",
            Chirp(0.0, 3.0, 0.5, 0.5, 0.0, "command"),
        ),
        ("{type: steps, levels: [0.1 m, 0.4 m], hold: 2 s}", Steps((0.1, 0.4), 2.0)),
        (
            "{type: pseudorandom, lower: 0.1 m, upper: 0.5 m, hold: [0.2 s, 4 s], seed: 3}",
            Pseudorandom(0.1, 0.5, 0.2, 4.0, 3),
        ),
        (
            "{type: multisine, mean: 0.3 m, amplitude: 0.1 m, frequencies: [0.2 Hz, 0.5 Hz]}",
            Multisine(0.3, 0.1, (0.2, 0.5)),
        ),
    ],
)
def test_a_setpoint_is_what_it_says(tmp_path: Path, setpoint: str, expected: object) -> None:
    assert only_test(tmp_path, setpoint=setpoint).setpoint == expected


def test_a_pseudorandom_setpoint_takes_the_tests_seed(tmp_path: Path) -> None:
    setpoint = "{type: pseudorandom, lower: 0.1 m, upper: 0.5 m, hold: 2 s}"
    test = only_test(tmp_path, "seed: 11", setpoint)
    assert test.setpoint == Pseudorandom(0.1, 0.5, 2.0, 2.0, 11)


def test_a_setpoint_file_lies_beside_the_campaign_and_is_hashed(tmp_path: Path) -> None:
    content = gzip.compress(b"time_s,position_m\n0,0.2\n10,0.4\n")
    (tmp_path / "ramp.csv.gz").write_bytes(content)
    text = HEAD + TEST.replace(SINE, "{type: file, path: ramp.csv.gz}")
    campaign = load(tmp_path, text)
    assert isinstance(campaign.tests[0].setpoint, FromFile)
    assert campaign.tests[0].setpoint.sample(np.array([5.0])) == pytest.approx(0.3)
    digest = hashlib.sha256(content).hexdigest()
    assert campaign.source_files[str(tmp_path / "ramp.csv.gz")] == digest


def test_a_broken_setpoint_file_is_reported_by_its_own_lines(tmp_path: Path) -> None:
    (tmp_path / "ramp.csv").write_text("time_s,position_m\n0,0.2\n10,oops\n5,0.3\n")
    found = problems_of(tmp_path, setpoint="{type: file, path: ramp.csv}")
    assert found == [
        "ramp.csv:3:1 position_m: oops is not a finite number; fill it in or drop the row",
        "ramp.csv:4:1 time_s: 5.0 is not after 10.0; sort the rows by time",
    ]


@pytest.mark.parametrize(
    ("setpoint", "problem"),
    [
        (
            "{type: sine, mean: 0.5 m, amplitude: 0.2 m, frequency: 0.5 Hz}",
            "6:5 setpoint: 0.7 m at 0.500 s is above the 0.6 m of the rig simulated; reduce",
        ),
        (
            "{type: sine, mean: 0.15 m, amplitude: 0.2 m, frequency: 0.5 Hz}",
            "6:5 setpoint: -50 mm at 1.500 s is below the 5 mm of the rig simulated; reduce",
        ),
        (
            "{type: constant, value: 12 V}",
            "6:5 setpoint: 12 V at 0.000 s is above the 10 V of the rig simulated; reduce",
        ),
        (
            "{type: sine, mean: 0.3 m, amplitude: 3 V, frequency: 1 Hz}",
            "6:5 setpoint: mean in metres, amplitude in volts are mixed; give all in metres",
        ),
        ("{type: sin}", "6:16 type: sin is not a known setpoint; did you mean sine?"),
        ("{amplitude: 3 V}", "6:5 setpoint: a mapping is not a setpoint; give its type: const"),
        ("3 V", "6:5 setpoint: 3 V is not a setpoint; give its type: constant, sine"),
        ("{type: constant, value: 3}", "6:32 value: 3 has no unit; write a length with its unit"),
        (
            "{type: constant, value: 3 N}",
            "6:32 value: 3 N is neither a length nor a voltage; write a position, such as 0.3 m",
        ),
        (
            "{type: steps, levels: [0.1 m, 3 V], hold: 1 s}",
            "6:5 setpoint: levels in metres, levels in volts are mixed; give all in metres",
        ),
        ("{type: steps, levels: [], hold: 1 s}", "6:29 levels: () is empty; give at least one"),
        (
            "{type: pseudorandom, lower: 0.4 m, upper: 0.2 m, hold: 1 s}",
            "6:50 upper: 0.2 is below lower (0.4); swap lower and upper",
        ),
        (
            "{type: multisine, mean: 0.3 m, amplitude: 0.1 m, frequencies: [0.2 Hz, 0.2 Hz]}",
            "6:64 frequencies: 0.2 comes twice; give each frequency once",
        ),
        ("{type: file, path: no.csv}", "6:28 path: no.csv cannot be read: no such file"),
    ],
)
def test_a_setpoint_the_rig_cannot_follow_is_named_with_time_and_value(
    tmp_path: Path, setpoint: str, problem: str
) -> None:
    (found,) = problems_of(tmp_path, setpoint=setpoint)
    assert found.replace(str(tmp_path), "").startswith(f"campaign.yaml:{problem}")


# What is done about a fault


def test_unless_it_says_so_a_campaign_only_records_a_fault(tmp_path: Path) -> None:
    assert only_test(tmp_path).on_fault == OnFault.IGNORE


@pytest.mark.parametrize(
    ("wide", "defaults", "own", "expected"),
    [
        ("hold", "", "", "hold"),
        ("hold", "trip", "", "trip"),
        ("hold", "trip", "tolerate", "tolerate"),
        ("", "trip", "", "trip"),
        ("trip", "", "ignore", "ignore"),
    ],
)
def test_the_nearest_word_on_faults_counts(
    tmp_path: Path, wide: str, defaults: str, own: str, expected: str
) -> None:
    text = HEAD
    text += f"on_fault: {wide}\n" if wide else ""
    text += f"defaults: {{on_fault: {defaults}}}\n" if defaults else ""
    text += TEST + (f"    on_fault: {own}\n" if own else "")
    assert load(tmp_path, text).tests[0].on_fault == expected


@pytest.mark.parametrize("where", ["on_fault: hodl\n" + TEST, TEST + "    on_fault: hodl\n"])
def test_an_unknown_reaction_is_named_once_with_the_nearest_known(
    tmp_path: Path, where: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, HEAD + where)
    (problem,) = caught.value.problems
    assert "on_fault: hodl is not a choice here; did you mean hold?" in str(problem)


def test_nothing_can_be_tolerated_where_the_setpoint_is_the_command(tmp_path: Path) -> None:
    chirp = (
        "{type: chirp, amplitude: 2 V, start_frequency: 0.5 Hz, end_frequency: 2 Hz, "
        "sweep_time: 40 s}"
    )
    (problem,) = problems_of(tmp_path, "on_fault: tolerate", chirp)
    assert "on_fault: tolerate needs a position loop" in problem
    assert only_test(tmp_path, "on_fault: hold", chirp).on_fault == OnFault.HOLD


# The campaign as a whole


def test_another_rig_can_be_chosen_and_is_the_one_checked(tmp_path: Path) -> None:
    path = tmp_path / "campaign.yaml"
    path.write_text(HEAD.replace("simulated", "nowhere") + TEST)
    campaign, rig = load_campaign(path, rig_override="ideal")
    assert campaign.rig_name == rig.name == "ideal"


def test_a_campaign_knows_the_hash_of_every_file_it_was_read_from(tmp_path: Path) -> None:
    campaign = load(tmp_path, HEAD + "model: thesis\n" + TEST)
    for path, digest in campaign.source_files.items():
        assert hashlib.sha256(Path(path).read_bytes()).hexdigest() == digest
    assert {Path(path).name for path in campaign.source_files} == {
        "campaign.yaml",
        "simulated.yaml",
        "nominal.yaml",
        "thesis.yaml",
    }


def test_a_campaign_and_its_rig_are_recorded_as_plain_si_values(tmp_path: Path) -> None:
    keys = fault("type: internal_leakage, at: 18 s, needle_opening: 0.5")
    path = tmp_path / "campaign.yaml"
    path.write_text(HEAD + TEST + "".join(f"    {line}\n" for line in keys.splitlines()))
    campaign, rig = load_campaign(path)
    (test, *_), recorded = json.loads(json.dumps(plain([campaign.tests, rig]), allow_nan=False))
    assert recorded["plant"]["parameters"] == rig.plant.parameters._asdict()
    assert test["setpoint"]["type"] == "Sine"
    assert test["faults"][0]["until_s"] is None
    assert test["expect"] == "internal_leakage"


def test_the_thesis_chirp_is_as_printed() -> None:
    campaign, _ = load_campaign("validation_3_2")
    time = np.arange(0.0, 40.0, 0.1)
    chirp = next(test for test in campaign.tests if test.name == "chirp")
    printed = 3.0 * np.sin(pi * (1.0 + time / 4.0) * time)
    np.testing.assert_allclose(chirp.setpoint.sample(time), printed, atol=1e-9)


# What the detector knows of the rig


def test_a_filter_that_there_is_not_is_reported_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, HEAD + "detector: {filter: thesis-7-ud}\n" + TEST)
    (problem,) = caught.value.problems
    assert (problem.line, problem.field) == (3, "filter")
    assert "filter: thesis-7-ud is not a known filter; did you mean thesis-7?" in str(problem)


def write_some_baseline(path: Path, model: str = "nominal") -> None:
    level = HealthyLevel(np.full(2, 3e4), np.full(2, 1e3), 10)
    write_baseline(Baseline(UNINFORMED, dict.fromkeys(PATTERN_FILTERS, level), {}, model), path)


@pytest.mark.parametrize("name", ["product", "thesis-7"])
def test_a_baseline_beside_the_campaign_is_known_to_its_detector(tmp_path: Path, name: str) -> None:
    write_some_baseline(tmp_path / "rig.json")
    detector = f"detector: {{filter: {name}, baseline: rig.json}}\n"
    campaign = load(tmp_path, HEAD + detector + TEST)
    assert campaign.baseline is not None
    assert campaign.baseline_file == "rig.json"
    assert campaign.baseline_doubt == ""
    assert str(tmp_path / "rig.json") in campaign.source_files
    assert load(tmp_path, HEAD + TEST).baseline is None


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "cannot be read: no such file"), ("{}", "not a baseline"), ("x", "not a baseline")],
)
def test_a_baseline_that_is_none_is_reported_with_its_place(
    tmp_path: Path, content: str | None, says: str
) -> None:
    if content is not None:
        (tmp_path / "rig.json").write_text(content)
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, HEAD + "detector:\n  baseline: rig.json\n" + TEST)
    (problem,) = caught.value.problems
    assert (problem.line, problem.field) == (4, "baseline")
    assert says in str(problem)


def test_a_baseline_holds_beside_the_model_it_was_learnt_with(tmp_path: Path) -> None:
    write_some_baseline(tmp_path / "rig.json", "thesis")
    with pytest.raises(ConfigError, match="beside the model thesis, not nominal"):
        load(tmp_path, HEAD + "detector: {baseline: rig.json}\n" + TEST)
