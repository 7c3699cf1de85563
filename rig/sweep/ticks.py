"""Compiled ticks of a sweep's cases in lanes: setpoints, plants, transducers, filter, figures.

Nothing returns to Python within a case. What is kept of each half second are sums, from which the
thesis's moving averages follow.
"""

from math import floor
from typing import Final

from numba import njit

from estimator.filters import thesis7_step
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
_SEEN: Final = 10
"""Ticks from one look at the leak flow to the next."""
_SETTLED: Final = 2000.0
"""Ticks after the onset from which on a leak's flow counts (the command-line contract)."""

_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_ROUNDING_S: Final = 1e-9
"""Added to a time before its step is looked up, as in `control.setpoints.held`: without it a step
could come a tick late."""


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
def thesis7_ticks(
    first, log, rows, noise, scale, parameters, like, sensors, faults, onset,
    x, covariance, held, assumed, out, sums,
):  # fmt: skip
    """Run the seven-state filter of the thesis over a block of ticks, and sum up its figures.

    Args:
        first: number of the first tick; tick 0 starts the filter.
        log: of `plant_ticks`, of chambers.
        rows: (ticks, LANES), of `plant_ticks`.
        noise: (ticks, 2, LANES) standard normal numbers, of both pressures.
        scale: (1, LANES), factor on the transducers' deviations.
        parameters: (fields, LANES), `Parameters` of each rig.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        faults: (8, LANES) coefficients.
        onset: (1, LANES), tick from which on they act.
        x: (7, LANES) states, updated.
        covariance: (7, 7, LANES), updated.
        held: (1, LANES), command since the last tick in V, updated.
        assumed: `Parameters` that all filters assume.
        out: scratch (9, LANES), outputs of the last tick.
        sums: (6, LANES), to be filled: `SUMS`.
    """
    align_stack()
    par = load_fields(parameters, like, _FRICTION_LAW)
    deviation = sensors.pressure_noise * load(scale, 0)
    command = load(held, 0)
    nothing = 0.0 * command
    sum_1, sum_2, square_x, square_1, square_2, flow = (
        nothing, nothing, nothing, nothing, nothing, nothing,
    )  # fmt: skip
    outputs = in_lanes(out)
    for k in range(rows.shape[0]):
        row, drawn = load(rows, k) * LOGGED_OF_CHAMBERS, 2 * k
        p1, p2 = gather(log, row + PRESSURE_1), gather(log, row + PRESSURE_2)
        shown = reading_means(gather(log, row + POSITION), p1, p2, nothing, nothing, par)
        position = encoder_position(shown.position, sensors)
        z_1 = pressure_reading(shown.pressure_1, deviation * load(noise, drawn), sensors)
        z_2 = pressure_reading(shown.pressure_2, deviation * load(noise, drawn + 1), sensors)
        if first + k > 0:
            thesis7_step(in_lanes(x), in_lanes(covariance), command, position, z_1, z_2, assumed,
                         outputs)  # fmt: skip
            e_x, e_1, e_2 = outputs[0], outputs[1], outputs[2]
            sum_1 += abs(e_1)
            sum_2 += abs(e_2)
            square_x += e_x * e_x / outputs[6]
            square_1 += e_1 * e_1 / outputs[7]
            square_2 += e_2 * e_2 / outputs[8]
        command = gather(log, row + COMMAND)
        if (first + k) % _SEEN == 0:
            flow += _leak_flow(first + k, p1, p2, gather(log, row + RETURN), faults, onset)
    store(held, 0, command)
    store(sums, 0, sum_1)
    store(sums, 1, sum_2)
    store(sums, 2, square_x)
    store(sums, 3, square_1)
    store(sums, 4, square_2)
    store(sums, 5, flow)


@inlined
def _leak_flow(tick, p1, p2, back, faults, onset):
    """Return the flow in m^3/s of the leaks that were injected, 0 until 2 s after the onset."""
    oil_1, oil_2 = max(p1, 0.0), max(p2, 0.0)
    flow = abs(load(faults, 0) * signed_root(oil_1 - back))
    flow += abs(load(faults, 1) * signed_root(oil_2 - back))
    flow += abs(load(faults, 2) * signed_root(oil_1 - oil_2))
    return select(load(onset, 0) + _SETTLED <= tick, flow, 0.0 * flow)


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_cases(
    ticks, ahead, sines, levels, ends, open_loop, gain, limit, longest_step, plant, parameters,
    like, sensors, faults, onset, scale, streams, x, covariance, assumed, sums,
):  # fmt: skip
    """Run cases from their first tick to their last, one in each lane.

    Args:
        ticks: of each, a block's times some, and one more.
        ahead: blocks that plants run ahead of the filter, within which lanes even out what their
            motions cost; the fewer, the longer the log stays in the cache.
        sines: of setpoints, as `setpoint_ticks` takes them.
        levels: likewise.
        ends: likewise.
        open_loop: (1, LANES), not 0 where the setpoint is the command.
        gain: of the position loop, V/m.
        limit: greatest command of either sign, V.
        longest_step: of the integration, s.
        plant: (9, LANES) true states; updated.
        parameters: (fields, LANES), `Parameters` of each rig.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        faults: (8, LANES) coefficients.
        onset: (1, LANES), tick from which on they act.
        scale: (1, LANES), factor on the transducers' deviations.
        streams: uint64 (4, LANES), of the pressures' noise; updated.
        x: (7, LANES) the filter's states; updated.
        covariance: (7, 7, LANES); updated.
        assumed: `Parameters` that the filter assumes.
        sums: (blocks, 6, LANES), to be filled: `SUMS` of each block.

    Returns:
        Whether every plant came to the end; else one needed too many steps.
    """
    batch = ahead * BLOCK + 1
    steps = batch * MOST_STEPS
    log = empty_lanes(steps * LOGGED_OF_CHAMBERS).reshape((steps, LOGGED_OF_CHAMBERS, LANES))
    rows, setpoint = empty_lanes(batch), empty_lanes(batch)
    noise = empty_lanes(2 * (BLOCK + 1))
    held, level, out = empty_lanes(1), empty_lanes(1), empty_lanes(9)
    held[:], level[:] = 0.0, 0.0
    until_onset = onset.copy()
    first = 0
    while first < ticks:
        count = min(batch if first == 0 else batch - 1, ticks - first)
        setpoint_ticks(first, sines, levels, ends, level, setpoint[:count])
        if not plant_ticks(
            setpoint[:count], open_loop, gain, limit, longest_step, faults, until_onset,
            plant, parameters, like, sensors, log, rows[:count],
        ):  # fmt: skip
            return False
        until_onset -= count
        done = 0
        while done < count:
            part = BLOCK + 1 if first + done == 0 else BLOCK
            fill_normal(streams, noise[: 2 * part])
            thesis7_ticks(
                first + done, log, rows[done : done + part], noise, scale, parameters, like,
                sensors, faults, onset, x, covariance, held, assumed, out,
                sums[(first + done) // BLOCK],
            )  # fmt: skip
            done += part
        first += count
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def reading_block(
    first, sines, levels, ends, level, open_loop, gain, limit, longest_step, plant, parameters,
    like, sensors, faults, until_onset, onset, scale, pressures, others, log, readings, flow,
):  # fmt: skip
    """Run plants and transducers for a block of ticks, for a filter that is run elsewhere.

    Args:
        first: number of the block's first tick.
        sines: of setpoints, as `setpoint_ticks` takes them.
        levels: likewise.
        ends: likewise.
        level: (1, LANES), of `setpoint_ticks`; updated.
        open_loop: (1, LANES), not 0 where the setpoint is the command.
        gain: of the position loop, V/m.
        limit: greatest command of either sign, V.
        longest_step: of the integration, s.
        plant: (9, LANES) true states; updated.
        parameters: (fields, LANES), `Parameters` of each rig.
        like: `Parameters`, of which the friction law is that of all rigs.
        sensors: `SensorParameters`.
        faults: (8, LANES) coefficients.
        until_onset: (1, LANES), ticks from now until faults act; updated.
        onset: (1, LANES), tick from which on they act.
        scale: (1, LANES), factor on the transducers' deviations.
        pressures: uint64 (4, LANES), the stream of the pressures' noise; updated.
        others: uint64 (4, LANES), the stream of the other transducers' noise; updated.
        log: (steps, `LOGGED`, LANES), to be filled.
        readings: (ticks, 6, LANES), to be filled: `rig.loop.lane_ticks.LANE_READINGS`.
        flow: (1, LANES), sum of the leak flow as in `SUMS`; updated.

    Returns:
        Whether every plant came to the end of the block.
    """
    ticks = readings.shape[0]
    setpoint, rows = empty_lanes(ticks), empty_lanes(ticks)
    setpoint_ticks(first, sines, levels, ends, level, setpoint)
    if not plant_ticks(
        setpoint, open_loop, gain, limit, longest_step, faults, until_onset, plant, parameters,
        like, sensors, log, rows,
    ):  # fmt: skip
        return False
    until_onset -= ticks
    of_pressures, of_others = empty_lanes(2 * ticks), empty_lanes(2 * ticks)
    fill_normal(pressures, of_pressures)
    fill_normal(others, of_others)
    noise = empty_lanes(NOISE_COUNT * ticks)
    for k in range(ticks):
        for i in range(2):
            store(noise, NOISE_COUNT * k + i, load(scale, 0) * load(of_pressures, 2 * k + i))
            store(noise, NOISE_COUNT * k + 2 + i, load(scale, 0) * load(of_others, 2 * k + i))
        if (first + k) % _SEEN == 0:
            row = load(rows, k) * LOGGED
            p1, p2 = gather(log, row + PRESSURE_1), gather(log, row + PRESSURE_2)
            seen = _leak_flow(first + k, p1, p2, gather(log, row + RETURN), faults, onset)
            store(flow, 0, load(flow, 0) + seen)
    reading_ticks(log, rows, noise, parameters, like, sensors, readings)
    return True
