"""Where fits of some effects start: read from the motion and from what it left unexplained."""

from collections.abc import Mapping, Sequence
from math import pi
from typing import Final

import numpy as np

from rig.plant.integrator import TICK

from .plant import Array, Trace

Starts = tuple[Mapping[str, float], ...]

_SPOOL, _SPOOL_VELOCITY, _PRESSURES, _POSITION, _SUPPLY = 0, 1, (2, 3), 4, 7
"""States that proposals look at."""
_PRESSURE_READINGS: Final = (1, 2)

_STIFFNESSES: Final = (3e3, 3e4)
"""N/m of springs that are tried."""
_STOPS: Final = (4e6, 3e7)
"""N/m of stops that are tried: soft ones give way by some mm."""
_WITHIN: Final = (3e-4, 2e-3)
"""m inside the farthest position at which a stop may begin."""
_RIPPLE: Final = 3e4
"""Pa: a ripple as large as the noise of a reading."""
_SLOWEST, _FASTEST = 5.0, 400.0
"""Hz, of a pump's ripple."""
_FINER: Final = 4
"""Times finer than the resolution of the longest recording, so that a phase keeps to its end."""
_BAND: Final = 20.0
"""Hz. A line whose reach comes and goes with the opening spreads over some Hz."""
_OVER_NOISE: Final = 20.0
"""Of a line in a spectrum over its median; the highest of 1e5 chance lines is at 17."""


def propose_spring(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return springs that the ram meets at places spread over its motion."""
    position = np.concatenate([trace.states[:, _POSITION] for trace in traces])
    places = np.quantile(position, (0.02, 0.25, 0.5, 0.75, 0.9))
    return tuple(
        {"stiffness": stiffness, "contact": float(place)}
        for stiffness in _STIFFNESSES
        for place in places
    )


def propose_end_stop(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return stops a little inside the farthest positions on both sides."""
    position = np.concatenate([trace.states[:, _POSITION] for trace in traces])
    low, high = float(position.min()), float(position.max())
    starts: list[Mapping[str, float]] = []
    for stiffness in _STOPS:
        for within in _WITHIN:
            starts.append({"stiffness": stiffness, "low": low + within})
            starts.append({"stiffness": stiffness, "high": high - within})
    return tuple(starts)


def propose_rate_limit(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return limits just below the spool's greatest speeds: one that acts is hardly passed."""
    speed = np.abs(np.concatenate([trace.states[:, _SPOOL_VELOCITY] for trace in traces]))
    return tuple(
        {"value": max(float(limit), 5e-3)}
        for limit in (0.95 * np.quantile(speed, 0.999), 0.5 * np.quantile(speed, 0.999))
    )


def _unexplained(trace: Trace, values: Mapping[str, float]) -> Array:
    """Return what of pressures (n,) is unexplained, by how much of the supply reaches chambers."""
    opening = trace.states[:, _SPOOL] + values["spool_null_bias"]
    total = np.zeros(len(opening))
    for sign, state, reading in zip((1.0, -1.0), _PRESSURES, _PRESSURE_READINGS, strict=True):
        drop = np.abs(trace.states[:, _SUPPLY] - trace.states[:, state])
        # Slope of the flow by the supply pressure, eq. 2.1.
        reach = np.maximum(sign * opening, 0.0) / np.sqrt(np.maximum(drop, 1e5))
        total += reach * np.clip(trace.innovations[:, reading], -5.0, 5.0)
    return np.asarray(total / max(float(np.std(total)), 1e-300))


def propose_ripple(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return ripples at the strongest line of what the pressures leave unexplained, if any.

    The pump's phase is taken to be the same at the first sample of every recording.
    """
    length = _FINER * max(len(trace.inputs) for trace in traces)
    spectrum = sum(np.fft.rfft(_unexplained(trace, values), length) for trace in traces)
    power = np.abs(np.asarray(spectrum)) ** 2
    frequency = np.fft.rfftfreq(length, TICK)
    band = (frequency >= _SLOWEST) & (frequency <= _FASTEST)
    # Against the lines around: other effects raise whole bands.
    wide = max(int(_BAND / (frequency[1] - frequency[0])), 1)
    levels = np.array([np.median(part) for part in np.array_split(power, len(power) // wide or 1)])
    around = np.interp(np.arange(len(power)), (np.arange(len(levels)) + 0.5) * wide, levels)
    ratio = np.where(band, power / np.maximum(around, 1e-300), 0.0)
    best = int(ratio.argmax())
    if ratio[best] < _OVER_NOISE:
        return ()
    return tuple(
        {
            "amplitude": values["supply_ripple"] or _RIPPLE,
            "frequency": float(frequency[best]),
            "phase": phase,
        }
        for phase in (0.0, 0.5 * pi, pi, 1.5 * pi)
    )
