"""The tolerances with which the samples of a configured rig are checked, on any bench."""

from rig.configuration import Rig
from rig.io import HomingSettings
from rig.loop import Tolerances, tolerances
from rig.plant import Model


def checks_for(rig: Rig, assumed: Model, fitted: frozenset[str], period_s: float) -> Tolerances:
    """Return the tolerances with which the samples of a rig are checked.

    Args:
        rig: the rig, with its transducers, their calibrations, and its limits.
        assumed: the model with which the samples must agree.
        fitted: channels that must have values in every sample.
        period_s: time from one sample to the next, s.
    """
    return tolerances(
        assumed.parameters,
        rig.sensors,
        fitted,
        period_s,
        rig.loop.stale_limit,
        rig.homing or HomingSettings(),
        rig.limits.command_V,
        rig.calibrations,
    )
