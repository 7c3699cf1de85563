"""Tuning finds gains that follow and keep their margins, and leaves alone what would hunt."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.configuration.rigs.rig import Rig, load_rig
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from rig.runner.experiments.parts import ExperimentStoppedError, stroke_of
from rig.runner.experiments.tuning import (
    Tuning,
    _swing,
    exciting_campaign,
    response_campaign,
    run_tuning,
    tuning_figures,
)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("simulated")


@pytest.fixture(scope="module")
def tuned(rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Tuning:
    return run_tuning(rig, Model(), tmp_path_factory.mktemp("tuning"))


def test_the_loop_of_the_sliding_ram_is_found_at_every_place_both_ways(tuned: Tuning) -> None:
    assert [model.extending for model in tuned.models] == 3 * [True] + 3 * [False]
    for model in tuned.models:
        assert model.speed_per_volt == pytest.approx(0.067, rel=0.05)
        assert model.lag_s < 5e-3
        assert model.misfit < 0.1


def test_the_proposed_gains_keep_their_margins_and_follow_within_a_millimetre(
    tuned: Tuning,
) -> None:
    assert tuned.safe
    for margin in tuned.margins_after:
        assert margin.gain_dB >= 12.0
        assert np.degrees(margin.phase) >= 60.0
    before, after = next(each.rms() for each in tuned.responses if each.name == "sine")
    assert before > 0.05
    assert after < 1e-3


def test_the_proposed_control_neither_overshoots_steps_nor_is_late(tuned: Tuning) -> None:
    steps, sine = tuned.responses
    answers = steps.steps()
    assert answers is not None
    overshoot, settling_s = answers[1]
    assert overshoot < 0.02
    assert settling_s < 0.6
    assert sine.steps() is None


def test_the_null_of_the_rig_is_measured(rig: Rig, tuned: Tuning) -> None:
    par = rig.plant.parameters
    assert tuned.proposed.null == pytest.approx(-par.spool_null_bias / par.valve_gain, abs=0.015)
    assert tuned.proposed.deadband == 0.0
    assert tuned.proposed.feedforward == "model"


def test_what_is_found_can_be_read_by_programs(tuned: Tuning) -> None:
    figures = json.loads(json.dumps(tuning_figures(tuned), allow_nan=False))
    assert figures["safe"]
    assert len(figures["margins_after"]) == len(figures["models"]) == 6


def test_a_deadband_is_measured_and_bridged(rig: Rig, tmp_path: Path) -> None:
    worn = replace(rig, plant=rig.plant.with_effect("valve_deadband", value=2e-5))
    tuned = run_tuning(worn, Model(), tmp_path)
    assert tuned.proposed.deadband == pytest.approx(2e-5 / 2.794e-5, rel=0.15)
    _, after = next(each.rms() for each in tuned.responses if each.name == "sine")
    assert tuned.safe
    assert after < 3e-3


def test_play_in_the_valve_is_no_deadband_and_raises_no_gain(rig: Rig, tmp_path: Path) -> None:
    worn = replace(rig, plant=rig.plant.with_effect("valve_hysteresis", value=1.5e-5))
    tuned = run_tuning(worn, Model(), tmp_path)
    assert tuned.safe
    assert tuned.proposed.deadband == 0.0
    assert tuned.proposed.gain == rig.gain_V_per_m
    assert any("play" in remark for remark in tuned.remarks)


def test_a_gain_at_which_a_held_ram_swings_is_halved_and_at_last_not_proposed(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Every hold counts as one that swings.
    monkeypatch.setattr("rig.runner.experiments.tuning.HUNTING_M", -1.0)
    monkeypatch.setattr("rig.runner.experiments.tuning._MOST_HOLDS", 2)
    tuned = run_tuning(rig, Model(), tmp_path)
    assert sum("swings" in remark for remark in tuned.remarks) == 2
    assert tuned.proposed.gain == 50.0
    assert tuned.hunts
    assert not tuned.safe


def test_missed_ticks_are_no_swing_and_a_hold_without_samples_proves_nothing() -> None:
    time_s = np.arange(20_000, dtype=np.float64) * TICK
    position = np.where(np.arange(20_000) % 100 == 7, np.nan, 0.3)
    assert _swing(Recording({"time_s": time_s, "position_m": position})) == 0.0
    assert _swing(Recording({"time_s": time_s, "position_m": position * np.nan})) == np.inf


def test_no_motion_leaves_the_limits_of_the_rig(rig: Rig) -> None:
    low, high = stroke_of(rig)
    campaigns = exciting_campaign(rig, Model()), response_campaign(rig, Model(), rig.control)
    for test in (test for campaign in campaigns for test in campaign.tests):
        asked = test.setpoint.sample(np.arange(round(test.duration_s / TICK)) * TICK)
        assert low - 1e-9 <= asked.min() <= asked.max() <= high + 1e-9


def test_a_trip_ends_the_experiment_and_proposes_nothing(rig: Rig, tmp_path: Path) -> None:
    narrow = replace(
        rig,
        ladder=tuple(
            replace(rung, low=0.2, action="trip") if rung.channel == "position_m" else rung
            for rung in rig.ladder
        ),
    )
    with pytest.raises(ExperimentStoppedError):
        run_tuning(narrow, Model(), tmp_path)
