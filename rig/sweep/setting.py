"""What all cases of a sweep share, and what comes of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration import Sweep, SweepFilter
from rig.loop import LoopSetting
from rig.plant import Model, Parameters, SensorParameters

from .ticks import BLOCK

Figures = dict[str, NDArray[np.generic]]
"""Columns of the table, of n cases each."""


class SweepError(RuntimeError):
    """Cases that could not be run."""


@dataclass(frozen=True)
class Setting:
    """What all cases of a sweep share, as a worker needs it.

    Attributes:
        like: the rig that every case starts from.
        middle: where open loops begin, m.
        has_spool, has_supply: which of these the rig measures.
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
        """Half seconds of a case."""
        return (self.ticks - 1) // BLOCK


def setting_of(sweep: Sweep) -> Setting:
    """Return what all cases of a sweep share."""
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
