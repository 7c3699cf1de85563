"""Trials are drawn from their numbers alone, and their files tell nothing of what is hidden."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from rig.recording import read_recording
from tools.hidden_effects.drawn_trials import (
    KINDS,
    RECORDINGS,
    Choice,
    drawn_trial,
    read_envelope,
    recordings,
    write_recordings,
)
from tools.hidden_effects.forms import FORMS
from tools.hidden_effects.menu import MENU
from tools.hidden_effects.off_menu import OFF_MENU
from tools.hidden_effects.rig_values import TABLE
from tools.hidden_effects.sizes import NUISANCES, SIZES


def test_a_trial_is_drawn_from_its_seed_and_number_alone() -> None:
    trials = [drawn_trial("single", 5, number, seconds=1.0) for number in (3, 3, 4)]
    assert trials[0].envelope == trials[1].envelope
    assert trials[0].envelope != trials[2].envelope
    tables = [recordings(trial)["holdout"].table for trial in trials]
    assert np.array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


@pytest.mark.parametrize(
    ("kind", "number", "hidden", "pump", "holdout"),
    [
        ("single", 0, {"position_backlash": {"value": 4.0284366875626196e-4}}, 13543975.727,
         "open_steps"),
        ("single", 5, {"bulk_modulus": {"value": 1085238835.0493603}}, 14010625.962,
         "pseudorandom"),
        ("double", 1, {"payload_mass": {"value": 201.35816032110313},
                       "spool_null_bias": {"value": -1.416247284900098e-05}}, 13976446.963,
         "open_multisine"),
        ("off_menu", 0, {"warming_oil": {"oil_trend": 0.014947071823072013}}, 13285847.459,
         "open_steps"),
        ("off_menu", 3, {"leaking_relief": {"relief_leak": 5.145656609520308e-12,
                                            "relief_pressure": 7790532.926140678}}, 13903595.361,
         "open_sweep"),
        ("unexcited", 2, {"valve_bandwidth": {"value": 427.8710365716923}}, 13503387.350,
         "no_command"),
    ],
)  # fmt: skip
def test_a_seed_draws_what_it_drew_before_there_was_a_choice(
    kind: str, number: int, hidden: dict[str, dict[str, float]], pump: float, holdout: str
) -> None:
    envelope = drawn_trial(kind, 29, number, seconds=1.0).envelope
    found = {**envelope.effects, **envelope.off_menu}
    assert list(found) == list(hidden)
    for name, parameters in hidden.items():
        assert found[name] == pytest.approx(parameters)
    assert envelope.nuisances["pump_pressure"] == pytest.approx(pump)
    assert envelope.motions["holdout"] == holdout
    assert not envelope.forms
    assert not envelope.by_recording


def test_other_forms_come_in_turn_and_the_envelope_says_which() -> None:
    envelopes = [
        drawn_trial("single", 1, number, seconds=0.5, choice=Choice(forms="other")).envelope
        for number in range(len(FORMS))
    ]
    assert {name for envelope in envelopes for name in envelope.effects} == set(FORMS)
    for envelope in envelopes:
        ((name, form),) = envelope.forms.items()
        assert set(FORMS[name][form].sizes) <= set(envelope.effects[name])


def test_what_is_off_the_menu_says_which_answers_are_right() -> None:
    for number in range(2 * len(OFF_MENU)):
        envelope = drawn_trial(
            "off_menu", 1, number, seconds=0.5, choice=Choice(off_menu="all")
        ).envelope
        (places,) = envelope.places.values()
        assert places
        assert all(set(place) == {"equations", "of", "shapes"} for place in places)
        assert read_envelope(json.loads(json.dumps(asdict(envelope)))) == envelope


def test_an_unknown_choice_is_refused() -> None:
    with pytest.raises(ValueError, match="'odd'"):
        Choice(forms="odd")


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
