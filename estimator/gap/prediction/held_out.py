"""The gap on recordings that nothing was fitted to: prediction error above the noise floor."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice, pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.gap.plant import Array, Record, band_powers, edges

from .linear import SETTLING_S, mean_squares
from .predictor import Predictor
from .results import Band, ChannelGap
from .variables import Values

FLOOR_TWINS: Final = 4
"""Twins that the floor is the mean of: where a ram sticks and slips, that of one is twice that of
another, for a few breaks-away are most of the error."""


def _errors(predictor: Predictor, record: Record, values: Values) -> tuple[Array, Array, Array]:
    """Return mean squares of predictions over the horizon, SI; of innovations whiteness and power.

    The power is that of each frequency band, (bands, outputs).
    """
    settled = slice(round(SETTLING_S / predictor.plant.period), None)
    errors, e = (each[settled] for each in filtered_errors(predictor, record, values))
    products = (e[1:] * e[:-1]).sum(0)
    with np.errstate(all="ignore"):
        whiteness = products / (e**2).sum(0)
    return mean_squares(errors), whiteness, band_powers(e, predictor.plant.period)


def filtered_errors(predictor: Predictor, record: Record, values: Values) -> tuple[Array, Array]:
    """Return errors over the horizon, SI, and innovations, (n, outputs); the gains are its own."""
    gains = predictor.filter(record, values)
    innovations, states = predictor.innovations(record, gains, values)
    return predictor.ahead(record, values, states), innovations


def channel_gaps(
    predictor: Predictor, records: Sequence[Record], before: Values, after: Values,
    pool: ThreadPoolExecutor, seed: int = 7,
) -> list[ChannelGap]:  # fmt: skip
    """Return each channel's gap, of the model as given and as written, over all records."""

    def run(task: tuple[Values, int, int | None]) -> tuple[Array, Array, Array]:
        values, index, twin = task
        if twin is None:
            return _errors(predictor, records[index], values)
        made = predictor.twin(records[index], values, seed + index + len(records) * twin)
        return _errors(predictor, made, values)

    outputs = predictor.plant.outputs
    variances = np.array([output.variance for output in outputs])
    numbers = range(len(records))
    tasks: dict[str, list[tuple[Values, int, int | None]]] = {
        "before": [(before, index, None) for index in numbers],
        "after": [(after, index, None) for index in numbers],
        "floor": [(after, index, twin) for index in numbers for twin in range(FLOOR_TWINS)],
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


def _average(parts: Sequence[Array], lengths: NDArray[np.int64]) -> Array:
    """Return the mean of parts, of those that have a value, by the lengths of their records."""
    stacked = np.array(parts)
    known = np.isfinite(stacked)
    weights = known * lengths.reshape(-1, *[1] * (stacked.ndim - 1))
    with np.errstate(invalid="ignore"):
        return np.asarray((np.where(known, stacked, 0.0) * weights).sum(0) / weights.sum(0))


def _scatter(squares: Sequence[Array], lengths: Sequence[int]) -> Array:
    """Return the standard deviation by chance of one run's mean squares less the floor, (outputs,).

    Args:
        squares: of each record's twins, one record after the other.
        lengths: of the records.
    """
    by_record = np.reshape(squares, (len(lengths), FLOOR_TWINS, -1)).var(axis=1, ddof=1)
    known = np.isfinite(by_record)
    weights = known * np.array(lengths)[:, None]
    with np.errstate(invalid="ignore"):
        shares = weights / weights.sum(0)
    variances = (shares**2 * np.where(known, by_record, 0.0)).sum(axis=0)
    return np.asarray(np.sqrt(variances * (1.0 + 1.0 / FLOOR_TWINS)))


def mean_gap(gaps: Sequence[ChannelGap]) -> tuple[float, float]:
    """Return the mean over channels of the excess over the floor, before and after."""
    before = float(np.mean([max(gap.before - gap.floor, 0.0) for gap in gaps]))
    after = float(np.mean([max(gap.after - gap.floor, 0.0) for gap in gaps]))
    return before, after
