"""This module finds parameters that drift within a recording, for example while the oil warms.

A disturbance of an equation against time (`disturbances`) cannot show a drift, because what a
softer oil adds to a flow depends on the rates of the pressures. A trend of the parameter can show
it. What a trend changes in the innovations is what the parameter itself changes, multiplied by the
time since the recording began. So a trend is fitted from the block sums of the linearisation,
without another run of the plant (a test of parameter constancy, after Nyblom 1989).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant
from estimator.gap.prediction import (
    Curve,
    Filtered,
    Values,
    Variable,
    bounded_least_squares,
    standard_errors,
)

from .findings import CHANCE

CERTAIN: Final = 4.0
"""Least size of a trend in standard errors, by the scatter of the blocks' scores."""


def drifts(
    filtered: Filtered, values: Values, variables: Sequence[Variable], floor: float
) -> list[Curve]:
    """Return those fitted parameters that drift within a recording, with their trends as curves.

    A trend is a constant rate of change of one parameter, per s. The rate is the same in all
    recordings, and the time counts from the beginning of each of them. Each trend is fitted alone,
    together with all variables.

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters, fitted.
        variables: variables that were fitted.
        floor: cost per reading of a rig that is exactly the model. It is used only for the share
            of each curve: its gain as a part of the cost above the floor that the variables leave.

    Returns:
        A curve for each parameter whose trend gains at least `CHANCE` and is at least `CERTAIN`
        standard errors large, that with most gain first. The curve has two points: the parameter's
        value when a recording begins, and at the latest block of any recording. Its `equation` is
        the parameter's name, and its `region` is "time".
    """
    columns = filtered.columns(values, variables)
    linear = filtered.linearise(values, columns)
    time_s = _times(filtered)
    lower = np.array([column.lower for column in columns])
    upper = np.array([column.upper for column in columns])
    products, slopes = linear.products, linear.slopes
    still = bounded_least_squares(products.sum(0), slopes.sum(0), lower, upper)
    excess = float(linear.squares.sum()) + _change(products, slopes, still).sum()
    excess -= floor * linear.samples
    found = []
    for j, variable in enumerate(variables):
        wide = np.concatenate([products, time_s[:, None, None] * products[:, :, j : j + 1]], axis=2)
        trend = time_s[:, None] * products[:, j]
        last = np.concatenate([trend, (time_s**2 * products[:, j, j])[:, None]], axis=1)
        wide = np.concatenate([wide, last[:, None, :]], axis=1)
        sloped = np.concatenate([slopes, (time_s * slopes[:, j])[:, None]], axis=1)
        steps = bounded_least_squares(
            wide.sum(0), sloped.sum(0), np.append(lower, -np.inf), np.append(upper, np.inf)
        )
        gains = _change(products, slopes, still) - _change(wide, sloped, steps)
        error = standard_errors(wide, sloped + wide @ steps)[-1]
        z = abs(float(steps[-1])) / max(float(error), 1e-300)
        if gains.sum() < CHANCE or z < CERTAIN:
            continue
        found.append(_curve(filtered.predictor.plant, values, variable, steps, j,
                            float(time_s.max()), float(gains.sum()), z, excess))  # fmt: skip
    return sorted(found, key=lambda curve: -curve.gain)


def _times(filtered: Filtered) -> Array:
    """Return for each block the time of its middle since its recording began, s (blocks,)."""
    period = filtered.predictor.plant.period
    return np.array(
        [
            (record.first + 0.5 * (block.start + block.stop)) * period
            for record, blocks in zip(filtered.records, filtered.blocks, strict=True)
            for block in blocks
        ]
    )


def _change(products: Array, slopes: Array, steps: Array) -> Array:
    """Return by how much steps (k,) change each block's sum of squares, (blocks,).

    `products` (blocks, k, k) and `slopes` (blocks, k) are as in `Linear`.
    """
    return np.asarray(2.0 * slopes @ steps + (products @ steps) @ steps)


def _curve(
    plant: Plant, values: Values, variable: Variable, steps: Array, j: int,
    last_s: float, gain: float, z: float, excess: float,
) -> Curve:  # fmt: skip
    at = np.array([0.0, last_s])
    course = values[variable.parameter] + np.array(
        [variable.reach(values, float(steps[j] + t * steps[-1])) for t in at]
    )
    error = abs(course[1] - course[0]) / z
    unit = next(p.unit for p in plant.parameters if p.name == variable.parameter)
    return Curve(
        variable.parameter, "time", at, course, np.full(2, error), unit, "s", (unit, 1.0),
        ("s", 1.0), gain, gain / excess if excess > 0.0 else 0.0,
    )  # fmt: skip
