"""Simulates a positioning axis, to test the gap workflow with docs/another_plant/axis.py.

The simulation shares no code with that plant. Over steps of 10 us, it integrates Dahl's friction
exactly and the carriage semi-implicitly. The plant of the page uses Runge-Kutta with 250 us and a
friction state of another form. Position loop, noise and encoder resolution are different too.
"""

from collections.abc import Mapping
from math import cos, exp, pi, sin
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S: Final = 1e-5
TRUE: Final = {
    "gain": 35.0, "mass": 95.0, "viscous": 200.0, "coulomb": 20.0, "contact": 20e-6,
    "offset": 0.0, "coulomb_asymmetry": 0.0, "viscous_asymmetry": 0.0, "stribeck_force": 0.0,
    "stribeck_velocity": 0.02, "cogging": 0.0, "phase": 0.0, "pitch": 0.03, "delay": 0.0,
    "tight": 0.0, "quadratic": 0.0, "spring": 0.0, "spring_from": 0.13,
}  # fmt: skip


@njit(cache=True, error_model="numpy")
def _run(reference, voltage, closed, par, delay, noise, period, substeps):  # type: ignore[no-untyped-def]
    gain, mass, fv, fc, contact, offset, ac, av, fs, vs, cogging, phase, pitch = par[:13]
    tight, quadratic, spring, spring_from = par[13:]
    n = reference.size
    position, commanded = np.empty(n), np.empty(n)
    q, v, force = reference[0], 0.0, 0.0
    h = period / substeps
    late = round(delay / h)
    queue = np.zeros(late + 1)
    head = 0
    before = q
    for k in range(n):
        measured = q + noise[k]
        if closed:
            rate = (measured - before) / period
            before = measured
            u = 240.0 * (60.0 * (reference[k] - measured) - 0.6 * rate - 0.4 * v)
            u = min(10.0, max(-10.0, u + voltage[k]))
        else:
            u = voltage[k]
        position[k], commanded[k] = q, u
        for _ in range(substeps):
            queue[head] = u
            head = (head + 1) % (late + 1)
            acting = queue[head]
            level = fc * (1.0 + ac * (1.0 if v > 0.0 else -1.0)) + fs * exp(-((v / vs) ** 2))
            level += tight * (q - 0.1)
            limit = level if v > 0.0 else -level
            old = force
            force = limit + (force - limit) * exp(-abs(v) * h * (fc / contact) / level)
            damping = 5e-3 * (force - old) / h
            drag = fv * (1.0 + av * (1.0 if v > 0.0 else -1.0))
            push = gain * acting - offset - force - damping
            push -= quadratic * v * abs(v) + spring * max(0.0, q - spring_from)
            push -= cogging * sin(2.0 * pi * q / pitch + phase)
            faster = (mass * v + h * push) / (mass + h * drag)
            q += 0.5 * h * (v + faster)
            v = faster
    return position, commanded


def recorded(
    motion: str,
    seed: int,
    seconds: float = 12.0,
    resolution: float = 1e-6,
    period: float = 1e-3,
    rows: Any = None,
    **hidden: float,
) -> dict[str, Array]:
    """Return the channels of a recording of an axis, by name.

    Args:
        motion: "strokes", "sines" or "open loop".
        seed: draws motion and noise.
        seconds: length of the recording.
        resolution: of the encoder, m; 0 means no rounding.
        period: of the samples, s.
        rows: samples (m,), ascending from 0, that are recorded; in open loop the voltage changes at
            these only. None for all.
        hidden: values of the axis that replace those in `TRUE`. No effect of the plant has these:
            friction that grows along the stroke from its middle on (tight, N/m), a drag with the
            square of the velocity (quadratic, N/(m/s)^2), and a spring (N/m) from a position on
            (spring_from, m).
    """
    values = {**TRUE, **hidden}
    assert set(values) == set(TRUE)
    generator = np.random.default_rng(seed)
    n = round(seconds / period)
    time = np.arange(n, dtype=np.float64) * period
    reference, voltage = np.full(n, 0.1), np.zeros(n)
    if motion == "strokes":
        reference = _strokes(time, generator)
    elif motion == "sines":
        for frequency, amplitude in ((0.31, 0.05), (0.9, 0.012), (2.3, 0.003)):
            reference += amplitude * np.sin(
                2.0 * pi * frequency * time + generator.uniform(0.0, 2.0 * pi)
            )
        reference += (0.1 - reference[0]) * np.exp(-time)
    elif motion == "open loop":
        for frequency in (0.45, 1.1, 2.7):
            voltage += (
                1.4
                * cos(generator.uniform(0, 1))
                * np.sin(2.0 * pi * frequency * time + generator.uniform(0.0, 2.0 * pi))
            )
    else:
        raise ValueError(motion)
    kept = np.arange(n) if rows is None else rows
    voltage = voltage[kept][np.searchsorted(kept, np.arange(n), side="right") - 1]
    order = ("gain", "mass", "viscous", "coulomb", "contact", "offset", "coulomb_asymmetry",
             "viscous_asymmetry", "stribeck_force", "stribeck_velocity", "cogging", "phase",
             "pitch", "tight", "quadratic", "spring", "spring_from")  # fmt: skip
    par = tuple(float(values[key]) for key in order)
    noise = 0.7e-6 * generator.standard_normal(n)
    position, commanded = _run(
        reference, voltage, motion != "open loop", par, values["delay"], noise, period,
        round(period / STEP_S),
    )  # fmt: skip
    read = position + noise
    if resolution > 0.0:
        read = np.floor(read / resolution + 0.5) * resolution
    channels = {"time_s": time, "motor_V": commanded, "position_m": read}
    return {name: values[kept] for name, values in channels.items()}


def _strokes(time: NDArray[Any], generator: np.random.Generator) -> NDArray[Any]:
    """Return a setpoint (n,), m, of strokes with different speeds, with a rest after each."""
    reference = np.empty(len(time))
    at, k = 0.1, 0
    while k < len(time):
        to = generator.uniform(0.01, 0.19)
        speed = generator.uniform(0.02, 0.2)
        ramp = 0.1
        moving = abs(to - at) / speed + ramp
        count = min(round((moving + 0.3) * 1e3), len(time) - k)
        s = np.arange(count) * 1e-3
        shape = np.clip(s, 0.0, ramp) ** 2 / (2.0 * ramp) + np.clip(s - ramp, 0.0, None)
        stop = np.clip(s - (moving - ramp), 0.0, ramp)
        shape -= stop**2 / (2.0 * ramp) + np.clip(s - moving, 0.0, None)
        reference[k : k + count] = at + (to - at) * shape / (moving - ramp)
        at, k = to, k + count
    return reference


def write_csv(path: Any, channels: Mapping[str, Array]) -> None:
    """Write the given channels as the columns of a CSV file."""
    header = ",".join(channels)
    np.savetxt(path, np.column_stack(list(channels.values())), delimiter=",", header=header,
               comments="", fmt="%.9g")  # fmt: skip
