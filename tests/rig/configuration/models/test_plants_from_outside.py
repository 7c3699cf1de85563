"""A plant from outside the package: its module and its model file, and what is said of mistakes."""

from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import copy
from textwrap import dedent

import numpy as np
import pytest

from estimator.gap.plant.additions import Addition
from estimator.gap.plant.description import PlantError
from rig.configuration import ConfigError
from rig.configuration.models.plant_file import PlantModel
from rig.configuration.models.plant_loading import load_plant
from rig.recording import RecordingError
from tests.estimator.gap.plants_compiled_once import plants_compiled_once

EXAMPLE = Path(__file__).parents[4] / "docs" / "another_plant"

Load = Callable[..., PlantModel]


@pytest.fixture(scope="module", autouse=True)
def compiled_once() -> Iterator[None]:
    with plants_compiled_once():
        yield


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> PlantModel:
    """Return the example as it is, compiled once for all that ask for it."""
    folder = tmp_path_factory.mktemp("axis")
    for file in ("axis.py", "axis.yaml"):
        copy(EXAMPLE / file, folder / file)
    return load_plant(f"{folder / 'axis.py'}:axis", folder / "axis.yaml")


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in ("axis.py", "axis.yaml"):
        copy(EXAMPLE / file, tmp_path / file)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def with_module(workplace: Path, *changes: tuple[str, str]) -> str:
    """Return a reference to the example's module with some text replaced."""
    text = (workplace / "axis.py").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (workplace / "mine.py").write_text(text)
    return "mine.py:axis"


def module_problems(workplace: Path, *changes: tuple[str, str]) -> list[str]:
    with pytest.raises(PlantError) as raised:
        load_plant(with_module(workplace, *changes), workplace / "axis.yaml")
    return raised.value.problems


def file_problems(workplace: Path, *changes: tuple[str, str]) -> list[str]:
    text = (workplace / "axis.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (workplace / "mine.yaml").write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_plant("axis.py:axis", workplace / "mine.yaml")
    return [str(problem) for problem in raised.value.problems]


def test_a_model_written_reads_back_to_the_same_values_and_shows_their_intervals(
    axis: PlantModel, workplace: Path
) -> None:
    values = {**axis.plant.nominal, "offset": 1.0 / 3.0, "mass": 91.7, "cogging": 2.0}
    provenance = {
        "effects": {"offset": {"parameters": {"value": {"lower": 0.31, "upper": 0.35}}}},
        "refitted": {"mass": {"lower": 91.0, "upper": 92.0}},
    }
    axis.plant.write(values, ("offset", "cogging"), provenance, workplace / "found.yaml")
    found = load_plant("axis.py:axis", workplace / "found.yaml")
    assert found.plant.nominal == values
    assert found.effects == ("offset", "cogging")
    assert found.plant.outputs == axis.plant.outputs
    assert [s.noise for s in found.plant.states] == pytest.approx(
        [s.noise * 95.0 / 91.7 for s in axis.plant.states]
    )
    text = (workplace / "found.yaml").read_text()
    assert "95 %: 91 to 92 kg" in text
    assert "95 %: 0.31 to 0.35 N" in text
    assert found.content["provenance"] == provenance


ADDITIONS = (
    Addition("force balance", "position", "", "wave", (0.042, 0.4), (1.0 / 3.0,)),
    Addition("force balance", "position", "direction", "table", (0.01, 0.1, 0.2), (-3.0, 0.0, 1.7)),
    Addition("reading of position_m", "velocity", "", "x |x|", (), (2e-5,)),
    Addition("viscous", "time", "", "hinge", (3.0,), (-1.5,)),
)


def test_what_is_discovered_is_written_in_the_units_of_the_plant_and_reads_back(
    axis: PlantModel, workplace: Path
) -> None:
    layout = axis.plant.layout
    assert layout is not None
    values = {**axis.plant.nominal, **layout.values(ADDITIONS)}
    axis.plant.write(values, (), {}, workplace / "found.yaml")
    found = load_plant("axis.py:axis", workplace / "found.yaml")
    assert found.plant.nominal == values
    assert found.name == "axis revised"
    text = (workplace / "found.yaml").read_text()
    for line in (
        "size: 0.3333333333333333 N", "pitch: 0.042 m", "against_motion: true",
        "size: 2e-05 m/(m/s)^2", "size: -1.5 N s/m/(s)",
    ):  # fmt: skip
        assert line in text, line
    assert "added_" not in text
    found.plant.write(axis.plant.nominal, (), {}, workplace / "without.yaml")
    without = load_plant("axis.py:axis", workplace / "without.yaml")
    assert without.plant.nominal == axis.plant.nominal


def test_everything_wrong_with_what_is_discovered_is_reported_at_once(workplace: Path) -> None:
    found = file_problems(
        workplace,
        ("mass: 95 kg", "mass: 95 mm"),
        (
            "channels:",
            "discovered:\n"
            "  - {to: force balanse, form: constant, size: 1 N}\n"
            "  - {to: force balance, of: position, form: x, size: 3 N}\n"
            "  - {to: mass, of: temperature, form: x, size: 3 kg}\n"
            "  - {to: viscous, of: position, form: table, at: [0 m, 0 m], values: [1 N s/m]}\n"
            "channels:",
        ),
    )
    text = "\n".join(found)
    for claim in (
        "mass: 95 mm is not a mass",
        "to: force balanse is not a choice here; did you mean force balance?",
        "size: 3 N is not",
        "of: temperature is not a choice here; choose one of velocity, position",
        "values: [1 N s/m] is not a list of 2 to 9 quantities",
    ):
        assert claim in text, claim


def test_a_model_written_as_given_keeps_its_name_and_gives_no_interval_of_what_was_not_kept(
    axis: PlantModel, workplace: Path
) -> None:
    refitted = {"mass": {"value": 86.0, "lower": 85.0, "upper": 87.0, "kept": False}}
    axis.plant.write(axis.plant.nominal, (), {"refitted": refitted}, workplace / "same.yaml")
    text = (workplace / "same.yaml").read_text()
    (workplace / "same.yaml").write_text(text + "steering: none\n")
    found = load_plant("axis.py:axis", workplace / "same.yaml")
    assert found.plant.nominal == axis.plant.nominal
    assert found.name == axis.name
    assert "95 %" not in text
    assert found.plant.steering == ()


def test_channels_are_mapped_from_other_names_and_units_and_steered_as_the_model_file_says(
    workplace: Path,
) -> None:
    (workplace / "mine.yaml").write_text(
        (workplace / "axis.yaml")
        .read_text()
        .replace(
            "  position_m: {noise: 0.7 um, resolution: 1 um}",
            "  time_s: {column: t, unit: ms}\n  motor_V: vir\n"
            "  position_m: {column: counts, scale: 2e-6, noise: 3 um, resolution: 2 um}",
        )
        + "steering: {motor_V: {position_m: 12 V/m}}\n"
    )
    loaded = load_plant("axis.py:axis", workplace / "mine.yaml")
    count = 1500
    rows = np.column_stack([np.arange(count), np.full(count, 80.0), 500.0 * np.arange(count)])
    np.savetxt(
        workplace / "r.csv", rows, header="t,vir,counts", comments="", delimiter=",", fmt="%.9g"
    )
    recording = loaded.read(workplace / "r.csv")
    # 80 V and 1.5 m are nothing a servo-hydraulic rig shows; this is another plant.
    assert recording["time_s"][-1] == pytest.approx(1.499)
    assert recording["position_m"][-1] == pytest.approx(1.499)
    assert recording["motor_V"].max() == 80.0
    assert loaded.plant.outputs[0].noise == pytest.approx(3e-6)
    assert loaded.plant.steering == ((0, 0, 12.0),)

    (workplace / "other.csv").write_text((workplace / "r.csv").read_text().replace("vir", "U"))
    with pytest.raises(RecordingError, match="vir: missing column, which is to be motor_V"):
        loaded.read(workplace / "other.csv")


def test_everything_wrong_with_a_model_file_is_reported_at_once_with_its_line(
    workplace: Path,
) -> None:
    found = file_problems(
        workplace,
        ("mass: 95 kg", "mass: 95 mm"),
        ("  viscous: 200 N s/m\n", ""),
        ("coulomb: 20 N", "coulombe: 20 N"),
        ("gain: 10 %,", "gian: 10 %,"),
        ("force balance: 2 N", "force balance: 1 V"),
        ("noise: 0.7 um", "noise: 1 kg"),
        ("description", "effects: {offset: 500 N, backlash: 1 mm}\ndescription"),
    )
    text = "\n".join(found)
    for claim in (
        "mine.yaml:7:3 mass: 95 mm is not a mass",
        "lacks viscous; add `viscous: ... N s/m`",
        "coulombe: is not a known key; did you mean coulomb?",
        "gian: is not a known key; did you mean gain?",
        "force balance: 1 V is not a force",
        "noise: 1 kg is not a length",
        "offset: 500 N is above 100 N",
        "backlash: is not a known key",
    ):
        assert claim in text, claim
    assert all(line.startswith("mine.yaml:") for line in found)


def test_a_plant_needs_its_own_model_file(workplace: Path) -> None:
    with pytest.raises(ConfigError, match=r"--model nothing\.yaml: does not exist; give the YAML"):
        load_plant("axis.py:axis", "nothing.yaml")


@pytest.mark.parametrize(
    ("reference", "claim"),
    [
        ("axis", "names no object of a module"),
        ("nowhere:axis", "there is no module nowhere in"),
        ("nowhere.py:axis", "nowhere.py does not exist"),
        ("axis.py:axes", "axis.py has no axes; did you mean axis"),
        ("axis.py:rates", "rates is a function, must be a PlantDescription"),
    ],
)
def test_a_plant_that_is_not_there_is_said_to_be_missing(
    workplace: Path, reference: str, claim: str
) -> None:
    with pytest.raises(PlantError, match=claim):
        load_plant(reference, workplace / "axis.yaml")


def test_a_module_that_does_not_import_is_blamed_with_its_line(workplace: Path) -> None:
    (workplace / "broken.py").write_text("import math\n\nx = math.sqroot(2)\n")
    with pytest.raises(PlantError, match=r"broken.py:3: AttributeError: .*sqroot"):
        load_plant("broken.py:axis", workplace / "axis.yaml")
    (workplace / "unfinished.py").write_text("def rates(:\n")
    with pytest.raises(PlantError, match=r"unfinished.py:1: SyntaxError"):
        load_plant("unfinished.py:axis", workplace / "axis.yaml")


@pytest.mark.parametrize(
    ("change", "claim"),
    [
        (("/ par.mass, grip_rate", "/ par.mass"), "rates: returns 2 values, must be 3: the rate"),
        (("return (state.position,)", "return state.position"), "must return a tuple of 1"),
        (("par.gain * inputs", "par.gian * inputs"), "no attribute 'gian'; did you mean gain?"),
        (("/ par.mass, grip_rate", "/ 0.0, grip_rate"), "ZeroDivisionError"),
        (("- par.offset", "- math.inf"), "the rate of velocity is -inf at position"),
        (('Parameter("viscous",', 'Parameter("gain",'), "parameter gain is given 2 times"),
        (('"value": "offset"', '"value": "ofset"'), "parameter ofset is not known; did you mean"),
        (('reading("position_m")', 'reading("angle_rad")'), "angle_rad is not known; there are"),
        (('of=("velocity"', 'of=("speed"'), "region speed is not known"),
        (('RegionOf("motor voltage"', 'RegionOf("time"'), "region 'time' is there without being"),
        (('{"value": "offset"}', '{"value": "offset"}, own=(("force", "x"),)'), "own: region x is"),
        (("state.velocity, 1e-3", "state.speed, 1e-3"), "region 'direction': value: Attribute"),
        (("noise=0.7e-6", "noise=0.0"), "output position_m: noise 0.0 must be above 0"),
        (("v = state.velocity", "v = open('nothing')"), "FileNotFoundError"),
        (("    force = par", "    globals()\n    force = par"), "cannot compile"),
    ],
)  # fmt: skip
def test_mistakes_in_the_module_are_named(
    workplace: Path, change: tuple[str, str], claim: str
) -> None:
    assert any(claim in problem for problem in module_problems(workplace, change))


POSITION = "lambda state, inputs: state.position, ("


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("state.position + 0.0 * len(globals())", "the value of region 'position': numba cannot"),
        ("state.position - state.position.mean()", "the value of region 'position'"),
    ],
    ids=["not compiled", "of all samples"],
)
def test_a_plant_whose_quantities_do_not_compile_says_why_it_holds_nothing_discovered(
    workplace: Path, value: str, reason: str
) -> None:
    reference = with_module(workplace, (POSITION, f"lambda state, inputs: {value}, ("))
    plant = load_plant(reference, workplace / "axis.yaml").plant
    assert plant.layout is None
    assert reason in plant.why_no_layout
    text = (workplace / "axis.yaml").read_text()
    added = "discovered: [{to: force balance, form: constant, size: 1 N}]\n"
    (workplace / "added.yaml").write_text(text + added)
    with pytest.raises(ConfigError, match="discovered: cannot be held; models of this plant"):
        load_plant(reference, workplace / "added.yaml")


def test_the_compiled_quantities_are_those_of_the_regions_and_equations(axis: PlantModel) -> None:
    plant = axis.plant
    measured = np.empty(len(plant.regions) + 2)
    state, inputs = np.array([0.11, -0.2, 0.3]), np.array([1.5])
    plant.measures(state, inputs, plant.vector(plant.nominal), measured)
    assert measured == pytest.approx([-0.2, 0.11, 1.5, -1.0, -1e-3 / 95.0, 0.0])
    # Along the voltage no error of the position is looked for: the loop feeds its noise back.
    assert plant.outputs[0].of == ("velocity", "position", "direction")
    assert [each.name for each in plant.varying] == ["gain", "mass", "viscous"]


def test_all_mistakes_in_the_tables_are_reported_at_once(workplace: Path) -> None:
    found = module_problems(
        workplace,
        ("noise=0.7e-6", "noise=-1.0"),
        ('"value": "offset"', '"value": "ofset"'),
        ('of=("velocity"', 'of=("speed"'),
    )
    assert len(found) >= 3


def test_a_simulation_of_an_axis_is_steered_back_within_a_second(axis: PlantModel) -> None:
    ((index, output, gain),) = axis.plant.steering
    assert (index, output) == (0, 0)
    # Of M q'' = g u alone, this gain makes an oscillation of 1.5 to 4 s.
    period = 2.0 * np.pi / np.sqrt(gain * 35.0 / 95.0)
    assert 1.0 < period < 4.0


def test_the_compiled_step_is_the_rates_integrated(axis: PlantModel) -> None:
    plant = axis.plant
    state, memory = np.array([0.1, 0.2, 1.0]), np.array([0.0])
    parameters = plant.vector({**plant.nominal, "coulomb": 1e-9})
    for _ in range(1000):
        plant.step(state, memory, parameters)
    # M q'' = -Fv q': q' falls by exp(-Fv t / M).
    faded = np.exp(-200.0 / 95.0)
    assert state[1] == pytest.approx(0.2 * faded, rel=1e-6)
    assert state[0] == pytest.approx(0.1 + 0.2 * 95.0 / 200.0 * (1.0 - faded), rel=1e-6)


def test_a_plant_of_one_state_and_two_inputs_is_described_in_twenty_lines(workplace: Path) -> None:
    (workplace / "tank.py").write_text(
        dedent(
            """
            from estimator.gap.plant.description import *
            from estimator.gap.plant.interface import Parameter

            def rates(state, inputs, par):
                return (par.gain * inputs.pump_V - par.leak * state.level - inputs.drain_V,)

            def readings(state, inputs, par):
                return (state.level, 2.0 * state.level + inputs.pump_V)

            tank = PlantDescription(
                name="tank", rates=rates, readings=readings,
                inputs=(Input("pump_V", "V", 5.0), Input("drain_V", "V", 5.0)),
                outputs=(Channel("level_m", "m", 1e-3), Channel("mixed", "m", 1e-3)),
                states=(StateOf("level", "m", reading("level_m"), 1e-2, error=1e-5),),
                parameters=(Parameter("gain", "m/(s V)", 0.0, 10.0),
                            Parameter("leak", "1/s", 0.0, 1.0, neutral=0.0)),
                effects=(MayLack("leak", "- k h", "level_m", {"value": "leak"}),),
                tolerances={}, equations=(), regions=(),
            )
            """
        )
    )
    (workplace / "tank.yaml").write_text("name: tank\nparameters: {gain: 0.5 m/(s V)}\n")
    plant = load_plant("tank.py:tank", workplace / "tank.yaml").plant
    state, readings = np.array([1.0]), np.empty(2)
    memory = np.array([2.0, 0.4])
    for _ in range(500):
        plant.step(state, memory, plant.vector(plant.nominal))
    plant.read(state, memory, plant.vector(plant.nominal), readings)
    assert state[0] == pytest.approx(1.3)
    assert readings == pytest.approx([1.3, 4.6])
