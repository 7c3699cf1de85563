"""An interlock that tests feed with samples that are sound unless they say otherwise."""

from collections.abc import Iterable, Mapping
from math import nan
from typing import Any

import numpy as np

from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.check_tolerances import Tolerances, tolerances
from rig.loop.interlocks.judging import Tick, check_sample, interlock
from rig.loop.interlocks.ladder import Action, Cause, channel_name, limit_table
from rig.loop.interlocks.plausibility import Evidence
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET

SUPPLIED = frozenset({"position_m", "pressure_1_Pa", "pressure_2_Pa"})
SETTINGS = HomingSettings()
TOL = tolerances(NOMINAL, DATA_SHEET, SUPPLIED, TICK, 0.02, SETTINGS)

Found = tuple[Action, Cause, str]
NOTHING: Found = (Action.NONE, Cause.NONE, "")


class Judge:
    """An interlock and the last sample; each step changes what it is given, in SI."""

    def __init__(self, limits: Iterable[ChannelLimit] = (), tol: Tolerances = TOL) -> None:
        self.interlock = interlock(limit_table(limits, TICK), tol)
        self.memory = self.interlock.memory
        self.counter = 0
        self.echo_lag = 0
        self.sample = {
            "position_m": 0.3,
            "pressure_1_Pa": 7e6,
            "pressure_2_Pa": 7e6,
            "estop_closed": 1.0,
            "valve_enabled": 1.0,
            "watchdog_tripped": 0.0,
            "encoder_fault": 0.0,
        }

    @property
    def evidence(self) -> Evidence:
        """What the plausibility checks remember."""
        return Evidence(*(float(each) for each in self.memory.evidence))

    def step(
        self,
        changed: Mapping[str, float] | None = None,
        *,
        fresh: bool = True,
        new: bool = True,
        elapsed: int = 1,
        exchange: float = 0.15,
        age: int = 0,
        command: float = 0.0,
        output: float | None = None,
        driving: bool = True,
        homed: bool = True,
        place: int = 0,
        **more: float,
    ) -> Found:
        """Judge one tick whose sample has changed; `new`: whether the device took it anew."""
        values = {**(changed or {}), **more}
        self.counter += 1
        self.sample |= values
        # Noise of the transducers, so that nothing looks frozen.
        noise = 1.0 if self.counter % 2 else -1.0
        told = dict(self.sample)
        for channel in ("pressure_1_Pa", "pressure_2_Pa", "load_N", "supply_pressure_Pa"):
            if channel in told and channel not in values:
                told[channel] += noise
        if new:
            self.sample["device_counter"] = told["device_counter"] = float(self.counter % 65536)
        told["device_echo"] = float((self.counter - self.echo_lag) % 65536)
        told["device_command_V"] = command if output is None else output
        told |= values
        inputs = np.array([told.get(name, nan) for name in FAST_INPUTS])
        action, cause, channel_at = check_sample(
            Tick(
                inputs, fresh, elapsed, exchange, age, command, float(self.counter % 65536),
                driving, homed, nan, 0, self.counter, place,
            ),
            self.interlock,
        )  # fmt: skip
        return Action(action), Cause(cause), channel_name(channel_at)

    def steps(
        self, count: int, changed: Mapping[str, float] | None = None, **given: Any
    ) -> list[Found]:
        """Judge so many ticks that are alike."""
        return [self.step(changed, **given) for _ in range(count)]
