"""Samples of friction against velocity, from the stretches of a motion that show it.

The filter's load state is friction and environment together (section 6.3). Less the force of the
known spring it is friction (section 7.1.1, figure 7.26). Estimates are averaged over 10 ms.
Friction is a function of velocity only in quasi-steady sliding. Pre-sliding, stick-slip, the ends
of the stroke, dry chambers, a saturated valve and the filter's start are therefore left out.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters import DEFAULT_FILTER, DRY, FilterRun, run_filter
from estimator.leaks import Samples
from rig.plant import KARNOPP, TICK, Model, Parameters, SensorParameters

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

BLOCK_TICKS: Final = 10
_BLOCK_S: Final = BLOCK_TICKS * TICK
STARTED_S: Final = 1.0
PRESLIDING_M: Final = 1e-3
"""Travel in m after a reversal from which friction follows the slip curve. Bristles need a travel
of g/s_0, which is 0.12 mm on the thesis's rig (docs/model.md); eight times that also covers seals
that are several times softer."""
STROKE_MARGIN_M: Final = 5e-3
COMMAND_LIMIT_V: Final = 10.0
"""Command that fully opens the thesis's valve; beyond it the flow no longer follows the command."""
STEADY_SPREAD: Final = 0.25
"""Largest standard deviation of the velocity within a block, as a part of the velocity.

A deviation s makes the mean of the Stribeck curve err by (f_st - f_sl) (s/alpha)^2 exp(-v/alpha) /
2. With s = v/4 this is at most 1.7 % of f_st - f_sl for any alpha."""
STEADY_LAG: Final = 0.2
"""Largest change of velocity during the lag of filter and bristles, as a part of the velocity.

Without correction the lag would make an error of up to 0.2 / e = 7 % of f_st - f_sl; with it, only
the uncertainty of the lag matters."""
STEADY_BLOCKS: Final = 5
"""Fewest successive blocks of a steady stretch. A shorter one may be a calm instant of a stick-slip
oscillation; the oil column's slowest period on the thesis's rig is 12 ms (docs/model.md)."""
LEAST_KNOWN: Final = 0.9
"""Least part of the samples that must be present for gaps to be filled in; missed ticks are a few
in a hundred."""

_SLEW: Final = 1.0
"""Slope in N/ms of the load ramp by which the lag is measured. Any value would do, as the filter is
nearly linear."""
_RAMP_TICKS: Final = 400


class Spring(NamedTuple):
    """A spring that the ram runs against: its known stiffness (N/m) and contact position (m)."""

    stiffness: float
    contact: float

    def force(self, position: Array) -> Array:
        """Return the force in N against extension at positions (n,) in m; 0 before contact."""
        return np.asarray(self.stiffness * np.maximum(position - self.contact, 0.0))


class LoadLag(NamedTuple):
    """The lag of the filter behind a load that changes at a steady rate.

    Attributes:
        load_s: true less estimated load, divided by the load's rate of change, s.
        velocity: true less estimated velocity, divided by the load's rate, (m/s)/(N/s).
    """

    load_s: float
    velocity: float


def load_lag(model: Model, sensors: SensorParameters) -> LoadLag:
    """Return the lag of the product filter, which follows from its random walk of the load.

    The filter is run on exact readings of a load ramp: a ram in mid stroke between closed valves is
    pushed back slowly, which only compresses the oil (eq. 2.3).
    """
    par = model.parameters
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    volume = par.line_volume_1 + par.piston_area * (middle - par.stroke_min)
    load: Array = _SLEW * np.arange(_RAMP_TICKS, dtype=np.float64)
    travel = -load * volume / (2.0 * par.bulk_modulus * par.piston_area**2)
    compressed = 0.5 * load / par.piston_area
    chamber = 0.5 * (par.supply_pressure + par.return_pressure)
    closed = np.full_like(load, -par.spool_null_bias)
    measured = np.column_stack(
        [middle + travel, chamber + compressed, chamber - compressed, closed]
    )
    run = run_filter(
        np.asarray(TICK * np.arange(_RAMP_TICKS)),
        closed / par.valve_gain,
        measured,
        model,
        sensors=sensors,
    )
    velocity = (travel[-1] - travel[-2]) / TICK
    rate = _SLEW / TICK
    return LoadLag(
        float(load[-1] - run.state("load_N")[-1]) / rate,
        float(velocity - run.state("velocity_m_per_s")[-1]) / rate,
    )


@dataclass(frozen=True)
class MotionBlocks:
    """Averages of a filter's estimates over blocks of 10 ms: float64 (n,) each, SI.

    Attributes:
        time_s: time of each block's first sample.
        velocity: mean velocity.
        velocity_spread: standard deviation of the velocity within the block.
        load: mean load.
        position: mean position.
        sound: bool (n,), whether in every sample of the block the position was measured, neither
            chamber was dry, and the command was within the valve's limit.
    """

    time_s: Array
    velocity: Array
    velocity_spread: Array
    load: Array
    position: Array
    sound: Flags


class BlockCollector:
    """Collects 10 ms blocks of the product filter's estimates, while samples come in.

    A wrong valve flow in the model biases the estimated pressures, and with them the load, in
    proportion to the velocity. The load is therefore corrected by the residuals of the pressures.

    Args:
        parameters: parameters of the rig, of which the piston area is used.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._area = parameters.piston_area
        self._rest = np.empty((0, 7))
        self._pieces: list[Array] = []

    def take(self, samples: Samples, run: FilterRun) -> None:
        """Add the next samples, any number, with the filter's estimates of them.

        Raises:
            ValueError: the estimates are not the product filter's.
        """
        if run.filter.name != DEFAULT_FILTER:
            raise ValueError(f"friction needs the {DEFAULT_FILTER} filter, not {run.filter.name}")
        difference = run.residual[:, 1] - run.residual[:, 2]
        rows = np.column_stack(
            [
                samples.time_s,
                run.state("velocity_m_per_s"),
                run.state("load_N") + self._area * difference,
                run.state("position_m"),
                samples.position,
                np.minimum(samples.pressure_1, samples.pressure_2),
                np.abs(samples.command),
            ]
        )
        rows = np.concatenate([self._rest, rows])
        blocks = len(rows) // BLOCK_TICKS
        self._rest = rows[blocks * BLOCK_TICKS :]
        table = rows[: blocks * BLOCK_TICKS].reshape(blocks, BLOCK_TICKS, rows.shape[1])
        time_s, velocity, load, position, measured, pressure, command = np.moveaxis(table, 2, 0)
        sound = np.isfinite(measured) & (pressure > DRY) & (command < 0.999 * COMMAND_LIMIT_V)
        self._pieces.append(
            np.column_stack(
                [
                    time_s[:, 0],
                    velocity.mean(axis=1),
                    velocity.std(axis=1),
                    load.mean(axis=1),
                    position.mean(axis=1),
                    sound.all(axis=1),
                ]
            )
        )

    @property
    def blocks(self) -> MotionBlocks:
        """Return all blocks so far; samples of a block that is not full yet are left out."""
        columns = np.concatenate([np.empty((0, 6)), *self._pieces]).T
        time_s, velocity, spread, load, position, sound = columns
        return MotionBlocks(time_s, velocity, spread, load, position, sound > 0.5)


@dataclass(frozen=True)
class FrictionSamples:
    """Friction in quasi-steady sliding, one value for each block: float64 (n,) each, SI.

    Attributes:
        velocity: m/s, positive when extending.
        force: friction in N against extension: the load less the spring, corrected for lags.
        acceleration: m/s^2.
        lag_correction: the part of the force that corrects for lags, N.
        stroke: int64 (n,), number of the stroke; a stroke lasts from one reversal to the next.
    """

    velocity: Array
    force: Array
    acceleration: Array
    lag_correction: Array
    stroke: NDArray[np.int64]


def friction_samples(
    blocks: MotionBlocks, lag: LoadLag, spring: Spring, parameters: Parameters
) -> FrictionSamples:
    """Return the friction in the quasi-steady blocks of a motion, corrected for lags.

    The arrays are empty if no stretch of `STEADY_BLOCKS` blocks or more is quasi-steady.

    Args:
        blocks: all blocks of the motion.
        lag: lag of the filter.
        spring: the spring whose force is taken off the load.
        parameters: parameters of the rig, of which stroke and friction law are used.
    """
    if blocks.time_s.size < STEADY_BLOCKS:
        none = np.empty(0)
        return FrictionSamples(none, none, none, none, np.empty(0, dtype=np.int64))
    load_rate = np.gradient(blocks.load, _BLOCK_S)
    velocity = blocks.velocity + lag.velocity * load_rate
    acceleration = np.gradient(blocks.velocity, _BLOCK_S)
    delayed = blocks.load + lag.load_s * load_rate - spring.force(blocks.position)
    bristle_lag_s = _bristle_lag(velocity, delayed, parameters)
    force = delayed + bristle_lag_s * np.gradient(delayed, _BLOCK_S)
    correction = force + spring.force(blocks.position) - blocks.load
    turned = np.diff(np.sign(blocks.velocity), prepend=np.sign(blocks.velocity[0])) != 0.0
    stroke = np.cumsum(turned)
    first = np.concatenate([[0], np.flatnonzero(turned)])
    travel = np.abs(blocks.position - blocks.position[first[stroke]])
    speed = np.abs(velocity)
    steady = (
        blocks.sound
        & (blocks.time_s - blocks.time_s[0] >= STARTED_S)
        & (travel > PRESLIDING_M)
        & (blocks.position > parameters.stroke_min + STROKE_MARGIN_M)
        & (blocks.position < parameters.stroke_max - STROKE_MARGIN_M)
        & (blocks.velocity_spread <= STEADY_SPREAD * speed)
        & (np.abs(acceleration) * (lag.load_s + bristle_lag_s) <= STEADY_LAG * speed)
        & np.isfinite(force)
    )
    steady = _in_long_runs(steady, STEADY_BLOCKS)
    return FrictionSamples(
        velocity[steady],
        force[steady],
        acceleration[steady],
        correction[steady],
        stroke[steady].astype(np.int64),
    )


def filled(values: Array) -> Array | None:
    """Return values (n,) with missing samples (NaN) interpolated from their neighbours.

    The result is None if more than one in ten is missing, as with a transducer that failed. If none
    is missing, it is `values` itself. Missing ones at an end get the nearest value.
    """
    known = np.isfinite(values)
    if known.all():
        return values
    if known.mean() < LEAST_KNOWN:
        return None
    ticks = np.arange(values.size)
    return np.interp(ticks, ticks[known], values[known])


def _bristle_lag(velocity: Array, force: Array, parameters: Parameters) -> Array:
    """Return the lag in s, (n,), of bristle friction behind its slip curve: |F| / (s_0 |v|).

    With Karnopp friction it is 0.
    """
    if parameters.friction_law == KARNOPP:
        return np.zeros_like(velocity)
    travelled = parameters.bristle_stiffness * np.maximum(np.abs(velocity), 1e-6)
    return np.asarray(np.abs(force) / travelled)


def _in_long_runs(flags: Flags, least: int) -> Flags:
    """Return bool (n,): true in each run of `least` or more true flags, but not at its two ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    kept = np.zeros_like(flags)
    for start, end in edges.reshape(-1, 2):
        # The rates of change at the ends of a run depend on blocks outside of it.
        kept[start + 1 : end - 1] = end - start >= least
    return kept
