"""Runs motions on simulated rigs under a control law, and measures how the ram follows."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings, Setpoint, Sine, Steps
from estimator.filters import start_memory
from rig.configuration import Rig
from rig.plant import Model
from rig.runner.campaign.bench import plain_test
from rig.runner.campaign.simulated_bench import loop_of
from rig.runner.outcomes import step_answers

Array = NDArray[np.float64]

SINE: Final = Sine(0.3, 0.15, 0.5, 0.1)
"""The motion by which laws are compared: 150 mm at 0.5 Hz about mid stroke."""
STEPS: Final = Steps((0.3, 0.32, 0.28, 0.3), 2.0)
"""The steps of `rig tune`: 20 mm, 40 mm back, and 20 mm to where they began."""
TRACKING: Final = ControlSettings(feedforward="model", integral_time=1.0, cyclic=True)
"""The law that docs/tracking.md recommends where nothing was measured on the rig."""
SETTLE_S: Final = 2.0


@dataclass(frozen=True)
class Run:
    """One run of a motion.

    Attributes:
        time_s: (ticks,), s.
        setpoint: (ticks,), m.
        position: (ticks,) as measured, m.
        true_position: (ticks,), m.
        command: (ticks,), V.
    """

    time_s: Array
    setpoint: Array
    position: Array
    true_position: Array
    command: Array

    def error(self, from_s: float = 0.0) -> Array:
        """Return setpoint less measured position from a time on, m."""
        return (self.setpoint - self.position)[self.time_s >= from_s]

    def rms(self, from_s: float = 0.0) -> float:
        """Return the root mean square of the error from a time on, m."""
        return float(np.sqrt(np.mean(self.error(from_s) ** 2)))

    def step_answers(self) -> list[tuple[float, float]]:
        """Return overshoot, as a part of the step, and settling time in s of every step."""
        samples = self.setpoint, self.position, self.time_s
        return step_answers(dict(zip(("setpoint_m", "position_m", "time_s"), samples, strict=True)))

    def swing(self, from_s: float) -> float:
        """Return the range of the true position from a time on, m: how far a held ram moves."""
        return float(np.ptp(self.true_position[self.time_s >= from_s]))

    def hunting(self, from_s: float) -> float:
        """Return how far the true position goes to and fro from a time on, m.

        It is the smaller one of the greatest rise and the greatest fall, so that a ram that creeps
        one way does not hunt.
        """
        found = self.true_position[self.time_s >= from_s]
        rise = found - np.minimum.accumulate(found)
        fall = np.maximum.accumulate(found) - found
        return float(min(rise.max(), fall.max()))


def run(
    rig: Rig,
    setpoint: Setpoint,
    duration_s: float,
    control: ControlSettings,
    gain: float | None = None,
    seed: int = 1,
) -> Run:
    """Run a setpoint on a simulated rig; the loop assumes the nominal model, and nothing trips.

    Args:
        rig: the rig; its plant is the truth.
        setpoint: position, m.
        duration_s: duration, s.
        control: what the position loop adds to gain times error.
        gain: gain of the position loop, V/m; that of the rig if not given.
        seed: draws the transducers' noise.
    """
    rig = replace(rig, control=control, gain_V_per_m=gain or rig.gain_V_per_m)
    start = float(setpoint.sample(np.zeros(1))[0])
    test = plain_test("tracking", setpoint, duration_s, start, SETTLE_S, seed)
    model = Model()
    memory = start_memory("product", model, rig.sensors)
    loop = loop_of(rig, test, memory, model, judged=False)
    loop.position()
    rows = loop.advance(loop.ticks_left)
    names = ("time_s", "setpoint_m", "position_m", "true_position_m", "command_V")
    return Run(*(rows[:, loop.channels.index(name)] for name in names))
