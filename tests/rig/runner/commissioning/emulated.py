"""An unproven rig around the emulated plant, whose clock advances with its commands alone."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.configuration.rigs.rig import Rig
from rig.emulator.instruments import Instruments
from rig.emulator.plant import EmulatedPlant
from rig.io.wiring import Wiring
from rig.plant import TICK
from rig.supervisor.unproven import PUSH, TRAVEL_M, BrokenOffError, pushes_too_hard

Array = NDArray[np.float64]

LOOK_TICKS = 10


class EmulatedUnprovenRig:
    """Stands for `UnprovenRig`; the wires are those of `wiring`, of which it knows nothing.

    Attributes:
        configured: the rig as its file describes it.
        held: gains of the holds, in their order.
        moved: all moves of bypass valves, in their order.
        commands: all commands, V, in their order.
    """

    def __init__(
        self, rig: Rig, wiring: Wiring, null_m: float = 0.0, position: float | None = None
    ) -> None:
        self.configured = rig
        self.held: list[float] = []
        self.moved: list[dict[str, float]] = []
        self.commands: list[float] = []
        self._now_ns = 0
        par = rig.plant.parameters._replace(spool_null_bias=null_m)
        self._plant = EmulatedPlant(
            replace(rig.plant, parameters=par), rig.sensors, clock=lambda: self._now_ns,
            bypass_valves=rig.bypass_valves, position=position,
        )  # fmt: skip
        self._instruments = Instruments(self._plant, wiring)
        self._sign = -1.0 if wiring.valve == "inverted" else 1.0
        self._valves: dict[str, float] = {}

    def check(self) -> None:
        """Do nothing: nobody stops it."""

    def hold(self, gain: float) -> None:
        """Note the gain; no time passes while the ram is held."""
        self.held.append(gain)

    def set_valves(self, wanted: dict[str, float]) -> None:
        """Move bypass valves at once."""
        self.moved.append(dict(wanted))
        self._valves |= wanted
        for kind in ("external_leakage_1", "external_leakage_2"):
            ball, needle = (self._valves.get(f"{kind}_{part}", 0.0) for part in ("ball", "needle"))
            self._plant.set_bypass(kind, ball, needle)

    def play(self, commands: Sequence[float] | Array, gain: float) -> Array:
        """Give the commands, one a millisecond; break off as the real one does.

        The plant is looked at every 10 ms, and each look stands for all rows since.
        """
        rows: list[list[float]] = []
        start: float | None = None
        for at in range(0, len(commands), LOOK_TICKS):
            command = float(commands[at])
            self.commands.append(command)
            self._plant.drive_valve(self._sign * command)
            self._now_ns += round(1e9 * TICK) * LOOK_TICKS
            reading = self._instruments.read()
            start = reading.position if start is None else start
            row = [command, reading.position, reading.pressure_1, reading.pressure_2, reading.spool]
            rows += [row] * LOOK_TICKS
            load = np.array([each[2] - each[3] for each in rows])
            far = abs(reading.position - start) > TRAVEL_M
            if far or pushes_too_hard(load, PUSH * 8e6):
                self._plant.drive_valve(0.0)
                raise BrokenOffError("the ram went too far or pushed too hard")
        return np.array(rows[: len(commands)])


class Seeing:
    """An operator who answers which way the rod moved by what he was told to say."""

    sees = True

    def __init__(self, way: int) -> None:
        self._way = way

    def agrees(self, motion: str, alive: Any) -> bool:
        """Return True."""
        return True

    def way(self, alive: Any) -> int:
        """Return what he was told to say."""
        return self._way
