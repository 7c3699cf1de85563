"""This module proposes starts for fits of some effects, from the motion and prediction errors."""

from collections.abc import Mapping, Sequence
from math import pi
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Trace
from rig.plant import TICK

Starts = tuple[Mapping[str, float], ...]

_SPOOL, _SPOOL_VELOCITY, _PRESSURES, _POSITION, _SUPPLY = 0, 1, (2, 3), 4, 7
"""Indices of the states that the proposals use."""
_PRESSURE_READINGS: Final = (1, 2)

_STIFFNESS: Final = 1e4
"""Stiffness of the springs that are proposed, N/m. The force is proportional to it, so that a fit
finds the true one."""
_NEAR_STOP: Final = 6e-3
"""m from the farthest position. A stop of 2 MN/m yields by no more under the whole force of the
pistons."""
_CONTACTS: Final = 5e-5
"""Distance between the places that are tried for a contact, m."""
_RISES: Final = 300.0
"""N. A force must grow by more than this towards the farthest position to look like a stop."""
_STIFFER: Final = (0.6, 1.0, 1.8)
"""Factors on the stiffness that the growth of the force shows. Each is proposed, because friction
blurs that growth."""
_RIPPLE: Final = 3e4
"""Amplitude of a proposed ripple, Pa: as large as the noise of a reading."""
_SLOWEST, _FASTEST = 5.0, 400.0
"""Lowest and highest frequency of a pump's ripple that are tried, Hz."""
_FINER: Final = 4
"""How many times finer the tried frequencies are spaced than the longest recording resolves, so
that the phase of a ripple is right to the recording's end."""
_LATEST: Final = 20
"""Greatest delay of a position that is tried, in ticks."""
_MOVED: Final = 20
"""Number of ticks over which motions are compared; at any usual speed the encoder counts many steps
in them."""
_BAND: Final = 20.0
"""Width of the bands over which the median of a spectrum is taken, Hz. A ripple that reaches a
chamber only at some valve openings spreads over some Hz."""
_OVER_NOISE: Final = 20.0
"""Least ratio of a line to the median of its spectrum. The highest of 1e5 lines of pure noise has a
ratio of 17."""


def propose_spring(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return five starts for a spring, whose contacts are spread over the ram's positions."""
    position = np.concatenate([trace.states[:, _POSITION] for trace in traces])
    places = np.quantile(position, (0.02, 0.25, 0.5, 0.75, 0.9))
    return tuple({"stiffness": _STIFFNESS, "contact": float(place)} for place in places)


def propose_end_stop(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return places and stiffnesses of end stops from which a fit can start.

    At either end of the recorded motion the pistons' force is searched for a place beyond which it
    grows with the position. Each place found gives three starts: its `low` or `high`, m, each time
    with the stiffness that the growth shows times 0.6, 1 or 1.8, but 1 to 60 MN/m. An end where the
    force grows by no more than `_RISES` gives no starts.
    """
    area = values["piston_area"]
    # The readings are used, because the filter's states are wrong on a stop that the model lacks.
    readings = np.concatenate([trace.readings for trace in traces])
    position = readings[:, 0] / values["position_gain"]
    p1, p2 = (
        (readings[:, i] - values[f"pressure_{i}_bias"]) / values[f"pressure_{i}_gain"]
        for i in _PRESSURE_READINGS
    )
    starts: list[Mapping[str, float]] = []
    for key, sign in (("low", -1.0), ("high", 1.0)):
        contact = _contact(sign * position, sign * area * (p1 - p2))
        if contact is not None:
            place, stiffness = contact
            starts += [
                {"stiffness": float(np.clip(share * stiffness, 1e6, 6e7)), key: sign * place}
                for share in _STIFFER
            ]
    return tuple(starts)


def _contact(depth: Array, force: Array) -> tuple[float, float] | None:
    """Return the depth at which a force (n,) begins to grow with the depth (n,), and how steeply.

    For each place c the hinge f + K max(0, depth - c) is fitted to the force by least squares; the
    best c and K are returned. None means that the force does not grow by more than `_RISES`.

    Only samples deeper than c count in the sums of a fit. So all fits follow from sums over the
    samples in the order of their depth, deepest first.
    """
    near = depth > depth.max() - _NEAR_STOP
    order = np.argsort(-depth[near])
    # Depths from the deepest sample and forces about their mean keep the sums of squares exact.
    deepest = float(depth.max())
    below, level = depth[near][order] - deepest, force[near][order]
    level = level - level.mean()
    places = np.arange(deepest - _NEAR_STOP, deepest - _CONTACTS, _CONTACTS)
    counts = np.searchsorted(-below, deepest - places)
    first, second, work, pull = (
        np.concatenate([[0.0], np.cumsum(each)])[counts]
        for each in (below, below**2, below * level, level)
    )
    at = places - deepest
    total = first - counts * at
    spread = second - 2.0 * at * first + counts * at**2 - total**2 / len(below)
    slopes = (work - at * pull) / np.maximum(spread, 1e-300)
    rests = np.where(-slopes * at > _RISES, -(slopes**2) * spread, np.inf)
    if not len(places) or not rests.min() < np.inf:
        return None
    best = int(rests.argmin())
    return float(places[best]), float(slopes[best])


def propose_rate_limit(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return starts for a rate limit: 0.95 and 0.5 times the spool's greatest speed, m/s.

    The greatest speed is the 99.9 % quantile of the filtered speeds; a start is at least 5 mm/s.
    The true limit is near one of them, because the spool hardly exceeds a limit that acts.
    """
    speed = np.abs(np.concatenate([trace.states[:, _SPOOL_VELOCITY] for trace in traces]))
    fastest = float(np.quantile(speed, 0.999))
    return tuple({"value": max(part * fastest, 5e-3)} for part in (0.95, 0.5))


def propose_position_delay(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return a start: the delay in s by which the encoder best follows the oil from the valve.

    The oil's flow is K_1 y sqrt(p_s - sgn(y) p_L) + K_2 dp_L/dt, that of a valve into compressible
    oil (Merritt 1967, ch. 6), with the load pressure p_L = p_1 - p_2 as read. For each delay K_1
    and K_2 are fitted to the speed as read. The delay of 1 to 19 ticks with the least error is
    taken, refined by a parabola. There is no start if no recording shows oil that moves.
    """
    left, usable = np.ones(_LATEST + 1), False
    for trace in traces:
        position, p1, p2, spool = trace.readings.T[:4]
        load, opening = p1 - p2, spool + values["spool_null_bias"]
        drop = np.maximum(values["supply_pressure"] - np.sign(opening) * load, 0.0)
        oil = np.cumsum(opening * np.sqrt(drop))
        moves = np.column_stack([each[_MOVED:] - each[:-_MOVED] for each in (oil, load)])
        largest = np.abs(moves).max(0)
        if not (np.isfinite(largest) & (largest > 0.0)).all():
            continue
        usable = True
        moves = np.column_stack([moves / largest, np.ones(len(moves))])
        moved = position[_MOVED:] - position[:-_MOVED]
        for late in range(_LATEST + 1):
            # The same stretch is compared for every delay.
            known, wanted = moves[: len(moves) - _LATEST], moved[late : len(moved) - _LATEST + late]
            fitted = np.linalg.lstsq(known, wanted, rcond=None)
            left[late] += float(fitted[1].sum())
    if not usable:
        return ()
    best = int(left[1:-1].argmin()) + 1
    before, at, after = left[best - 1 : best + 2]
    curved = before - 2.0 * at + after
    delay = best + (0.5 * (before - after) / curved if curved > 0.0 else 0.0)
    return ({"value": float(np.clip(delay, 0.0, _LATEST)) * TICK},)


def _unexplained(trace: Trace, values: Mapping[str, float]) -> Array:
    """Return what the supply pressure could explain of the pressures' innovations (n,), scaled.

    Each chamber's innovation is weighted by how strongly the supply pressure reaches that chamber
    through the valve. The sum is divided by its standard deviation.
    """
    opening = trace.states[:, _SPOOL] + values["spool_null_bias"]
    total = np.zeros(len(opening))
    for sign, state, reading in zip((1.0, -1.0), _PRESSURES, _PRESSURE_READINGS, strict=True):
        drop = np.abs(trace.states[:, _SUPPLY] - trace.states[:, state])
        # This is the derivative of the flow by the supply pressure, eq. 2.1.
        reach = np.maximum(sign * opening, 0.0) / np.sqrt(np.maximum(drop, 1e5))
        total += reach * np.clip(trace.innovations[:, reading], -5.0, 5.0)
    return np.asarray(total / max(float(np.std(total)), 1e-300))


def propose_ripple(traces: Sequence[Trace], values: Mapping[str, float]) -> Starts:
    """Return starts for a ripple: the strongest line in the pressures' prediction errors.

    Lines from 5 to 400 Hz are tried. There are four starts with different phases, or none if no
    line stands out from the noise (`_OVER_NOISE`). Their amplitude is that of the model, or 30 kPa
    if the model has no ripple. The pump is assumed to have the same phase at the first sample of
    every recording.
    """
    length = _FINER * max(len(trace.inputs) for trace in traces)
    spectrum = sum(np.fft.rfft(_unexplained(trace, values), length) for trace in traces)
    power = np.abs(np.asarray(spectrum)) ** 2
    frequency = np.fft.rfftfreq(length, TICK)
    band = (frequency >= _SLOWEST) & (frequency <= _FASTEST)
    # A line is compared with those around it, because other effects raise whole bands.
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
