"""Runs the ticks of a sweep's cases in lanes, in compiled code: setpoint, plant, sensors, filter.

With the thesis's filter, the compiled code runs whole cases. It keeps sums over blocks of half a
second, from which the thesis's moving averages follow.
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
    LANE_READINGS,
    LOGGED,
    LOGGED_OF_CHAMBERS,
    MOST_STEPS,
    NOISE_COUNT,
    POSITION,
    PRESSURE_1,
    PRESSURE_2,
    RETURN,
    LaneGuide,
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

from .motions import AMPLITUDE, CHIRP, FREQUENCY, HOLD, PHASE, SINE_ROWS

BLOCK: Final = 500
"""Ticks of a block, half a second: sums are kept for each block, and a decision follows it."""
SUMS: Final = (
    "absolute_innovation_1", "absolute_innovation_2", "squared_position", "squared_1", "squared_2",
    "leak_flow",
)  # fmt: skip
"""Names of the sums over each block: |innovation| of both pressures, Pa; squared innovations over
their variances; |leak flow|, m^3/s, from 2 s after the onset on, at every tenth tick."""
SEEN: Final = 10
"""Every how many ticks the leak flow is added to its sum."""
SETTLED: Final = 2000.0
"""Ticks after the onset until a leak's flow begins to count (the command-line contract)."""

_READING_COUNT: Final = len(LANE_READINGS)
_OUTPUTS: Final = 9
"""Number of the filter's outputs at each tick."""

_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_ROUNDING_S: Final = 1e-9
"""Time that is added before a level is looked up, s, as in `control.setpoints.held`; without it,
rounding could make a step one tick late."""


class CaseLanes(NamedTuple):
    """The setpoints of cases in lanes, and the noise of their transducers."""

    sines: NDArray[np.float64]
    """Sines of the setpoints as in `rig.sweep.motions.Motions`, (4 s, LANES)."""
    wave: NDArray[np.float64]
    """Trapezoid waves of the setpoints as in `rig.sweep.motions.Motions`, (4, LANES)."""
    levels: NDArray[np.float64]
    """Levels of the setpoints as in `rig.sweep.motions.Motions`, (k, LANES)."""
    ends: NDArray[np.float64]
    """Time at which each level ends, s, (k, LANES)."""
    table: NDArray[np.float64] | None
    """Setpoint of each tick in place of all that, m or V, (ticks, LANES), where a lane's setpoint
    has segments; None where none has."""
    level: NDArray[np.float64]
    """Index of the present level, (1, LANES); updated in place."""
    open_loop: NDArray[np.float64]
    """Not 0 if the setpoint is the valve's command, (1, LANES)."""
    guide: LaneGuide | None
    """Control laws of the cases; what they remember is updated in place. None if all cases have the
    proportional loop with one gain."""
    scale: NDArray[np.float64]
    """Factor on the standard deviations of the transducers, (1, LANES)."""
    pressures: NDArray[np.uint64]
    """State of the stream of the pressures' noise, (4, LANES); updated in place."""
    others: NDArray[np.uint64]
    """State of the stream of the other transducers' noise, (4, LANES); updated in place."""


class Thesis7Lanes(NamedTuple):
    """The seven-state filters of the thesis in lanes; all arrays are updated in place."""

    x: NDArray[np.float64]
    """Estimated states, (7, LANES)."""
    covariance: NDArray[np.float64]
    """Covariance of the states, (7, 7, LANES)."""
    held: NDArray[np.float64]
    """Command since the last tick, V, (1, LANES)."""
    sums: NDArray[np.float64]
    """`SUMS` of each block, which the ticks fill in, (blocks, 6, LANES)."""


@inlined
def _sine(sines, i, time_s):
    """Return the value, in m or V, of sine i of a setpoint at a time in s."""
    row = SINE_ROWS * i
    turns = load(sines, row + PHASE)
    turns += time_s * (load(sines, row + FREQUENCY) + time_s * load(sines, row + CHIRP))
    sine, _ = sine_and_cosine(turns - floor(turns))
    return load(sines, row + AMPLITUDE) * sine


@inlined
def _trapezoid(wave, time_s):
    """Return the value, in m or V, of trapezoid waves at a time in s (`control.Trapezoid`)."""
    half = 0.5 / load(wave, FREQUENCY)
    turns = load(wave, FREQUENCY) * time_s + load(wave, PHASE) + 0.25
    triangle = 1.0 - 4.0 * abs(turns - floor(turns) - 0.5)
    steep = half / (half - load(wave, HOLD)) * triangle
    return load(wave, AMPLITUDE) * min(max(steep, -1.0), 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def scale_sines(sines, peak, ticks):
    """Scale sums of sines in place so that their greatest absolute values are those of `peak`.

    A lane whose peak is NaN stays as it is. The greatest value is searched at 32 points a period of
    the fastest sine, which finds it within 0.5 % (Ehlich and Zeller 1964, as in
    `control.setpoints.periodic`).

    Args:
        sines: as in `rig.sweep.motions.Motions`, (4 s, LANES); the amplitudes are updated.
        peak: wanted greatest absolute value, m or V, (1, LANES).
        ticks: number of ticks over which the greatest value is searched.
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
            total += _sine(sines, i, k * TICK)
        greatest = max(greatest, abs(total))
    factor = select(scaled, wanted / greatest, 1.0)
    for i in range(count):
        row = SINE_ROWS * i + AMPLITUDE
        store(sines, row, factor * load(sines, row))


@njit(cache=True, error_model="numpy", nogil=True)
def setpoint_ticks(first, sines, wave, levels, ends, held, setpoint):
    """Fill in the setpoints of some ticks; they are described as in `rig.sweep.motions.Motions`.

    Args:
        first: number of the first tick.
        sines: rows of the sines, (4 s, LANES).
        wave: rows of the trapezoid waves, (4, LANES).
        levels: successive levels, m or V, (k, LANES).
        ends: time at which each level ends, s, (k, LANES).
        held: index of the present level, (1, LANES); updated.
        setpoint: is filled with the setpoint of each tick, m or V, (ticks, LANES).
    """
    align_stack()
    at = load(held, 0)
    count = sines.shape[0] // SINE_ROWS
    has_wave = anywhere(load(wave, AMPLITUDE) != 0.0)
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
            total += _sine(sines, i, time_s)
        if has_wave:
            total += _trapezoid(wave, time_s)
        store(setpoint, k, total)
    store(held, 0, at)


@njit(cache=True, error_model="numpy", nogil=True)
def case_setpoints(first, cases, table, setpoint):
    """Fill in the setpoints of some ticks, from a table if there is one.

    Args:
        first: number of the first tick.
        cases: `CaseLanes`; the index of the present level is updated without a table.
        table: the table of `cases`, given by itself so that code without it is compiled apart.
        setpoint: is filled with the setpoint of each tick, m or V, (ticks, LANES).
    """
    if table is None:
        setpoint_ticks(
            first, cases.sines, cases.wave, cases.levels, cases.ends, cases.level, setpoint
        )
    else:
        for k in range(setpoint.shape[0]):
            store(setpoint, k, load(table, first + k))


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_ticks(first, log, rows, rigs, cases, filters, like, sensors, assumed):
    """Run the thesis's seven-state filter over a block of ticks, and fill in the block's `SUMS`.

    The filter's readings are made from the plants' log, with noise on the pressures. A block has
    `BLOCK` ticks, and one more if it begins with tick 0.

    Args:
        first: number of the first tick; at tick 0 the filter makes no step yet.
        log: log that `plant_ticks` has filled, with or without spool and supply pressure.
        rows: rows of this log at each tick, from `plant_ticks`, (ticks, LANES).
        rigs: `LaneRigs`.
        cases: `CaseLanes`; the stream of the pressures' noise is updated.
        filters: `Thesis7Lanes`, updated.
        like: `Parameters` whose friction law all rigs have.
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
    outputs, width = in_lanes(out), float(log.shape[1])
    for k in range(rows.shape[0]):
        row, drawn = load(rows, k) * width, 2 * k
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
    """Return the sum of the leaks' absolute flows at a tick, m^3/s; 0 until 2 s after the onset.

    Args:
        tick: number of the tick.
        p1: pressure in chamber 1, Pa.
        p2: pressure in chamber 2, Pa.
        back: return pressure, Pa.
        rigs: `LaneRigs`, whose leaks and onset are used.
    """
    oil_1, oil_2 = max(p1, 0.0), max(p2, 0.0)
    flow = abs(load(rigs.faults, 0) * signed_root(oil_1 - back))
    flow += abs(load(rigs.faults, 1) * signed_root(oil_2 - back))
    flow += abs(load(rigs.faults, 2) * signed_root(oil_1 - oil_2))
    grown = _grown(flow, rigs.growth, tick)
    return select(load(rigs.onset, 0) + SETTLED <= tick, grown, 0.0 * flow)


@inlined
def _grown(flow, growth, tick):
    """Return a flow in proportion to the factor at a tick (`LaneRigs.growth`), if there is one."""
    if growth is None:
        return flow
    return load(growth, tick) * flow


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_cases(ahead, rigs, cases, filters, loop, like, sensors, assumed):
    """Run cases from their first tick to their last, one in each lane, and fill in their sums.

    Plants run for some blocks, and then the filters run over the same blocks, in turns.

    Args:
        ahead: number of blocks that the plants run before the filters follow. With more blocks the
            lanes need more nearly equal numbers of integration steps, so that they wait less for
            each other; with fewer the log stays in the processor's cache.
        rigs: `LaneRigs`; their plants are updated.
        cases: `CaseLanes` before the first tick; updated.
        filters: `Thesis7Lanes`; updated. Their `sums` have a row for each block to be run, which is
            filled in.
        loop: `LoopSetting`.
        like: `Parameters` whose friction law all rigs have.
        sensors: `SensorParameters`.
        assumed: `Parameters` that the filter assumes.

    Returns:
        True if every plant came to the end, False if one needed too many integration steps.
    """
    ticks = filters.sums.shape[0] * BLOCK + 1
    batch = ahead * BLOCK + 1
    steps = batch * MOST_STEPS
    log = empty_lanes(steps * LOGGED_OF_CHAMBERS).reshape((steps, LOGGED_OF_CHAMBERS, LANES))
    rows, setpoint = empty_lanes(batch), empty_lanes(batch)
    first = np.int64(0)  # A bare 0 has numba compile `plant_ticks` once more, for 0 alone.
    while first < ticks:
        count = min(batch if first == 0 else batch - 1, ticks - first)
        case_setpoints(first, cases, cases.table, setpoint[:count])
        if not plant_ticks(
            first, setpoint[:count], cases.open_loop, loop, cases.guide, rigs, like, sensors, log,
            rows[:count],
        ):  # fmt: skip
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
    """Run plants and transducers for a block of ticks, and fill in the readings, without a filter.

    Args:
        first: number of the block's first tick.
        rigs: `LaneRigs`; their plants are updated.
        cases: `CaseLanes`, updated.
        loop: `LoopSetting`.
        like: `Parameters` whose friction law all rigs have.
        sensors: `SensorParameters`.
        log: is filled with the plants' steps, (steps, `LOGGED`, LANES).
        readings: is filled with `rig.loop.lane_ticks.LANE_READINGS`, (ticks, 6, LANES); the
            number of its rows is that of the block's ticks.
        flow: sum of the leak flow as in `SUMS`, m^3/s, (1, LANES); that of this block is added.

    Returns:
        True if every plant came to the end of the block, False if one needed too many integration
        steps.
    """
    ticks = readings.shape[0]
    setpoint, rows = empty_lanes(ticks), empty_lanes(ticks)
    case_setpoints(first, cases, cases.table, setpoint)
    if not plant_ticks(
        first, setpoint, cases.open_loop, loop, cases.guide, rigs, like, sensors, log, rows
    ):
        return False
    for k in range(ticks):
        if (first + k) % SEEN == 0:
            row = load(rows, k) * LOGGED
            p1, p2 = gather(log, row + PRESSURE_1), gather(log, row + PRESSURE_2)
            seen = _leak_flow(first + k, p1, p2, gather(log, row + RETURN), rigs)
            store(flow, 0, load(flow, 0) + seen)
    logged_readings(rigs, cases, cases.pressures, like, sensors, log, rows, readings)
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def logged_readings(rigs, cases, pressures, like, sensors, log, rows, readings):
    """Fill in what the transducers read in some ticks, from the plants' log, with noise.

    Args:
        rigs: `LaneRigs`.
        cases: `CaseLanes`; the stream of the other transducers' noise is updated.
        pressures: state of the stream of the pressures' noise, (4, LANES); updated.
        like: `Parameters` whose friction law all rigs have.
        sensors: `SensorParameters`.
        log: log that `plant_ticks` has filled, (steps, `LOGGED`, LANES).
        rows: rows of this log at each tick, from `plant_ticks`, (ticks, LANES).
        readings: is filled with `rig.loop.lane_ticks.LANE_READINGS`, (ticks, 6, LANES).
    """
    align_stack()
    ticks = rows.shape[0]
    of_pressures, of_others = empty_lanes(2 * ticks), empty_lanes(2 * ticks)
    fill_normal(pressures, of_pressures)
    fill_normal(cases.others, of_others)
    noise, scale = empty_lanes(NOISE_COUNT * ticks), load(cases.scale, 0)
    for k in range(ticks):
        for i in range(2):
            store(noise, NOISE_COUNT * k + i, scale * load(of_pressures, 2 * k + i))
            store(noise, NOISE_COUNT * k + 2 + i, scale * load(of_others, 2 * k + i))
    reading_ticks(log, rows, noise, rigs.parameters, like, sensors, readings)


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_readings(ahead, rigs, cases, filters, loop, like, sensors, assumed, wanted, kept):
    """Run cases as `thesis7_cases` does, and keep some of the readings of every tick.

    The filter and the kept readings have the same noise, so that both are as if the filter had been
    given these readings.

    Args:
        ahead: as for `thesis7_cases`.
        rigs: as for `thesis7_cases`.
        cases: as for `thesis7_cases`.
        filters: as for `thesis7_cases`.
        loop: as for `thesis7_cases`.
        like: as for `thesis7_cases`.
        sensors: as for `thesis7_cases`.
        assumed: as for `thesis7_cases`.
        wanted: indices of the readings to keep in `rig.loop.lane_ticks.LANE_READINGS`, int64 (m,).
        kept: is filled with these readings, (ticks, m, LANES).

    Returns:
        As `thesis7_cases`.
    """
    ticks = kept.shape[0]
    batch = ahead * BLOCK + 1
    steps = batch * MOST_STEPS
    log = empty_lanes(steps * LOGGED).reshape((steps, LOGGED, LANES))
    rows, setpoint = empty_lanes(batch), empty_lanes(batch)
    readings = empty_lanes(batch * _READING_COUNT).reshape((batch, _READING_COUNT, LANES))
    again = cases.pressures.copy()
    first = np.int64(0)  # A bare 0 has numba compile `plant_ticks` once more, for 0 alone.
    while first < ticks:
        count = min(batch if first == 0 else batch - 1, ticks - first)
        case_setpoints(first, cases, cases.table, setpoint[:count])
        if not plant_ticks(
            first, setpoint[:count], cases.open_loop, loop, cases.guide, rigs, like, sensors, log,
            rows[:count],
        ):  # fmt: skip
            return False
        done = 0
        while done < count:
            part = BLOCK + 1 if first + done == 0 else BLOCK
            here = rows[done : done + part]
            thesis7_ticks(first + done, log, here, rigs, cases, filters, like, sensors, assumed)
            # Blocks draw their noise one by one, and so must these readings.
            found = readings[done : done + part]
            logged_readings(rigs, cases, again, like, sensors, log, here, found)
            done += part
        for i in range(wanted.size):
            kept[first : first + count, i] = readings[:count, wanted[i]]
        first += count
    return True
