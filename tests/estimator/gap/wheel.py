"""A wheel on a motor as a plant of its own, and records of it that its model may not explain."""

from functools import cache
from math import pi

import numpy as np

from estimator.gap.plant.compile_plant import build
from estimator.gap.plant.description import (
    Channel,
    EquationOf,
    Input,
    MayLack,
    PlantDescription,
    RegionOf,
    StateOf,
    reading,
)
from estimator.gap.plant.interface import Parameter, Plant
from rig.recording import Recording

NOISE = 1e-3


def _rates(state, inputs, par):  # type: ignore[no-untyped-def]
    return ((par.gain * inputs.motor_V - par.drag * state.speed - par.offset) / 2.0,)


def _readings(state, inputs, par):  # type: ignore[no-untyped-def]
    return (state.speed,)


@cache
def wheel() -> Plant:
    """A wheel on a motor, M v' = g u - b v - offset, whose speed is read."""
    described = PlantDescription(
        name="wheel",
        inputs=(Input("motor_V", "V", size=5.0),),
        outputs=(Channel("speed_m_per_s", "m/s", noise=NOISE),),
        states=(StateOf("speed", "m/s", start=reading("speed_m_per_s"), spread=0.01),),
        parameters=(
            Parameter("gain", "N/V", 0.1, 100.0),
            Parameter("drag", "N s/m", 0.1, 100.0),
            Parameter("offset", "N", -50.0, 50.0, neutral=0.0),
        ),
        rates=_rates,
        readings=_readings,
        effects=(MayLack("offset", "M v' = ... - offset", "force", {"value": "offset"}),),
        tolerances={"gain": 0.1, "drag": 0.3},
        equations=(
            EquationOf("force", "N", "speed", lambda state, par: -0.5, error=0.05, of=("speed",)),
        ),
        regions=(RegionOf("speed", "m/s", lambda state, inputs: state.speed),),
        substeps=1,
    )
    return build(described, {"gain": 4.0, "drag": 8.0, "offset": 0.0})


def ran(
    seed: int, seconds: float, *, rate: float = 1.0, gain: float = 4.0, drag: float = 8.0,
    offset: float = 0.0, squared: float = 0.0, lag_s: float = 0.0, late: int = 0,
    quiet: float = 1.0, dry: float = 0.0, hum: float = 0.0, hum_hz: float = 17.0,
    hung: tuple[float, float, float] = (0.0, 1.0, 0.0), creep: tuple[float, float] = (0.0, 1.0),
    brake: tuple[float, float] = (1.0, 0.0), play: float = 0.0,
) -> Recording:  # fmt: skip
    """Record a wheel that may have what no model of it has: dry friction, a slow or late sensor.

    A force that hums begins each recording, by its seed, at another phase. A second wheel may be
    `hung` to it on a spring (mass, kg; frequency, Hz; damping ratio), and a damper that gives way
    in time may hold it (`creep`: N s/m, and the time constant, s). A `brake` acts beyond a speed,
    m/s, either way, with so many N s/m. The sensor follows with a `play`, m/s, either way.
    The sensor's noise is `quiet` times what the model states.
    """
    generator = np.random.default_rng(seed)
    time = np.arange(round(seconds * 1000)) * 1e-3
    volts = sum(
        size * np.sin(2.0 * pi * rate * hertz * time + generator.uniform(0.0, 2.0 * pi))
        for size, hertz in ((3.0, 0.4), (1.5, 2.3), (1.0, 7.0))
    )
    hums = hum * np.sin(2.0 * pi * hum_hz * time + 2.1 * seed)
    speed = read = swings = twist = dragged = 0.0
    mass, hertz, damping = hung
    spring, damper = mass * (2.0 * pi * hertz) ** 2, 2.0 * damping * mass * 2.0 * pi * hertz
    read_of = np.empty(len(time))
    for row in range(len(time)):
        read += 0.0 if lag_s == 0.0 else 1e-3 / (lag_s + 1e-3) * (speed - read)
        if lag_s == 0.0:
            read = min(max(read, speed - play), speed + play)
        read_of[row] = read
        force = (
            gain * volts[max(row - late, 0)] - drag * speed - offset - dry * np.tanh(6.0 * speed)
        )
        pulls = spring * twist + damper * (swings - speed)
        swings -= 1e-3 * pulls / mass if mass > 0.0 else 0.0
        force += pulls - creep[0] * (speed - dragged)
        force -= brake[1] * (speed - min(max(speed, -brake[0]), brake[0]))
        dragged += 1e-3 / creep[1] * (speed - dragged)
        speed += 1e-3 * (force + hums[row] - squared * speed * abs(speed)) / 2.0
        twist += 1e-3 * (swings - speed)
    noise = quiet * NOISE * generator.standard_normal(len(time))
    channels = {"time_s": time, "motor_V": volts, "speed_m_per_s": read_of + noise}
    return Recording(channels, source=f"wheel {seed}")
