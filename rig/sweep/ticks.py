"""Compiled ticks of a sweep's cases in lanes: setpoints, plants, transducers, filter, figures.

Nothing returns to Python within a case. What is kept of each half second are sums, from which the
thesis's moving averages follow.
"""

from math import floor
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters import thesis7_step
from rig.jit import njit
from rig.lanes import (
    LANES,
    align_stack,
    anywhere,
    empty_lanes,
    fill_normal,
    gather,
    in_lanes,
    load,
    load_fields,
    select,
    sine_and_cosine,
    store,
)
from rig.loop import (
    COMMAND,
    LOGGED,
    LOGGED_OF_CHAMBERS,
    MOST_STEPS,
    NOISE_COUNT,
    POSITION,
    PRESSURE_1,
    PRESSURE_2,
    RETURN,
    plant_ticks,
    reading_ticks,
)
from rig.plant import (
    TICK,
    Parameters,
    encoder_position,
    inlined,
    pressure_reading,
    reading_means,
    signed_root,
)

from .motions import AMPLITUDE, CHIRP, FREQUENCY, PHASE, SINE_ROWS

BLOCK: Final = 500
"""Ticks of a block, half a second: what figures are kept of, and decisions come after."""
SUMS: Final = (
    "absolute_innovation_1", "absolute_innovation_2", "squared_position", "squared_1", "squared_2",
    "leak_flow",
)  # fmt: skip
"""What is summed over each block: |innovation| of both pressures in Pa; squared innovations over
their variances; |leak flow| in m^3/s from 2 s after the onset on, of every tenth tick."""
SEEN: Final = 10
"""Ticks from one look at the leak flow to the next."""
SETTLED: Final = 2000.0
"""Ticks after the onset from which on a leak's flow counts (the command-line contract)."""

_OUTPUTS: Final = 9
"""Of the filter at each tick."""

_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_ROUNDING_S: Final = 1e-9
"""Added to a time before its step is looked up, as in `control.setpoints.held`: without it a step
could come a tick late."""


class CaseLanes(NamedTuple):
    """What the rigs of cases in lanes are asked, and what noise their transducers have."""

    sines: NDArray[np.float64]
    """(4 s, LANES), of setpoints as `rig.sweep.motions.Motions` has them."""
    levels: NDArray[np.float64]
    """(k, LANES)."""
    ends: NDArray[np.float64]
    """(k, LANES), s."""
    level: NDArray[np.float64]
    """(1, LANES), which level is held; it is updated."""
    open_loop: NDArray[np.float64]
    """(1, LANES), not 0 where the setpoint is the command."""
    scale: NDArray[np.float64]
    """(1, LANES), factor on the transducers' deviations."""
    pressures: NDArray[np.uint64]
    """(4, LANES), the stream of the pressures' noise; it is updated."""
    others: NDArray[np.uint64]
    """(4, LANES), the stream of the other transducers' noise; it is updated."""


class Thesis7Lanes(NamedTuple):
    """The seven-state filters of the thesis in lanes, all of it updated."""

    x: NDArray[np.float64]
    """(7, LANES) states."""
    covariance: NDArray[np.float64]
    """(7, 7, LANES)."""
    held: NDArray[np.float64]
    """(1, LANES), command since the last tick, V."""
    sums: NDArray[np.float64]
    """(blocks, 6, LANES), to be filled: `SUMS` of each block."""


@inlined
def _wave(sines, i, time_s):
    """Return sine i of a sum at a time, m or V."""
    row = SINE_ROWS * i
    turns = load(sines, row + PHASE)
    turns += time_s * (load(sines, row + FREQUENCY) + time_s * load(sines, row + CHIRP))
    sine, _ = sine_and_cosine(turns - floor(turns))
    return load(sines, row + AMPLITUDE) * sine


@njit(cache=True, error_model="numpy", nogil=True)
def scale_sines(sines, peak, ticks):
    """Scale sums of sines whose `peak` (1, LANES) is not NaN to come to it at most, within `ticks`.

    The greatest value is looked for at 32 points a period of the fastest sine, which finds it but
    for 0.5 % (Ehlich and Zeller 1964, as `control.setpoints.trigonometric`).
    """
    count = sines.shape[0] // SINE_ROWS
    wanted = load(peak, 0)
    scaled = wanted == wanted
    if not anywhere(scaled):
        return
    fastest = 1.0
    for i in range(count):
        for lane in range(LANES):
            if peak[0, lane] == peak[0, lane]:
                fastest = max(fastest, sines[SINE_ROWS * i + FREQUENCY, lane])
    stride = max(1, int(1.0 / (32.0 * fastest * TICK)))
    greatest = 0.0 * wanted
    greatest = select(scaled, greatest, 1.0)
    for k in range(0, ticks, stride):
        total = 0.0 * greatest
        for i in range(count):
            total += _wave(sines, i, k * TICK)
        greatest = max(greatest, abs(total))
    factor = select(scaled, wanted / greatest, 1.0)
    for i in range(count):
        row = SINE_ROWS * i + AMPLITUDE
        store(sines, row, factor * load(sines, row))


@njit(cache=True, error_model="numpy", nogil=True)
def setpoint_ticks(first, sines, levels, ends, held, setpoint):
    """Sample setpoints, as `rig.sweep.motions.Motions` has them.

    Args:
        first: number of the first tick.
        sines: (4 s, LANES).
        levels: (k, LANES).
        ends: (k, LANES), s.
        held: (1, LANES), which level is held; updated.
        setpoint: (ticks, LANES), to be filled, m or V.
    """
    align_stack()
    at = load(held, 0)
    count = sines.shape[0] // SINE_ROWS
    until, level = gather(ends, at), gather(levels, at)
    for k in range(setpoint.shape[0]):
        time_s = (first + k) * TICK
        over = until <= time_s + _ROUNDING_S
        while anywhere(over):
            at = select(over, at + 1.0, at)
            until, level = gather(ends, at), gather(levels, at)
            over = until <= time_s + _ROUNDING_S
        total = level
        for i in range(count):
            total += _wave(sines, i, time_s)
        store(setpoint, k, total)
    store(held, 0, at)


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_ticks(first, log, rows, rigs, cases, filters, like, sensors, assumed):
    """Run the seven-state filter of the thesis over a block of ticks, and sum up its figures.

    Args:
        first: number of the first tick; tick 0 starts the filter.
        log: of `plant_ticks`, of chambers.
        rows: (ticks, LANES), of `plant_ticks`.
        rigs: `LaneRigs`.
        cases: `CaseLanes`; the stream of the pressures' noise is updated.
        filters: `Thesis7Lanes`, updated.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        assumed: `Parameters` that all filters assume.
    """
    align_stack()
    par = load_fields(rigs.parameters, like, _FRICTION_LAW)
    deviation = sensors.pressure_noise * load(cases.scale, 0)
    command = load(filters.held, 0)
    nothing = 0.0 * command
    sum_1, sum_2, square_x, square_1, square_2, flow = (
        nothing, nothing, nothing, nothing, nothing, nothing,
    )  # fmt: skip
    noise, out = empty_lanes(2 * rows.shape[0]), empty_lanes(_OUTPUTS)
    fill_normal(cases.pressures, noise)
    outputs = in_lanes(out)
    for k in range(rows.shape[0]):
        row, drawn = load(rows, k) * LOGGED_OF_CHAMBERS, 2 * k
        p1, p2 = gather(log, row + PRESSURE_1), gather(log, row + PRESSURE_2)
        shown = reading_means(gather(log, row + POSITION), p1, p2, nothing, nothing, par)
        position = encoder_position(shown.position, sensors)
        z_1 = pressure_reading(shown.pressure_1, deviation * load(noise, drawn), sensors)
        z_2 = pressure_reading(shown.pressure_2, deviation * load(noise, drawn + 1), sensors)
        if first + k > 0:
            thesis7_step(in_lanes(filters.x), in_lanes(filters.covariance), command, position,
                         z_1, z_2, assumed, outputs)  # fmt: skip
            e_x, e_1, e_2 = outputs[0], outputs[1], outputs[2]
            sum_1 += abs(e_1)
            sum_2 += abs(e_2)
            square_x += e_x * e_x / outputs[6]
            square_1 += e_1 * e_1 / outputs[7]
            square_2 += e_2 * e_2 / outputs[8]
        command = gather(log, row + COMMAND)
        if (first + k) % SEEN == 0:
            flow += _leak_flow(first + k, p1, p2, gather(log, row + RETURN), rigs)
    store(filters.held, 0, command)
    sums = filters.sums[first // BLOCK]
    store(sums, 0, sum_1)
    store(sums, 1, sum_2)
    store(sums, 2, square_x)
    store(sums, 3, square_1)
    store(sums, 4, square_2)
    store(sums, 5, flow)


@inlined
def _leak_flow(tick, p1, p2, back, rigs):
    """Return the flow in m^3/s of the leaks that were injected, 0 until 2 s after the onset."""
    oil_1, oil_2 = max(p1, 0.0), max(p2, 0.0)
    flow = abs(load(rigs.faults, 0) * signed_root(oil_1 - back))
    flow += abs(load(rigs.faults, 1) * signed_root(oil_2 - back))
    flow += abs(load(rigs.faults, 2) * signed_root(oil_1 - oil_2))
    return select(load(rigs.onset, 0) + SETTLED <= tick, flow, 0.0 * flow)


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_cases(ahead, rigs, cases, filters, loop, like, sensors, assumed):
    """Run cases from their first tick to their last, one in each lane.

    Args:
        ahead: blocks that plants run ahead of the filter, within which lanes even out what their
            motions cost; the fewer, the longer the log stays in the cache.
        rigs: `LaneRigs`; their plants are updated.
        cases: `CaseLanes`, from their first tick on; updated.
        filters: `Thesis7Lanes`, whose sums say how many blocks there are; updated.
        loop: `LoopSetting`.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        assumed: `Parameters` that the filter assumes.

    Returns:
        Whether every plant came to the end; else one needed too many steps.
    """
    ticks = filters.sums.shape[0] * BLOCK + 1
    batch = ahead * BLOCK + 1
    steps = batch * MOST_STEPS
    log = empty_lanes(steps * LOGGED_OF_CHAMBERS).reshape((steps, LOGGED_OF_CHAMBERS, LANES))
    rows, setpoint = empty_lanes(batch), empty_lanes(batch)
    first = 0
    while first < ticks:
        count = min(batch if first == 0 else batch - 1, ticks - first)
        setpoint_ticks(first, cases.sines, cases.levels, cases.ends, cases.level, setpoint[:count])
        if not plant_ticks(
            first, setpoint[:count], cases.open_loop, loop, rigs, like, sensors, log, rows[:count]
        ):
            return False
        done = 0
        while done < count:
            part = BLOCK + 1 if first + done == 0 else BLOCK
            thesis7_ticks(
                first + done, log, rows[done : done + part], rigs, cases, filters, like, sensors,
                assumed,
            )  # fmt: skip
            done += part
        first += count
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def reading_block(first, rigs, cases, loop, like, sensors, log, readings, flow):
    """Run plants and transducers for a block of ticks, for a filter that is run elsewhere.

    Args:
        first: number of the block's first tick.
        rigs: `LaneRigs`; their plants are updated.
        cases: `CaseLanes`, updated.
        loop: `LoopSetting`.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        log: (steps, `LOGGED`, LANES), to be filled.
        readings: (ticks, 6, LANES), to be filled: `rig.loop.lane_ticks.LANE_READINGS`.
        flow: (1, LANES), sum of the leak flow as in `SUMS`; updated.

    Returns:
        Whether every plant came to the end of the block.
    """
    ticks = readings.shape[0]
    setpoint, rows = empty_lanes(ticks), empty_lanes(ticks)
    setpoint_ticks(first, cases.sines, cases.levels, cases.ends, cases.level, setpoint)
    if not plant_ticks(first, setpoint, cases.open_loop, loop, rigs, like, sensors, log, rows):
        return False
    of_pressures, of_others = empty_lanes(2 * ticks), empty_lanes(2 * ticks)
    fill_normal(cases.pressures, of_pressures)
    fill_normal(cases.others, of_others)
    noise, scale = empty_lanes(NOISE_COUNT * ticks), load(cases.scale, 0)
    for k in range(ticks):
        for i in range(2):
            store(noise, NOISE_COUNT * k + i, scale * load(of_pressures, 2 * k + i))
            store(noise, NOISE_COUNT * k + 2 + i, scale * load(of_others, 2 * k + i))
        if (first + k) % SEEN == 0:
            row = load(rows, k) * LOGGED
            p1, p2 = gather(log, row + PRESSURE_1), gather(log, row + PRESSURE_2)
            seen = _leak_flow(first + k, p1, p2, gather(log, row + RETURN), rigs)
            store(flow, 0, load(flow, 0) + seen)
    reading_ticks(log, rows, noise, rigs.parameters, like, sensors, readings)
    return True
