"""The positioning axis of docs/another_plant.md, on recordings simulated by other code."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
import yaml

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.model_error import likely_model_error
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.verdict.workflow import find_gap
from rig.cli import main
from rig.configuration.models.plant_file import PlantModel
from rig.configuration.models.plant_loading import load_plant
from rig.recording import Recording
from tests.estimator.gap import axis_rig
from tests.estimator.gap.plants_compiled_once import plants_compiled_once

EXAMPLE = Path(__file__).parents[4] / "docs" / "another_plant"
OFF = {"gain": 36.4, "mass": 90.25, "viscous": 230.0}
"""What this axis has other than its model, within the model's tolerances."""


@pytest.fixture(scope="module", autouse=True)
def compiled_once() -> Iterator[None]:
    with plants_compiled_once():
        yield


@pytest.fixture(scope="module")
def axis() -> PlantModel:
    return load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml")


def recorded(motion: str, seed: int, seconds: float, **hidden: float) -> Recording:
    return Recording(axis_rig.recorded(motion, seed, seconds, **hidden), source=motion)


def test_an_axis_that_the_model_describes_is_refitted_and_lacks_nothing(axis: PlantModel) -> None:
    found = find_gap(
        [recorded("strokes", 1, 5.0, **OFF)], [recorded("strokes", 2, 3.0, **OFF)], axis.plant
    )
    assert found.verdict == "adequate"
    assert not found.effects
    assert not found.discovered
    for estimate in found.refitted:
        assert estimate.value == pytest.approx(OFF[estimate.parameter], rel=0.02)
    assert found.gap_after < 0.01 * found.gap_before


@pytest.mark.parametrize(
    ("hidden", "seconds", "places", "of", "size"),
    [
        pytest.param(
            {"cogging": 4.0, "pitch": 0.0212, "phase": 0.5}, 5.0,
            ["force balance"], "position", 4.0, id="cogging of another pitch",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"quadratic": 300.0}, 8.0, ["force balance", "viscous"], "velocity", 300.0,
            id="a drag with the square of the velocity", marks=pytest.mark.long,
        ),
    ],
)  # fmt: skip
def test_a_force_that_no_effect_holds_is_discovered_placed_and_written(
    axis: PlantModel, tmp_path: Path, hidden: dict[str, float], seconds: float,
    places: list[str], of: str, size: float,
) -> None:  # fmt: skip
    fit, held = (recorded("strokes", seed, seconds, **OFF, **hidden) for seed in (1, 2))
    found = find_gap([fit], [held], axis.plant)
    assert found.verdict == "unknown_effect"
    (discovered,) = found.discovered
    assert discovered.in_model
    assert discovered.place in places
    assert discovered.of == of
    if discovered.form != "table":
        assert discovered.estimates[0].value == pytest.approx(size, rel=0.2)
    if discovered.form == "wave":
        assert discovered.estimates[1].value == pytest.approx(0.0212, rel=0.01)
    assert found.gap_after < 0.02 * found.gap_before
    axis.plant.write(found.values, found.names, {}, tmp_path / "found.yaml")
    revised = load_plant(f"{EXAMPLE / 'axis.py'}:axis", tmp_path / "found.yaml")
    assert revised.plant.nominal == found.values
    again = find_gap([fit], [held], revised.plant)
    assert not again.effects
    assert not again.discovered


def test_a_hidden_delay_is_named_from_outside_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in ("axis.py", "axis.yaml"):
        copy(EXAMPLE / file, tmp_path / file)
    for name, seed in (("fit", 3), ("held", 4)):
        channels = axis_rig.recorded("strokes", seed, 5.0, delay=2.3e-3, **OFF)
        axis_rig.write_csv(tmp_path / f"{name}.csv", channels)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "axis", raising=False)
    with pytest.raises(SystemExit) as done:
        main(
            ["gap", "fit.csv", "--holdout", "held.csv", "--plant", "axis:axis",
             "--model", "axis.yaml", "--out", "out", "--json"]
        )  # fmt: skip
    shown = capsys.readouterr()
    assert done.value.code == 0, shown.err
    told = json.loads(shown.out)
    assert told["verdict"] == "missing_effect"
    (effect,) = told["effects"]
    assert effect["name"] == "delay"
    assert effect["parameters"]["value"]["value"] == pytest.approx(2.3e-3, rel=0.1)
    assert told["gap"]["after"] < 0.2 * told["gap"]["before"]
    written = yaml.safe_load((tmp_path / "out" / "model.yaml").read_text())
    assert float(written["effects"]["delay"].split()[0]) == pytest.approx(2.3e-3, rel=0.1)
    revised = load_plant(f"{tmp_path / 'axis.py'}:axis", tmp_path / "out" / "model.yaml")
    found = effect["parameters"]["value"]["value"]
    assert revised.plant.nominal["delay"] == pytest.approx(found, rel=1e-6)


def test_a_mistake_in_the_plant_ends_the_program_with_one_line_and_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (EXAMPLE / "axis.py").read_text().replace("par.mass, grip_rate", "par.mas, grip_rate")
    (tmp_path / "axis.py").write_text(text)
    copy(EXAMPLE / "axis.yaml", tmp_path / "axis.yaml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "axis", raising=False)
    with pytest.raises(SystemExit) as done:
        main(
            ["gap", "fit.csv", "--holdout", "held.csv", "--plant", "axis:axis",
             "--model", "axis.yaml", "--out", "out"]
        )  # fmt: skip
    assert done.value.code == 2
    told = capsys.readouterr().err
    assert "did you mean mass?" in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_a_twin_of_an_axis_with_delay_has_the_innovations_of_its_own_noise(
    axis: PlantModel,
) -> None:
    predictor = Predictor(axis.plant)
    values = {**axis.plant.nominal, "delay": 2.6e-3}
    record = record_of(recorded("sines", 5, 4.0, delay=2.6e-3), axis.plant)
    twin = predictor.twin(record, values, 1)
    gains = predictor.filter(twin, values)
    innovations = predictor.innovations(twin, gains, values)[0][500:]
    assert np.sqrt(np.mean(innovations**2)) == pytest.approx(1.0, abs=0.15)


def test_the_model_error_that_a_rougher_axis_bears_out_is_the_greater(axis: PlantModel) -> None:
    smooth = recorded("sines", 7, 4.0)
    rough = recorded("sines", 7, 4.0, cogging=3.0, pitch=0.002)
    least, _ = likely_model_error([smooth], axis.plant)
    most, likelihoods = likely_model_error([rough], axis.plant)
    assert least < 1.0
    assert most > 4.0 * least
    assert np.all(np.isfinite(likelihoods))
