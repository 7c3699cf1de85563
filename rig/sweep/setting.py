"""Defines the settings that all cases of a sweep share, and the columns of their results."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration import Sweep, SweepFilter
from rig.loop import LoopSetting
from rig.plant import Model, Parameters, SensorParameters

from .ticks import BLOCK

Figures = dict[str, NDArray[np.generic]]
"""Columns of the table by their names, with one value for each of n cases."""


class SweepError(RuntimeError):
    """Raised if cases of a sweep cannot be run; the message says why."""


@dataclass(frozen=True)
class Setting:
    """The settings that all cases of a sweep share, as a worker needs them.

    Attributes:
        like: parameters of the rig, of which each case replaces those that are drawn.
        sensors: data sheet of the rig's transducers.
        model: the model that the filter assumes.
        ticks: number of ticks of a case.
        loop: settings of the position loop.
        middle: middle of the rig's position limits, at which a case in open loop begins, m.
        has_spool, has_supply: whether the rig measures spool position and supply pressure.
    """

    like: Parameters
    sensors: SensorParameters
    model: Model
    filter_name: SweepFilter
    false_alarms_per_day: float
    ticks: int
    loop: LoopSetting
    middle: float
    has_spool: bool
    has_supply: bool

    @property
    def blocks(self) -> int:
        """Number of blocks, of half a second each, in a case."""
        return (self.ticks - 1) // BLOCK


def setting_of(sweep: Sweep) -> Setting:
    """Return the settings that all cases of a sweep share."""
    base = sweep.rig
    return Setting(
        like=base.plant.parameters,
        sensors=base.sensors,
        model=sweep.model,
        filter_name=sweep.filter_name,
        false_alarms_per_day=sweep.false_alarms_per_day,
        ticks=sweep.ticks,
        loop=LoopSetting(base.gain_V_per_m, base.limits.command_V, sweep.longest_step_s),
        middle=0.5 * (base.limits.position_min_m + base.limits.position_max_m),
        has_spool=base.has_spool_sensor,
        has_supply=base.has_supply_pressure_sensor,
    )
