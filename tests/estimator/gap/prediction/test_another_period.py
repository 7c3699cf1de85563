"""A plant from outside the package, on recordings of other periods than 1 ms, and with gaps."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.suitability import usable
from estimator.gap.verdict.workflow import find_gap
from rig.configuration.models.plant_loading import load_plant
from rig.recording import RecordingError
from tests.estimator.gap import axis_rig
from tests.estimator.gap.plants_compiled_once import plants_compiled_once

EXAMPLE = Path(__file__).parents[4] / "docs" / "another_plant"
OFFSET = 3.2
RIVALS = ("offset", "viscous_asymmetry", "delay")
N = 8_000


@pytest.fixture(scope="module", autouse=True)
def compiled_once() -> Iterator[None]:
    with plants_compiled_once():
        yield


def written(folder: Path, **asked: object) -> list[Path]:
    """Write a recording to fit to and one to hold out, in open loop, and return their paths."""
    paths = [folder / "fit.csv", folder / "held.csv"]
    for path, seed in zip(paths, (1, 2), strict=True):
        channels = axis_rig.recorded("open loop", seed, N * 1e-3, offset=OFFSET, **asked)  # type: ignore[arg-type]
        axis_rig.write_csv(path, channels)
    return paths


def uneven(generator: np.random.Generator) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    rows = np.cumsum(generator.integers(10, 13, size=N)) - 10
    return rows[rows < N]


@pytest.mark.parametrize(
    ("rows", "period", "horizon"),
    [
        pytest.param(
            np.arange(0, N, 4), 4e-3, 0.08, id="a row every 4 ms", marks=pytest.mark.long
        ),
        pytest.param(
            np.r_[0, uneven(np.random.default_rng(1))[1:]], 1e-3, 0.22,
            id="a row every 10 to 12 ms",
        ),
    ],
)  # fmt: skip
def test_an_offset_is_named_at_the_period_of_the_recordings(
    tmp_path: Path, rows: np.ndarray[tuple[int], np.dtype[np.int64]], period: float, horizon: float
) -> None:
    paths = written(tmp_path, rows=rows - rows[0])
    axis = load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml", paths)
    assert axis.plant.period == period
    assert axis.plant.horizon == pytest.approx(horizon, rel=0.01)
    fit, held = (axis.read(path) for path in paths)
    effects = {name: axis.plant.effects[name] for name in RIVALS}
    found = find_gap([fit], [held], replace(axis.plant, effects=effects))
    (effect,) = found.effects
    assert effect.name == "offset"
    assert effect.parameters[0].value == pytest.approx(OFFSET, rel=0.01)
    assert found.gap_after < 1e-3 * found.gap_before


def test_the_model_error_of_a_plant_grows_with_time_whatever_the_period(tmp_path: Path) -> None:
    (path, _) = written(tmp_path, rows=np.arange(0, N, 4))
    slow = load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml", [path]).plant
    quick = load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml").plant
    noises = [[state.noise for state in plant.states] for plant in (slow, quick)]
    assert noises[0] == pytest.approx([2.0 * noise for noise in noises[1]])


def test_a_recording_of_another_period_is_refused_unless_the_model_file_gives_one(
    tmp_path: Path,
) -> None:
    (slow, _) = written(tmp_path, rows=np.arange(0, N, 4))
    axis = load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml")
    with pytest.raises(RecordingError, match="has a row every 4 ms") as raised:
        axis.read(slow)
    assert "add `period` to the model file" in str(raised.value)
    text = (EXAMPLE / "axis.yaml").read_text()
    (tmp_path / "axis.yaml").write_text(text + "period: 2 ms\n")
    stated = load_plant(f"{EXAMPLE / 'axis.py'}:axis", tmp_path / "axis.yaml", [slow])
    assert stated.plant.period == 2e-3
    recording = stated.read(slow)
    assert np.isfinite(recording["position_m"]).mean() == pytest.approx(0.5, abs=0.01)


def test_a_gap_makes_two_parts_of_a_recording(tmp_path: Path) -> None:
    (path, _) = written(tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5000], *lines[5300:]]) + "\n")
    axis = load_plant(f"{EXAMPLE / 'axis.py'}:axis", EXAMPLE / "axis.yaml", [path])
    recording = axis.read(path)
    assert recording.sampling is not None
    assert recording.sampling.gaps == 1
    first, second = usable([record_of(recording, axis.plant)], axis.plant)
    assert len(first) + 300 + len(second) == N
    assert second.first == len(first) + 300
