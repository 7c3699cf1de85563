"""The sizes that hidden effects are counted in are those from which the workflow would see them."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.variables import effect_variables
from estimator.gap.search.findings import CHANCE, MATERIAL
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model
from rig.recording import read_recording
from tools.hidden_effects.drawn_trials import THE_SMALLER, distance, drawn_trial, write_recordings
from tools.hidden_effects.menu import MENU
from tools.hidden_effects.shown import smallest_shown
from tools.hidden_effects.trials import Plan, drawn_for

pytestmark = pytest.mark.long

SECONDS = 4.0


@pytest.fixture(scope="module")
def identify(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    files = write_recordings(
        drawn_trial("none", 3, 1, seconds=SECONDS), tmp_path_factory.mktemp("a")
    )
    return [files["identify_1"], files["identify_2"]]


def test_most_effects_have_a_limit_and_it_is_no_larger_than_what_is_hidden(
    identify: list[Path],
) -> None:
    limits = smallest_shown(identify, drawn_trial("none", 3, 1).envelope.nuisances)
    assert set(limits) <= set(MENU)
    assert len([size for size in limits.values() if np.isfinite(size)]) > 20
    assert 0.0 < limits["spool_null_bias"] < 2e-6
    assert 0.0 < limits["pressure_1_bias"] < 5e4


@pytest.mark.parametrize("effect", ["pressure_1_bias", "constant_force", "valve_deadband"])
def test_an_effect_adds_to_the_cost_above_its_limit_and_hardly_below(
    identify: list[Path], effect: str
) -> None:
    nuisances = drawn_trial("none", 3, 1).envelope.nuisances
    limit = smallest_shown(identify, nuisances)[effect]
    plant = servo_actuator(Model())
    variable = effect_variables(plant.effects[effect])[0]
    with ThreadPoolExecutor(1) as pool:
        records = [record_of(read_recording(file), plant) for file in identify]
        filtered = Fitter(Predictor(plant), records, pool).filtered(plant.nominal)
        base = filtered.innovations(plant.nominal)
        moved = []
        for times in (0.2, 5.0):
            changed = filtered.innovations(variable.put(plant.nominal, times * limit))
            moved.append(
                sum(float(np.square(c - b)[500:].sum())
                    for (c, _), (b, _) in zip(changed, base, strict=True))
            )  # fmt: skip
        least, most = CHANCE, max(CHANCE, MATERIAL * filtered.samples)
    # The nuisances take some of it, and an effect that acts in few readings has a lower bar.
    assert moved[0] < most
    assert moved[1] > least


@pytest.mark.long
def test_what_is_hidden_in_a_trial_is_at_least_so_many_times_its_limit(tmp_path: Path) -> None:
    envelopes = [
        drawn_for(Plan("single", 5, number, SECONDS, 3.0), tmp_path / "shown").envelope
        for number in range(3)
    ]
    counted = [e for e in envelopes if e.shown and e.shows(3.0)]
    assert counted
    for envelope in counted:
        ((name, limit),) = envelope.shown.items()
        size = distance(name, envelope.effects[name])
        assert size <= limit / 3.0 if name in THE_SMALLER else size >= 3.0 * limit
        assert not envelope.shows(1e9)
    assert not (tmp_path / "shown").exists()
