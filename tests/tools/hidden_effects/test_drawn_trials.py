"""Trials are drawn from their numbers alone, and their files tell nothing of what is hidden."""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.recording import read_recording
from tools.hidden_effects.drawn_trials import (
    KINDS,
    RECORDINGS,
    drawn_trial,
    read_envelope,
    recordings,
    write_recordings,
)
from tools.hidden_effects.menu import MENU
from tools.hidden_effects.rig_values import TABLE
from tools.hidden_effects.sizes import NUISANCES, SIZES


def test_a_trial_is_drawn_from_its_seed_and_number_alone() -> None:
    trials = [drawn_trial("single", 5, number, seconds=1.0) for number in (3, 3, 4)]
    assert trials[0].envelope == trials[1].envelope
    assert trials[0].envelope != trials[2].envelope
    tables = [recordings(trial)["holdout"].table for trial in trials]
    assert np.array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


def test_every_effect_has_its_turn_before_any_has_a_second() -> None:
    found = [
        name
        for number in range(70)
        for name in drawn_trial("single", 1, number, seconds=0.5).envelope.effects
    ]
    assert set(found[:35]) == set(MENU)
    assert set(found[35:]) == set(MENU)
    assert found[:35] != found[35:]


@pytest.mark.parametrize("kind", KINDS)
def test_a_trial_hides_what_its_kind_says(kind: str) -> None:
    number = {"single": (1, 0), "double": (2, 0), "none": (0, 0), "off_menu": (0, 1)}
    for trial in range(20):
        envelope = drawn_trial(kind, 2, trial, seconds=0.5).envelope
        found = (len(envelope.effects), len(envelope.off_menu))
        assert found == number.get(kind, (1, 0))
        motions = list(envelope.motions.values())
        assert kind == "unexcited" or len(set(motions)) == 3


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="'triple' is not one of single"):
        drawn_trial("triple", 0, 0)


def test_sizes_lie_in_their_intervals_and_nuisances_in_their_tolerances() -> None:
    for number in range(70):
        envelope = drawn_trial("single", 8, number, seconds=0.5).envelope
        ((name, parameters),) = envelope.effects.items()
        for parameter, value in parameters.items():
            if parameter in ("contact", "low", "high"):
                continue
            intervals = SIZES[name][parameter].intervals
            assert any(low <= value <= high for low, high in intervals)
        for nuisance, value in envelope.nuisances.items():
            nominal, tolerance = NUISANCES[nuisance]
            assert abs(value / nominal - 1.0) < tolerance


def test_a_shifted_nuisance_is_the_effect_and_no_nuisance_beside_it() -> None:
    envelopes = [drawn_trial("single", 4, n, seconds=0.5).envelope for n in range(35)]
    (envelope,) = [e for e in envelopes if "bulk_modulus" in e.effects]
    assert "oil_stiffness" not in envelope.nuisances
    assert envelope.values().oil_stiffness == envelope.effects["bulk_modulus"]["value"]
    assert abs(envelope.values().oil_stiffness / TABLE.oil_stiffness - 1.0) > 0.15


def test_limits_keep_sizes_from_being_too_small() -> None:
    limits = {"pressure_1_bias": 5e5, "bulk_modulus": 2e8, "command_delay": 1.0}
    for number in range(70):
        envelope = drawn_trial("single", 8, number, limits, seconds=0.5).envelope
        for name, parameters in envelope.effects.items():
            if name == "pressure_1_bias":
                assert abs(parameters["value"]) >= 5e5
            if name == "bulk_modulus":
                assert abs(parameters["value"] - TABLE.oil_stiffness) >= 2e8
            if name == "command_delay":
                assert parameters["value"] == 0.02


def test_the_product_reads_the_files_and_they_hold_what_was_recorded(tmp_path: Path) -> None:
    trial = drawn_trial("double", 1, 2, seconds=2.0)
    made = recordings(trial)
    files = write_recordings(trial, tmp_path)
    assert tuple(files) == RECORDINGS
    for name, file in files.items():
        channels = read_recording(file).channels
        table = made[name].table
        assert channels["command_V"] == pytest.approx(table[:, 1], abs=1e-9)
        assert channels["position_m"] == pytest.approx(table[:, 2], abs=1e-9)
        assert channels["pressure_1_Pa"] == pytest.approx(table[:, 3], abs=0.051)
        assert channels["spool_m"] == pytest.approx(table[:, 5], rel=1e-4)
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.csv.gz" for name in RECORDINGS}


def test_an_envelope_is_read_as_it_was_written(tmp_path: Path) -> None:
    envelope = drawn_trial("off_menu", 1, 2, seconds=2.0).envelope
    envelope.write(tmp_path / "envelope.json")
    assert read_envelope(json.loads((tmp_path / "envelope.json").read_text())) == envelope
