"""This module measures the gap: the prediction error above the noise floor, on held-out recordings.

Nothing was fitted to these recordings. The first seconds of one are also simulated freely, to be
seen beside the recording, never for a verdict: with stick-slip, two free runs that differ by very
little soon part in phase, so that they prove nothing.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice, pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.gap.plant import Array, Record

from .bands import band_powers, edges
from .fit import Measured
from .linear import mean_squares, settling
from .predictor import Predictor
from .results import Band, ChannelGap, FreeRun
from .variables import Values

FLOOR_TWINS: Final = 8
"""Number of twins over which the floor is averaged. Where a ram sticks and slips, the error of one
twin may be twice that of another, because a few breaks-away cause most of the error. With eight
twins the floor adds 6 % to the scatter that the recording itself has by chance."""
_DIGITS: Final = 4
"""Number of significant digits of fitted values with which the floor's twins are made. Stick-slip
magnifies the twelfth digit of a value to half a millimetre within seconds, and a fit settles
values to some seven digits only. Four digits are the same after any fit of the same recordings,
and a floor varies by far less within them than from twin to twin."""
SECONDS: Final = 4.0
"""Length of the free simulations, s."""
CHANNELS: Final = 3
"""Number of outputs that are drawn: the plant's first ones."""


def _errors(predictor: Predictor, record: Record, values: Values) -> tuple[Array, Array, Array]:
    """Return mean squared errors over the horizon, whiteness and band powers of predictions.

    The filter's gains are computed with the same values, and its settling is left out of all three.
    The mean squares (outputs,) are in squared SI units. The whiteness (outputs,) is the correlation
    of innovations one sample apart. The power of the innovations in frequency bands is (bands,
    outputs).
    """
    settled = slice(settling(predictor.plant.period), None)
    gains = predictor.filter(record, values)
    innovations, states = predictor.innovations(record, gains, values)
    errors, e = predictor.ahead(record, values, states)[settled], innovations[settled]
    products = (e[1:] * e[:-1]).sum(0)
    with np.errstate(all="ignore"):
        whiteness = products / (e**2).sum(0)
    return mean_squares(errors), whiteness, band_powers(e, predictor.plant.period)


def channel_gaps(
    predictor: Predictor, records: Sequence[Record], before: Values, after: Values,
    pool: ThreadPoolExecutor, seed: int = 7, measured: Measured | None = None,
) -> list[ChannelGap]:  # fmt: skip
    """Return the gap of each channel over all records, for the model as given and as written.

    A channel that no record has is left out. The floor is the mean over `FLOOR_TWINS` twins of each
    record, made and predicted with the values of `after`, of which those that differ from `before`
    are rounded (`rounded`). The filter's settling is left out.

    Args:
        predictor: predictor of the plant.
        records: recordings to which nothing was fitted, at least one.
        before: values of all parameters in the model as given.
        after: values of all parameters in the model as written.
        pool: threads to run in.
        seed: seed of the sensor noise of the twins.
        measured: what was measured of these records before; what is measured now is added. None if
            it is not kept.
    """
    known = {} if measured is None else measured

    def run(task: tuple[Values, int, int | None]) -> tuple[Array, Array, Array]:
        values, index, twin = task
        noise = None if twin is None else seed + index + len(records) * twin
        key = (tuple(values.values()), index, noise)
        if key not in known:
            record = records[index]
            made = record if noise is None else predictor.twin(record, values, noise)
            known[key] = _errors(predictor, made, values)
        return known[key]

    outputs = predictor.plant.outputs
    variances = np.array([output.variance for output in outputs])
    numbers = range(len(records))
    alike = rounded(after, before)
    tasks: dict[str, list[tuple[Values, int, int | None]]] = {
        "before": [(before, index, None) for index in numbers],
        "after": [(after, index, None) for index in numbers],
        "floor": [(alike, index, twin) for index in numbers for twin in range(FLOOR_TWINS)],
    }
    found = pool.map(run, [task for of_name in tasks.values() for task in of_name])
    mean, scatter = {}, np.zeros(len(outputs))
    for name, of_name in tasks.items():
        parts = list(islice(found, len(of_name)))
        lengths = np.array([len(records[index]) for _, index, _ in of_name])
        mean[name] = tuple(_average([part[k] for part in parts], lengths) for k in range(3))
        if name == "floor":
            scatter = _scatter([part[0] for part in parts], [len(record) for record in records])
    ends = edges(predictor.plant.period)
    gaps: list[ChannelGap] = []
    for k, output in enumerate(outputs):
        if all(record.lacks(k) for record in records):
            continue
        square, white = ({name: float(mean[name][i][k]) for name in mean} for i in (0, 1))
        gaps.append(
            ChannelGap(
                output.channel,
                square["before"] / variances[k], square["after"] / variances[k],
                square["floor"] / variances[k],
                max(square["before"] - square["floor"], 0.0) ** 0.5,
                max(square["after"] - square["floor"], 0.0) ** 0.5,
                output.unit, output.shown or (output.unit, 1.0),
                white["before"], white["after"], white["floor"],
                tuple(
                    Band(low, high, *(float(mean[name][2][band, k]) for name in mean))
                    for band, (low, high) in enumerate(pairwise(ends))
                ),
                float(scatter[k]) / variances[k],
            )
        )  # fmt: skip
    return gaps


def rounded(values: Values, given: Values) -> Values:
    """Return values with those that differ from the given ones rounded to four digits (`_DIGITS`).

    Models whose fits differ in further digits only have the same twins, and so the same floor.
    """
    return {
        name: value if value == given[name] else float(f"{value:.{_DIGITS}g}")
        for name, value in values.items()
    }


def _average(parts: Sequence[Array], lengths: NDArray[np.int64]) -> Array:
    """Return the mean of arrays, weighted by the lengths of the records that they belong to.

    Elements that are not finite are left out; an element that is finite in none is NaN.
    """
    stacked = np.array(parts)
    known = np.isfinite(stacked)
    weights = known * lengths.reshape(-1, *[1] * (stacked.ndim - 1))
    with np.errstate(invalid="ignore"):
        return np.asarray((np.where(known, stacked, 0.0) * weights).sum(0) / weights.sum(0))


def _scatter(squares: Sequence[Array], lengths: Sequence[int]) -> Array:
    """Return by how much a mean square less the floor scatters by chance, SI squared (outputs,).

    It is the standard deviation of the mean square of one run of all records, less that of its
    twins, as the twins of each record scatter.

    Args:
        squares: mean squares (outputs,) of each twin: all twins of the first record, then those of
            the next, and so on.
        lengths: numbers of samples of the records.
    """
    by_record = np.reshape(squares, (len(lengths), FLOOR_TWINS, -1)).var(axis=1, ddof=1)
    known = np.isfinite(by_record)
    weights = known * np.array(lengths)[:, None]
    with np.errstate(invalid="ignore"):
        shares = weights / weights.sum(0)
    variances = (shares**2 * np.where(known, by_record, 0.0)).sum(axis=0)
    return np.asarray(np.sqrt(variances * (1.0 + 1.0 / FLOOR_TWINS)))


def mean_gap(gaps: Sequence[ChannelGap]) -> tuple[float, float]:
    """Return two means of the channels' excess over the floor, in noise variances.

    The first is that of the model as given (`before`), the second that of the model as written
    (`after`). A channel below the floor counts as 0. There must be a channel.
    """
    before = float(np.mean([max(gap.before - gap.floor, 0.0) for gap in gaps]))
    after = float(np.mean([max(gap.after - gap.floor, 0.0) for gap in gaps]))
    return before, after


def free_runs(
    predictor: Predictor, records: Sequence[Record], before: Values, after: Values
) -> list[FreeRun]:
    """Return, for each drawn channel, the first seconds of the first record beside both models.

    The plant's first `CHANNELS` outputs are drawn, over `SECONDS` or the whole record if it is
    shorter. Both models start from the state that `Plant.start` derives from the first readings,
    such as a ram at rest. From then on they get the commands alone.

    Args:
        predictor: predictor of the plant.
        records: only the first is used; without records the result is empty.
        before: values of all parameters in the model as given.
        after: values of all parameters in the model as written.
    """
    if not records:
        return []
    plant = predictor.plant
    record = records[0].part(0, round(SECONDS / plant.period))
    given = predictor.simulate(record, before, steered=False)[1]
    written = predictor.simulate(record, after, steered=False)[1]
    time_s = plant.period * (record.first + np.arange(len(record), dtype=np.float64))
    return [
        FreeRun(
            record.source, time_s, output.channel, output.unit, output.shown or (output.unit, 1.0),
            np.where(np.isfinite(record.variances[:, k]), record.readings[:, k], np.nan),
            given[:, k], written[:, k],
        )
        for k, output in enumerate(plant.outputs[:CHANNELS])
    ]  # fmt: skip
