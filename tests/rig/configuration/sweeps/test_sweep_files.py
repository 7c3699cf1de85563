import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, strategies as st

from control import ControlSettings
from rig.configuration import check
from rig.configuration.reading.problems import ConfigError
from rig.configuration.sweeps.distributions import Distribution
from rig.configuration.sweeps.sweep import load_sweep

GOOD = """\
name: good
rig: ideal
cases: 8
duration: 30 s
parameters:
  bulk_modulus: {uniform: [-15 %, +15 %]}
  viscous: {log_uniform: [200 N s/m, 600 N s/m]}
effects:
  spool_null_bias: {normal: [0 m, 2 um]}
leaks:
  flow: {log_uniform: [0.1 L/min, 2 L/min]}
  onset: {uniform: [16 s, 20 s]}
motions:
  - {type: sine, mean: 0.3 m, amplitude: {uniform: [0.05 m, 0.2 m]}, frequency: 0.5 Hz}
"""


def problems_of(folder: Path, text: str) -> str:
    file = folder / "sweep.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_sweep(file)
    return str(caught.value)


def test_a_sweep_reads_in_si(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(GOOD)
    sweep = load_sweep(file)
    law = sweep.parameters["bulk_modulus"]
    assert law.values == pytest.approx((0.85 * 6.89e8, 1.15 * 6.89e8))
    assert sweep.parameters["spool_null_bias"].support == (-5e-5, 5e-5)
    assert sweep.leaks is not None
    assert sweep.leaks.size.values == pytest.approx((0.1e-3 / 60.0, 2e-3 / 60.0))
    assert sweep.leaks.pressure == (6.9e6, 6.9e6, 2.5e6)
    assert sweep.ticks == 30_001


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("name: good", 'name: "bad\\a"', "sweep.yaml:1:1 name: bad"),
        ("name: good", 'name: "two\\nlines"', "has the character \\n, which cannot be shown"),
        ("name: good", 'name: " "', "is empty; write a name of letters"),
        ("type: sine,", 'type: sine, name: "a\\e[31m",', "has the character \\x1b"),
        ("type: sine,", 'type: sine, name: "",', "is empty; write a name of letters"),
        ("[-15 %, +15 %]", "[+15 %, -15 %]",
         "bulk_modulus: {uniform: [+15 %, -15 %]} ends before it begins"),
        ("{normal: [0 m, 2 um]}", "{normal: [0 m, 2 kg]}",
         "spool_null_bias: {normal: [0 m, 2 kg]} is not a"),
    ],
)  # fmt: skip
def test_names_that_cannot_be_shown_and_wrong_distributions_are_refused_with_their_values(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    assert says in problems_of(tmp_path, GOOD.replace(old, new, 1))


def test_a_sweep_whose_cases_are_all_healthy_needs_no_size_and_onset_of_leaks(
    tmp_path: Path,
) -> None:
    file = tmp_path / "sweep.yaml"
    sizes = GOOD[GOOD.index("  flow") : GOOD.index("motions")]
    file.write_text(GOOD.replace(sizes, "  healthy: 100 %\n"))
    assert load_sweep(file).leaks is None
    assert "has no begin" in problems_of(tmp_path, GOOD.replace(sizes, "  healthy: 99 %\n"))


def test_check_knows_sweeps_by_file_and_by_name(tmp_path: Path) -> None:
    file = tmp_path / "anything.yaml"
    file.write_text(GOOD)
    assert check(file).kind == "sweep"
    assert check("leaks").kind == "sweep"


def test_every_mistake_is_reported_at_once_with_its_line(tmp_path: Path) -> None:
    text = """\
name: bad
rig: ideal
cases: 0
duration: 30 s
filter: thesis-9
parameter: {}
parameters:
  bulk_modulus: {uniform: [-15 %, 5 GPa]}
  viscous: {uniform: [600 N s/m, 200 N s/m]}
  supply_pressure: {normal: [138 MPa, 1 MPa]}
  density: {gaussian: [1, 2]}
effects:
  command_delay: {uniform: [0 ms, 2 ms]}
leaks:
  flow: {log_uniform: [0 L/min, 2 L/min]}
  onset: {uniform: [5 s, 29 s]}
  places: [external_leakage_3]
motions:
  - {type: sine, mean: 0.3 m, amplitude: {uniform: [0.05 m, 0.5 m]}, frequency: 0.5 Hz}
  - {type: sinus}
  - {type: steps, levels: [0.2 m, 3 V], hold: 1 s}
"""
    found = problems_of(tmp_path, text)
    for line, words in (
        (3, "cases: 0"), (5, "did you mean thesis-7"), (6, "did you mean parameters"),
        (8, "above 2.5 GPa"), (9, "ends before it begins"), (10, "did you mean 13.8 MPa"),
        (11, "is no distribution"), (13, "remembers more"), (15, "starts at zero"),
        (17, "external_leakage_3"), (19, "may come to"), (20, "did you mean sine"),
        (21, "are mixed"),
    ):  # fmt: skip
        lines = [each for each in found.splitlines() if f"sweep.yaml:{line}:" in each]
        assert any(words in each for each in lines), (line, words, found)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("{uniform: [16 s, 20 s]}", "{uniform: [10 s, 20 s]}", "learns what is healthy"),
        ("{uniform: [16 s, 20 s]}", "{uniform: [16 s, 28 s]}", "may come later than"),
        ("duration: 30 s", "duration: 17 s", "leaves nothing to judge"),
        ("duration: 30 s", "duration: 30.2 s", "is no multiple of 0.5 s"),
        ("duration: 30 s", "duration: 30 s\nlongest_step: 2 ms", "2 ms is above 1 ms"),
        ("flow: {log", "coefficient: 4e-9 m^3/(s Pa^0.5)\n  flow: {log", "both flow and coeff"),
        ("effects:", "  stiction: 1 kN\neffects:", "lets stiction come to 1 kN, below a coulomb"),
        ("effects:", "effects:\n  viscous_friction: 300 N s/m", "is given as a parameter too"),
        ("{normal: [0 m, 2 um]}", "{normal: [0 m, 2 %]}", "spool_null_bias"),
        ("mean: 0.3 m", "mean: -1 m", "sweep.yaml:14:18 mean: -1 m gives -1 m, outside"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in GOOD
    assert says in problems_of(tmp_path, GOOD.replace(old, new))


FOLLOWED = GOOD.replace(
    "motions:\n",
    """control: {feedforward: model, integral_time: 1 s}
motions:
  - {type: trapezoid, mean: 0.3 m, amplitude: 0.1 m, frequency: {uniform: [0.2 Hz, 0.5 Hz]},
     hold: {uniform: [0.1 s, 0.5 s]}, position_gain: {uniform: [40 V/m, 80 V/m]}}
  - {type: triangle, control: {cyclic: true}, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
  - {type: triangle, name: thesis, control: proportional, mean: 0.3 m, amplitude: 0.1 m,
     frequency: 0.5 Hz}
  - {type: triangle, name: open, amplitude: 2 V, frequency: 0.5 Hz}
""",
)


def test_a_motion_s_control_replaces_keys_of_the_sweep_s_and_this_those_of_the_rig_s(
    tmp_path: Path,
) -> None:
    rig = "name: tuned\nparent: ideal\ncontrol: {null: 50 mV, integral_time: 2 s}\n"
    (tmp_path / "tuned.yaml").write_text(rig)
    file = tmp_path / "sweep.yaml"
    file.write_text(FOLLOWED.replace("rig: ideal", "rig: ./tuned.yaml"))
    sweep = load_sweep(file)
    law = ControlSettings(null=0.05, feedforward="model", integral_time=1.0)
    plain = ControlSettings()
    cyclic = ControlSettings(null=0.05, feedforward="model", integral_time=1.0, cyclic=True)
    assert [sweep.control_of(motion) for motion in sweep.motions] == [
        law, cyclic, plain, plain, law
    ]  # fmt: skip
    assert sweep.motions[0].values["position_gain"][0].support == (40.0, 80.0)


def test_control_is_part_of_what_a_sweep_means_only_where_there_is_any(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(GOOD)
    plain = load_sweep(file).meaning
    assert "control" not in plain
    assert all("control" not in motion for motion in plain["motions"])
    file.write_text(FOLLOWED)
    followed = load_sweep(file).meaning
    assert followed["control"]["integral_time"] == 1.0
    assert followed["motions"][1]["control"]["cyclic"] is True


def test_check_says_what_error_the_fastest_motion_will_have(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(FOLLOWED)
    said = str(check(file))
    for words in (
        "trapezoid, at its fastest: following error at most",
        "expected with 40 V/m, feedforward, integral of 1 s",
        "thesis, at its fastest",
        "expected with 50 V/m alone",
    ):
        assert words in said
    assert "open, at its fastest" not in said
    file.write_text(GOOD.replace("frequency: 0.5 Hz", "frequency: {uniform: [0.1 Hz, 1 Hz]}"))
    assert "warning: sine moves at up to 1.3 m/s" in str(check(file))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("hold: {uniform: [0.1 s, 0.5 s]}", "hold: 1 s", "may leave no time to move"),
        ("{cyclic: true}", "{cyclik: true}", "did you mean cyclic"),
        ("{cyclic: true}", "{gain: 60 V/m}, position_gain: 50 V/m", "beside a gain under control"),
        ("amplitude: 2 V", "amplitude: 2 V, position_gain: 50 V/m", "needs a position loop"),
        ("integral_time: 1 s", "integral_time: 1 ms", "1 ms is below 10 ms"),
        ("control: proportional", "control: none", "is not a control law"),
    ],
)
def test_a_control_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in FOLLOWED
    assert says in problems_of(tmp_path, FOLLOWED.replace(old, new))


LAWS = st.one_of(
    st.tuples(st.floats(-5, 5), st.floats(0, 5)).map(
        lambda ends: Distribution("uniform", (ends[0], ends[0] + ends[1]))
    ),
    st.tuples(st.floats(0.01, 5), st.floats(1, 9)).map(
        lambda ends: Distribution("log_uniform", (ends[0], ends[0] * ends[1]))
    ),
    st.tuples(st.floats(-1, 1), st.floats(0.01, 5)).map(
        lambda law: Distribution("normal", law, -1.5, 1.5)
    ),
    st.lists(st.floats(-5, 5), min_size=1).map(lambda v: Distribution("choice", tuple(v))),
    st.floats(-5, 5).map(lambda value: Distribution("fixed", (value,))),
)


@given(LAWS, st.lists(st.floats(0, 1, exclude_max=True), min_size=1))
def test_nothing_is_drawn_outside_a_distributions_support(
    law: Distribution, parts: list[float]
) -> None:
    values = law.at(np.array(parts))
    low, high = law.support
    assert np.all((low <= values) & (values <= high))


def test_a_normal_quantity_has_its_mean_and_deviation() -> None:
    parts = (np.arange(2000) + 0.5) / 2000
    values = Distribution("normal", (5.0, 0.3)).at(parts)
    assert values.mean() == pytest.approx(5.0, abs=1e-6)
    assert values.std() == pytest.approx(0.3, rel=2e-3)


def test_the_sweeps_of_the_sweeps_page_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[4] / "docs" / "sweeps.md").read_text()
    example, adaptive, night = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "mine.yaml").write_text(example)
    sweep = load_sweep(tmp_path / "mine.yaml")
    assert len(sweep.motions) == 7
    assert sweep.motions[-1].quantity == "command"
    near = yaml.safe_load(example) | yaml.safe_load(adaptive)
    (tmp_path / "near.yaml").write_text(yaml.safe_dump(near))
    leaks = load_sweep(tmp_path / "near.yaml").leaks
    assert leaks is not None
    assert leaks.adaptive is not None
    (tmp_path / "night.yaml").write_text(night)
    asked = load_sweep(tmp_path / "night.yaml")
    assert asked.leaks is not None
    assert len(asked.leaks.profile) == 3
    assert [len(motion.criteria) for motion in asked.motions] == [4, 2]
