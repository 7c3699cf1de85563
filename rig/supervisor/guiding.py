"""The control law of a test, from the settings of the rig or of the test and the assumed model."""

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings, Guide, LoopBasis, guide_of
from faults import CampaignTest
from rig.configuration import Rig, control_of, gain_for, with_load
from rig.plant import Model


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
    assumed = with_load(assumed, test)
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
        with_load(assumed, test).parameters,
        gain_for(rig, test),
        rig.limits.command_V,
    )
