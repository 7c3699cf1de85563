"""Where model and recordings disagree: which disturbance of which equation would explain it.

A disturbance is a sum of hat functions of a region's quantity (velocity, spool opening, ...) that
is added to an equation, sample by sample along the filtered course. Its coefficients are columns of
the same linearisation as parameters are, so that they share nuisances, blocks and errors.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from .fit import Fitter
from .linear import Column, Linear
from .plant import Array, Equation, Region
from .records import Record
from .results import Curve
from .variables import Values, Variable

HATS: Final = 9
"""Hat functions of a curve; the outermost are constant beyond their middles."""


def _middles(values: Array) -> Array:
    """Return the hats' middles (HATS,): evenly spread over what the motion covers."""
    low, high = np.quantile(values, (0.01, 0.99))
    return np.linspace(low, high, HATS)


def hats(values: Array, middles: Array) -> Array:
    """Return hat functions (n, HATS) of values (n,); they add up to one."""
    width = middles[1] - middles[0]
    place = np.clip((values - middles[0]) / width, 0.0, len(middles) - 1.0)
    return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(len(middles))), 0.0))


def disturbance_columns(
    fitter: Fitter, values: Values, equation: Equation, region: Region
) -> tuple[list[Column], Array]:
    """Return a column for each hat, in units of the disturbance, and the hats' middles."""
    predictor = fitter.predictor
    covered = [
        region.value(predictor.innovations(record, values)[1], record.inputs)
        for record in fitter.records
    ]
    middles = _middles(np.concatenate(covered))
    if not middles[1] > middles[0]:
        return [], middles
    state = predictor.plant.states[equation.state]
    states = predictor.innovations(fitter.records[0], values)[1]
    rate = float(np.median(np.abs(equation.rate(states, values))))
    amplitude = max(state.noise, 1e-12) / rate
    columns = []
    for number in range(HATS):

        def kicks(record: Record, states: Array, number: int = number) -> Array:
            shape = hats(region.value(states, record.inputs), middles)[:, number]
            kick = np.zeros_like(states)
            kick[:, equation.state] = shape * amplitude * equation.rate(states, values)
            return kick

        columns.append(
            Column(f"{equation.name}|{region.name}#{number}", values, amplitude, kicks=kicks)
        )
    return columns, middles


def curves(
    fitter: Fitter, values: Values, variables: Sequence[Variable], floor: float
) -> list[Curve]:
    """Return disturbances that would explain the cost above a floor (per reading), best first."""
    plant = fitter.predictor.plant
    base_columns = fitter.columns(values, variables)
    base = [column.name for column in base_columns]
    found = []
    for equation in plant.equations:
        for name in equation.of:
            region = plant.regions[name]
            columns, middles = disturbance_columns(fitter, values, equation, region)
            if not columns:
                continue
            linear = fitter.linearise(values, [*base_columns, *columns])
            found.append(
                _curve(linear, base, [c.name for c in columns], equation, region, middles, floor)
            )
    return sorted(found, key=lambda curve: -curve.gain)


def _curve(
    linear: Linear, base: list[str], names: list[str], equation: Equation, region: Region,
    middles: Array, floor: float,
) -> Curve:  # fmt: skip
    without = linear.solve(base)[1]
    steps, gain = linear.solve([*base, *names])
    errors = linear.errors([*base, *names], steps)
    excess = float(linear.squares.sum()) - without - floor * linear.samples
    return Curve(
        equation.name, region.name, middles, steps[len(base) :], errors[len(base) :],
        equation.unit, region.unit, equation.shown, region.shown, gain - without,
        (gain - without) / excess if excess > 0.0 else 0.0,
    )  # fmt: skip
