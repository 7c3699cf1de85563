"""The control law of a test, from the settings of the rig or of the test and the assumed model."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings, Guide, LoopBasis, guide_of
from faults import CampaignTest
from rig.configuration import Rig
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


def guide_for(
    rig: Rig,
    test: CampaignTest,
    samples: NDArray[np.float64],
    assumed: Model,
    control: ControlSettings | None = None,
) -> Guide:
    """Return what the position loop adds to gain times error in a test.

    Args:
        rig: the rig, whose settings count unless the test has its own.
        test: the test; a spring load of its own is known to the feedforward.
        samples: (ticks,) the test's setpoint, one a tick, m or V.
        assumed: the model that filter and loop assume.
        control: other control settings for the running test, in which the gain is given.
    """
    assumed = _with_load(assumed, test)
    settings = control or control_of(rig, test)
    return guide_of(
        test.setpoint,
        samples,
        settings,
        assumed.parameters,
        rig.sensors,
        gain_for(rig, test) if control is None else control.gain or rig.gain_V_per_m,
        rig.limits.command_V,
    )


def basis_for(rig: Rig, test: CampaignTest, assumed: Model) -> LoopBasis:
    """Return what the tables of the move to a test's start are made from; see `guide_for`."""
    return LoopBasis(
        control_of(rig, test),
        _with_load(assumed, test).parameters,
        gain_for(rig, test),
        rig.limits.command_V,
    )


def _with_load(assumed: Model, test: CampaignTest) -> Model:
    """Return a model with the spring load of a test, if it has one."""
    if test.load is None:
        return assumed
    stiffness, contact = test.load.stiffness, test.load.contact
    return assumed.with_effect("spring_load", stiffness=stiffness, contact=contact)
