"""A simulated rig with blocking valves, whose time goes on with each sample."""

from typing import Final

from rig.configuration import Rig
from rig.emulator import EmulatedPlant
from rig.plant import OPEN_CONDUCTANCE, Reading, leak_conductance

PERIOD_NS: Final = 5_000_000
"""Time in ns between two samples. Averages of a quarter of a second are what a leak test uses."""

_WIDE: Final = 3e-7
"""Conductance in m^3/(s Pa^0.5) of a blocking valve that is nearly open: that of the servovalve
fully open, 10 V, so that less than this throttles it."""


class SimulatedLockable:
    """A simulated rig for `run_leak_test`; see `Lockable` for its methods.

    The valves' conductance goes linearly from wide open to the data sheet's greatest leak.

    Args:
        rig: a simulated rig with blocking valves.
        seed: seed of the transducers' noise.
        leaks: coefficients of leaks that the cylinder has, by the names `FAULT_COLUMNS`, SI.
        blocking_leak: share of the data sheet's greatest leak that the blocking valves have.
    """

    def __init__(
        self,
        rig: Rig,
        seed: int = 0,
        leaks: dict[str, float] | None = None,
        blocking_leak: float = 0.5,
    ) -> None:
        valves = rig.blocking_valves
        if valves is None:
            raise ValueError(f"{rig.name} has no blocking valves")
        self._now_ns = 0
        self._plant = EmulatedPlant(
            rig.plant, rig.sensors, seed=seed, clock=lambda: self._now_ns,
            spool_sensor=rig.has_spool_sensor, load_cell=rig.has_load_cell,
            supply_pressure_sensor=rig.has_supply_pressure_sensor,
        )  # fmt: skip
        self._plant.set_leaks(leaks or {})
        self._shut = leak_conductance(max(blocking_leak, 1e-3) * valves.leak, valves.leak_pressure)
        self._per_period = PERIOD_NS * 1e-9 / max(valves.travel_s, PERIOD_NS * 1e-9)
        self._positions = [0.0, 0.0]
        self._targets = (0.0, 0.0)

    @property
    def time_s(self) -> float:
        """Simulated time since the start, s."""
        return self._now_ns * 1e-9

    @property
    def arrived(self) -> bool:
        """Whether both blocking valves are where they were sent."""
        return tuple(self._positions) == self._targets

    def exchange(self, command_V: float) -> Reading:  # noqa: N803
        """Set the command, simulate one period, and return a sample."""
        self._plant.drive_valve(command_V)
        for i, target in enumerate(self._targets):
            way = min(max(target - self._positions[i], -self._per_period), self._per_period)
            self._positions[i] += way
        first, second = map(self._conductance, self._positions)
        self._plant.set_blocking(first, second)
        self._now_ns += PERIOD_NS
        return self._plant.reading()

    def block(self, chamber_1: bool, chamber_2: bool) -> None:
        """Order the blocking valves to shut (true) or to open."""
        self._targets = (float(chamber_1), float(chamber_2))

    def release(self) -> None:
        """Bring the servovalve to null, then open both valves."""
        self.block(True, True)
        self.exchange(0.0)
        self.block(False, False)
        while max(self._positions) > 0.0:
            self.exchange(0.0)

    def _conductance(self, shut: float) -> float:
        """Return what a valve passes that is shut by a share from 0 to 1."""
        if shut <= 0.0:
            return OPEN_CONDUCTANCE
        return max(self._shut, _WIDE * (1.0 - shut))
