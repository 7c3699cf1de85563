"""The motions of gap experiments keep to the rig, and are campaigns that `rig check` accepts."""

from pathlib import Path

import numpy as np
import pytest

from rig.cli.models.gap_finding import experiment_file
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.checking import check
from rig.configuration.rigs.rig import load_rig
from rig.plant import Model
from rig.runner.experiments.gap_motions import campaign_of, room_of, sampled, strokes
from rig.runner.experiments.gap_results import rig_plant
from rig.runner.experiments.parts import MARGIN_M

RIG = load_rig("simulated")
LIBRARY = strokes(room_of(RIG), 1)


@pytest.mark.parametrize("name", LIBRARY)
def test_a_motion_written_as_a_campaign_checks_and_is_the_same_motion(
    name: str, tmp_path: Path
) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(experiment_file(campaign_of(LIBRARY[name]), "simulated", "nominal"))
    report = check(file)
    assert not report.warnings
    campaign, _ = load_campaign(file)
    (test,) = campaign.tests
    own = sampled(LIBRARY[name].setpoint, 20.0)
    assert np.array_equal(sampled(test.setpoint, 20.0), own)
    assert own.min() >= RIG.limits.position_min_m + MARGIN_M - 1e-4
    assert own.max() <= RIG.limits.position_max_m - MARGIN_M + 1e-4


@pytest.mark.parametrize("name", [name for name in LIBRARY if "steps" in name])
def test_no_step_asks_for_more_than_the_valve_has(name: str) -> None:
    steps = LIBRARY[name].setpoint
    reach = float(np.ptp(sampled(steps, 20.0)))
    assert RIG.gain_V_per_m * reach < RIG.limits.command_V


def test_another_seed_is_another_motion_of_the_same_kind() -> None:
    for name, other in strokes(room_of(RIG), 2).items():
        one, two = sampled(LIBRARY[name].setpoint, 5.0), sampled(other.setpoint, 5.0)
        assert not np.array_equal(one, two)
        assert type(other.setpoint) is type(LIBRARY[name].setpoint)


def test_the_workflow_gets_the_library_for_its_experiments() -> None:
    plant = rig_plant(Model(), RIG.sensors, room_of(RIG))
    assert [motion.name for motion in plant.motions()] == list(LIBRARY)
    for motion in plant.motions():
        assert motion.inputs.shape == (20_000, 1)
        assert motion.course.shape == (20_000, 4)
        assert motion.campaign["tests"][0]["duration"] == "20 s"
