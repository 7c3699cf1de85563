"""The tolerances with which the samples of a configured rig are checked, on any bench."""

from dataclasses import replace
from math import inf
from typing import Final

from rig.configuration import Rig
from rig.io import HomingSettings, TransducerCalibration
from rig.loop import Tolerances, tolerances
from rig.plant import Model

_OTHER_CHAMBER: Final = {"pressure_1_Pa": "pressure_2_Pa", "pressure_2_Pa": "pressure_1_Pa"}


def checks_for(rig: Rig, assumed: Model, fitted: frozenset[str], period_s: float) -> Tolerances:
    """Return the tolerances with which the samples of a rig are checked.

    Args:
        rig: the rig, with its transducers, their calibrations, and its limits.
        assumed: the model with which the samples must agree.
        fitted: channels that must have values in every sample.
        period_s: time from one sample to the next, s.
    """
    found = tolerances(
        assumed.parameters,
        rig.sensors,
        fitted,
        period_s,
        rig.loop.stale_limit,
        rig.homing or HomingSettings(),
        rig.limits.command_V,
        tuple(_as_wired(each, rig) for each in rig.calibrations),
    )
    return found._replace(null_V=float(rig.control.null))


def _as_wired(calibration: TransducerCalibration, rig: Rig) -> TransducerCalibration:
    """Return the calibration under the channel in which its transducer's readings are judged."""
    channel = calibration.channel
    if rig.wiring.pressures == "swapped":
        channel = _OTHER_CHAMBER.get(channel, channel)
    return replace(calibration, channel=channel)


def unproven_checks_for(
    rig: Rig, assumed: Model, fitted: frozenset[str], period_s: float
) -> Tolerances:
    """Return tolerances for a rig whose signs are not known yet, as while it is commissioned.

    What compares the sign of one channel with that of another is not judged: travel with flow, work
    with force, spool with command, and whether the command raises the load pressure, of which
    `rig.supervisor.unproven` takes care. All that concerns a channel by itself, or the device, is
    judged. The command may be greater by the largest null bias of a valve that `tolerances` allows,
    as null is not known either. Arguments are as of `checks_for`.
    """
    usual = checks_for(rig, assumed, fitted, period_s)
    return usual._replace(
        unhomed_load_pressure_Pa=inf,
        work_J=inf,
        flow_account_m=inf,
        spool_m=inf,
        unhomed_command_V=usual.unhomed_command_V + greatest_null_V(usual),
    )


def greatest_null_V(checks: Tolerances) -> float:  # noqa: N802
    """Return the greatest null bias, V, that the checks of a run put up with, of either sign."""
    return checks.null_m / checks.par.valve_gain
