"""Experiments run under the loop by which they plan their motions."""

from dataclasses import replace

from control import Constant, ControlSettings
from rig.configuration import load_rig
from rig.plant import Model
from rig.runner.campaign import plain_test
from rig.runner.experiments.parts import part_campaign


def test_an_experiment_is_proportional_whatever_control_the_rig_has() -> None:
    rig = load_rig("simulated")
    tuned = replace(rig, control=ControlSettings(gain=200.0, feedforward="model"))
    test = plain_test("held", Constant(0.3), 5.0, 0.3, 1.0)
    own = replace(test, control=ControlSettings(null=0.1))
    for each, expected in ((rig, None), (tuned, ControlSettings())):
        first, second = part_campaign("part", "", each, Model(), [test, own]).tests
        assert first.control == expected
        assert second.control == own.control
