"""The friction experiment finds, on rigs it knows nothing of, what their friction is."""

from dataclasses import replace
from pathlib import Path

import pytest

from estimator.friction.fit import PARAMETERS
from estimator.friction.samples import Spring
from rig.configuration.campaigns.dry_run import plan_campaign
from rig.configuration.rigs.rig import Rig, load_rig
from rig.plant import NOMINAL, Model
from rig.runner.campaign.stopping import StopFlag
from rig.runner.experiments.friction_experiment import (
    FrictionExperiment,
    experiment_figures,
    revised_model,
    run_friction_experiment,
)
from rig.runner.experiments.friction_plan import (
    break_away_campaign,
    closed_loop_campaign,
    places_of,
    sliding_campaign,
    strokes_at,
)
from rig.runner.experiments.parts import ExperimentStoppedError
from rig.runner.run_folder.directory import DirectoryError
from tools.studies.friction_experiment import unknown_friction

NONE = Spring(0.0, 0.0)
FEW = (0.3, 0.54)


def run(rig: Rig, folder: Path, assumed: Model | None = None, seed: int = 0) -> FrictionExperiment:
    """Run the experiment, but for fewer places and speeds."""
    return run_friction_experiment(
        rig, assumed or Model(), NONE, folder, places=4, speeds=FEW, seed=seed
    )


def test_friction_that_nobody_told_of_is_found(tmp_path: Path) -> None:
    truth = unknown_friction(1)
    rig = replace(load_rig("simulated"), plant=Model(parameters=truth))
    found = run(rig, tmp_path, seed=1)
    assert found.fit is not None
    assert found.level.places == 4
    for name in PARAMETERS:
        estimate = found.fit.estimates[name]
        assert estimate.value is not None
        assert estimate.standard_error is not None
        error = abs(estimate.value - getattr(truth, name))
        assert error < 3.5 * estimate.standard_error, name
    # The nominal model is wrong by more than that: what was found is not what was assumed.
    error = found.fit.estimates["stiction"].standard_error
    assert error is not None
    assert error < 25.0
    assert found.null_V == pytest.approx(-truth.spool_null_bias / truth.valve_gain, abs=2e-3)


@pytest.mark.long
def test_the_model_it_writes_has_the_friction_and_says_where_it_is_from(tmp_path: Path) -> None:
    found = run(load_rig("simulated"), tmp_path)
    model = revised_model(found, tmp_path, "2020-01-01 00:00")
    assert model is not None
    assert found.fit is not None
    assert model.parameters.stiction == found.fit.values[1]
    assert "friction_asymmetry" in model.effects
    assert model.parameters.bulk_modulus == NOMINAL.bulk_modulus
    assert set(model.provenance["recordings"]) == set(found.recordings)
    assert all((tmp_path / name).is_file() for name in found.recordings)
    low, high = model.provenance["intervals_95"]["stiction"]
    assert low < model.parameters.stiction < high
    figures = experiment_figures(found)
    assert figures["identified"]
    assert len(figures["break_away"]["all"]) == 8


OVERLAP = Model().with_effect("valve_deadband", value=2e-6)
UNDERLAP = Model().with_effect("valve_underlap_leakage", value=2e-6)
A_THIRD = Model(parameters=NOMINAL._replace(valve_gain=NOMINAL.valve_gain / 3.0))


@pytest.mark.long
@pytest.mark.parametrize(
    "plant",
    [OVERLAP, UNDERLAP],
    ids=["over", "under"],
)
def test_ramps_that_do_not_move_the_ram_are_repeated_in_closed_loop(
    plant: Model, tmp_path: Path
) -> None:
    found = run(replace(load_rig("simulated"), plant=plant), tmp_path)
    assert any("friction_break_away_closed_loop" in name for name in found.recordings)
    assert found.level.places == 4
    assert 0.5 * (found.places[-1][1].force - found.places[-1][0].force) == pytest.approx(
        2400.0, abs=25.0
    )


def test_a_valve_far_off_null_does_not_push_the_ram_into_the_ends(tmp_path: Path) -> None:
    plant = Model().with_effect("spool_null_bias", value=-1e-5)
    found = run(replace(load_rig("simulated"), plant=plant), tmp_path)
    assert found.null_V == pytest.approx(0.358, abs=5e-3)
    assert found.level.places == 4
    assert found.level.level == pytest.approx(2395.0, abs=10.0)


def test_a_spool_that_goes_a_third_of_its_way_trips_as_on_hardware(tmp_path: Path) -> None:
    with pytest.raises(ExperimentStoppedError, match="the spool does not follow the command"):
        run(replace(load_rig("simulated"), plant=A_THIRD), tmp_path)


def test_a_valve_farther_off_null_than_the_interlock_grants_trips_as_on_hardware(
    tmp_path: Path,
) -> None:
    plant = Model().with_effect("spool_null_bias", value=-5e-5)
    with pytest.raises(ExperimentStoppedError, match="tripped; the position does not move as"):
        run(replace(load_rig("simulated"), plant=plant), tmp_path)


def test_a_stop_ends_it_and_nothing_is_said_to_be_identified(tmp_path: Path) -> None:
    stop = StopFlag()
    stop.request("the operator")
    with pytest.raises(ExperimentStoppedError) as stopped:
        run_friction_experiment(load_rig("simulated"), Model(), NONE, tmp_path, stop=stop)
    assert stopped.value.exit_code == 3


def test_a_folder_that_is_not_its_own_is_refused(tmp_path: Path) -> None:
    (tmp_path / "friction_sliding").mkdir()
    (tmp_path / "friction_sliding" / "notes.txt").write_text("mine")
    with pytest.raises(DirectoryError):
        run(load_rig("simulated"), tmp_path)


def test_every_motion_keeps_to_the_limits_and_to_what_the_valve_delivers() -> None:
    rig = load_rig("simulated")
    par = rig.plant.parameters
    null = -par.spool_null_bias / par.valve_gain
    campaigns = (
        sliding_campaign(rig, Model()),
        break_away_campaign(rig, Model(), null, places_of(rig, null)),
        closed_loop_campaign(rig, Model(), null, places_of(rig, null)),
    )
    plans = [plan for campaign in campaigns for plan in plan_campaign(campaign, rig)]
    assert len(plans) == 12 + 10 + 10
    for plan in plans:
        assert not plan.warnings, plan.test.name
        assert plan.position_range_m[0] >= rig.limits.position_min_m
        assert plan.position_range_m[1] <= rig.limits.position_max_m


def test_strokes_are_where_the_setpoint_moves_at_their_speed() -> None:
    motion, strokes = strokes_at(0.2, 0.05, 0.55)
    assert len(strokes) == 4
    for stroke, sign in zip(strokes, (1.0, -1.0, 1.0, -1.0), strict=True):
        first, last = motion.sample([stroke.start_s, stroke.end_s])  # type: ignore[arg-type]
        assert (last - first) / (stroke.end_s - stroke.start_s) == pytest.approx(0.2 * sign)
