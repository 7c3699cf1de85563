"""The plant in real time, which is advanced to the present whenever its state is asked for."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import exp
from typing import Final

import numpy as np
from numpy.typing import NDArray

from faults import BypassValve, Verdict
from rig.channels import BYPASSES
from rig.io import simulated_rig
from rig.plant import (
    DATA_SHEET,
    FAULT_COLUMNS,
    OPEN_CONDUCTANCE,
    READING_COUNT,
    Model,
    PlantState,
    Reading,
    SensorParameters,
    hold_reference,
    throttled,
)

from .advancing import advance_plant, sample_plant, shown_position

Clock = Callable[[], int]
"""Returns the present time in ns, as `time.monotonic_ns` does."""

COMMAND_RANGE: Final = 10.0
"""Greatest command in V, of either sign, at which the valve's amplifier does not saturate."""

PUMP_TIME_CONSTANT: Final = 0.05
"""Time constant in s of the first-order lag by which the supply pressure follows the pump's
unloading valve; it is chosen, not taken from a data sheet."""

_PUMP_STEP_NS: Final = 1_000_000
_BLOCKING_STEP_NS: Final = 1_000_000
_PUMP_SETTLED: Final = 1e3
"""Distance in Pa from its target within which the supply pressure counts as having reached it."""


class EmulatedPlant:
    """The rig's plant with valves, pump and transducers, which moves with a clock.

    The plant rests when it is made, at mid stroke unless `position` says where.

    Args:
        model: the true model of the rig.
        sensors: data sheet of its transducers.
        bypass_valves: the bypass valves, by the fault that each makes; a bypass that is not among
            them makes no leak.
        return_resistance: resistance of the return throttle when shut, Pa/(m^3/s)^2.
        pump_loaded: whether there is pressure from the start.
        seed: seed of the noise.
        clock: returns the time in ns.
        position: where the ram rests at first, m; None for mid stroke.
        fitted: which transducers the rig has, by the names that `rig.io.simulated_rig` takes.

    Attributes:
        pump_loaded: whether the pump delivers pressure.
        time_ns: time in ns up to which the plant has been advanced.
    """

    def __init__(
        self,
        model: Model,
        sensors: SensorParameters = DATA_SHEET,
        *,
        bypass_valves: Mapping[str, BypassValve] | None = None,
        return_resistance: float = 0.0,
        pump_loaded: bool = True,
        seed: int = 0,
        clock: Clock = time.monotonic_ns,
        position: float | None = None,
        **fitted: bool,
    ) -> None:
        self.clock = clock
        self.sensors = sensors
        self._par = model.parameters
        self._full_pressure = self._par.supply_pressure
        self._full_ripple = self._par.supply_ripple
        self._bypass_valves = dict(bypass_valves or {})
        self._return_resistance = return_resistance
        self._fault = np.zeros(len(FAULT_COLUMNS))
        self._sampled = np.empty(READING_COUNT)
        self._command = 0.0
        self._stuck_at: float | None = None
        self._blocking = (OPEN_CONDUCTANCE, OPEN_CONDUCTANCE)
        self.pump_loaded = pump_loaded
        if not pump_loaded:
            self._set_supply(self._par.return_pressure)
        at_rest = replace(model, parameters=self._par)
        self._rig = simulated_rig(at_rest, seed, sensors=sensors, position=position, **fitted)
        self._state = self._rig.state
        self._delay_ns = round(1e9 * self._par.command_delay)
        self._sent: deque[tuple[int, float]] = deque()
        self._compile()
        self.time_ns = clock()

    def _compile(self) -> None:
        """Compile, or load from the cache, the functions that run whenever the plant is read."""
        rig = self._rig
        advance_plant(
            rig.state.copy(), rig.path.copy(), rig.seen.copy(), rig.meters.copy(), 0.0,
            self._par, self._fault, 1e-6, self.sensors.flow_time_constant,
        )  # fmt: skip
        shown_position(rig.state, rig.seen, self._par)
        self._sample(np.zeros(READING_COUNT))

    def catch_up(self, until_ns: int | None = None) -> None:
        """Advance to the present, or to a moment in ns between the last advance and now.

        An earlier moment does nothing.
        """
        until_ns = self.clock() if until_ns is None else until_ns
        while self._sent and self._sent[0][0] <= until_ns:
            acts_ns, command = self._sent.popleft()
            self._move(acts_ns)
            self._command = command
        self._move(until_ns)

    def _move(self, until_ns: int) -> None:
        """Advance to a moment in ns, up to which the acting command does not change.

        Meanwhile the supply pressure follows the pump as it is loaded or unloaded.
        """
        target = self._full_pressure if self.pump_loaded else self._par.return_pressure
        while self._par.supply_pressure != target and self.time_ns < until_ns:
            step_ns = min(_PUMP_STEP_NS, until_ns - self.time_ns)
            left = self._par.supply_pressure - target
            left *= exp(-step_ns * 1e-9 / PUMP_TIME_CONSTANT)
            self._set_supply(target + left if abs(left) > _PUMP_SETTLED else target)
            self._advance(step_ns)
        self._advance(until_ns - self.time_ns)

    def _advance(self, duration_ns: int) -> None:
        if duration_ns <= 0:
            return
        rig = self._rig
        # A stuck spool stands where this command would hold it.
        stuck, command = self._stuck_at, self._command
        acting = command if stuck is None else stuck / self._par.valve_gain
        locked = self._blocking != (OPEN_CONDUCTANCE, OPEN_CONDUCTANCE)
        until_ns = self.time_ns + duration_ns
        while self.time_ns < until_ns:
            # What a blocking valve passes depends on the spool, which moves from tick to tick.
            step_ns = until_ns - self.time_ns
            step_ns = min(step_ns, _BLOCKING_STEP_NS) if locked else step_ns
            opening = float(self._state[0]) + self._par.spool_null_bias
            par = throttled(self._par, opening, self._blocking)
            advance_plant(
                rig.state, rig.path, rig.seen, rig.meters, acting, par,
                self._fault, step_ns * 1e-9, self.sensors.flow_time_constant,
            )  # fmt: skip
            self.time_ns += step_ns

    def _set_supply(self, pressure: float) -> None:
        """Set the pump's pressure in Pa; its ripple is in proportion to that above the return's."""
        back = self._par.return_pressure
        share = (pressure - back) / (self._full_pressure - back)
        ripple = share * self._full_ripple
        self._par = self._par._replace(supply_pressure=pressure, supply_ripple=ripple)

    def drive_valve(self, command_V: float, at_ns: int | None = None) -> None:  # noqa: N803
        """Set the servovalve's command in V, from now on or from a moment since the last advance.

        The command is limited to +-`COMMAND_RANGE`, where the valve's amplifier saturates. It acts
        after the plant's command delay.
        """
        self.catch_up(at_ns)
        command = min(max(command_V, -COMMAND_RANGE), COMMAND_RANGE)
        if self._delay_ns:
            sent_ns = self.time_ns if at_ns is None else max(at_ns, self.time_ns)
            self._sent.append((sent_ns + self._delay_ns, command))
        else:
            self._command = command

    def stick_spool(self, stuck: bool) -> None:
        """Jam the spool where it is, or free it."""
        self.catch_up()
        self._stuck_at = float(self._state[0]) if stuck else None
        hold_reference(self._rig.path, float(self._state[0]))
        self._state[1] = 0.0

    def load_pump(self, loaded: bool) -> None:
        """Load the pump so that it delivers pressure, or unload it so that the pressure collapses.

        The pressure follows with `PUMP_TIME_CONSTANT`.
        """
        self.catch_up()
        self.pump_loaded = loaded

    def set_bypass(self, bypass: str, ball: float, needle: float) -> None:
        """Set the true positions of a bypass, 0 shut to 1 open; the leak by them acts from now on.

        The return throttle has no ball; its resistance is in proportion to its `needle`.

        Raises:
            ValueError: there is no such bypass.
        """
        if bypass not in BYPASSES:
            raise ValueError(f"{bypass}: no such bypass; there are {', '.join(BYPASSES)}")
        self.catch_up()
        coefficient = self._return_resistance * needle
        if bypass != Verdict.RETURN_BLOCKAGE:
            valve = self._bypass_valves.get(bypass)
            coefficient = valve.effective(needle, ball) if valve else 0.0
        self._fault[FAULT_COLUMNS.index(bypass)] = coefficient

    def set_blocking(self, conductance_1: float, conductance_2: float) -> None:
        """Set what the blocking valves of chambers 1 and 2 pass from now on, m^3/(s Pa^0.5).

        A rig without such valves has `OPEN_CONDUCTANCE` in both lines, as has a new plant.
        """
        self.catch_up()
        self._blocking = (conductance_1, conductance_2)

    def set_leaks(self, coefficients: Mapping[str, float]) -> None:
        """Set fault coefficients, SI, by the names `FAULT_COLUMNS`; others stay as they are.

        They are leaks of the cylinder itself, which no bypass makes.
        """
        self.catch_up()
        for name, coefficient in coefficients.items():
            self._fault[FAULT_COLUMNS.index(name)] = coefficient

    @property
    def coefficients(self) -> dict[str, float]:
        """The fault coefficients that act now, SI, by the names `FAULT_COLUMNS`."""
        return dict(zip(FAULT_COLUMNS, map(float, self._fault), strict=True))

    @property
    def truth(self) -> PlantState:
        """The true state now."""
        self.catch_up()
        return PlantState(*map(float, self._state))

    def reading(self) -> Reading:
        """Return a sample of every transducer now, with noise; NaN for those that the rig lacks."""
        self.catch_up()
        return self._sample(self._rig.noise(1)[0])

    def _sample(self, noise: NDArray[np.float64]) -> Reading:
        rig = self._rig
        sample_plant(
            rig.state, rig.seen, rig.meters, rig.offsets, noise, self._par,
            self.sensors, rig.fitted, self._sampled,
        )  # fmt: skip
        return Reading(*self._sampled.tolist())

    def encoder_counts(self) -> int:
        """Return the encoder's count now, from position 0 of the plant, as a whole number."""
        self.catch_up()
        shown = shown_position(self._state, self._rig.seen, self._par)
        return round(shown / self.sensors.position_resolution)
