"""What the position loop of a test works with: its control settings, its gain, and its load."""

from dataclasses import replace

from control import ControlSettings
from faults import CampaignTest
from rig.configuration.rigs import Rig
from rig.plant import Model


def control_of(rig: Rig, test: CampaignTest) -> ControlSettings:
    """Return the control settings of a test: its own, or else those of the rig."""
    return rig.control if test.control is None else test.control


def gain_for(rig: Rig, test: CampaignTest) -> float:
    """Return the gain of the position loop in a test, V/m: its own, or else that of its control."""
    if test.gain_V_per_m is not None:
        return test.gain_V_per_m
    return control_of(rig, test).gain or rig.gain_V_per_m


def control_for(rig: Rig, test: CampaignTest) -> ControlSettings:
    """Return the control settings of a test, in which the gain is given."""
    return replace(control_of(rig, test), gain=gain_for(rig, test))


def motion_key(test: CampaignTest) -> str:
    """Return a text that two tests share if their rams follow the same motion in the same way.

    It tells setpoint, duration, load, control and gain, but no change of the control on the way.
    """
    return repr((test.setpoint, test.duration_s, test.load, test.control, test.gain_V_per_m))


def with_load(model: Model, test: CampaignTest) -> Model:
    """Return a model with the spring load of a test, if it has one."""
    if test.load is None:
        return model
    stiffness, contact = test.load.stiffness, test.load.contact
    return model.with_effect("spring_load", stiffness=stiffness, contact=contact)
