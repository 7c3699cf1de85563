"""Fits parameters to records by prediction error: Levenberg-Marquardt steps with given gains."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .linear import Column, Linear, cost_of, linearise, slices_of
from .plant import Array
from .predictor import Predictor
from .records import Record
from .variables import Values, Variable


@dataclass(frozen=True)
class Fitted:
    """Values of all parameters, and the cost of each block with them (float64 (blocks,))."""

    values: dict[str, float]
    costs: Array

    @property
    def cost(self) -> float:
        """Cost of all blocks."""
        return float(self.costs.sum())


class Fitter:
    """Fits a plant's parameters to records.

    Args:
        predictor: of the plant.
        records: to fit to; their gains are those of the last `refresh`.
        pool: threads to run in.
    """

    def __init__(
        self, predictor: Predictor, records: Sequence[Record], pool: ThreadPoolExecutor
    ) -> None:
        self.predictor, self.records, self.pool = predictor, tuple(records), pool

    def refresh(self, values: Values) -> None:
        """Filter the records anew with these values, for their gains."""
        list(self.pool.map(lambda record: self.predictor.filter(record, values), self.records))

    def costs(self, values: Values) -> Array:
        """Return the cost of each block of the records (float64 (blocks,))."""

        def run(record: Record) -> list[float]:
            cost = cost_of(self.predictor.innovations(record, values)[0])
            return [
                float(cost[block].sum()) for block in slices_of(record, self.predictor.plant.period)
            ]

        parts = np.concatenate(list(self.pool.map(run, self.records)))
        return np.where(np.isfinite(parts), parts, 1e300)

    def columns(self, values: Values, variables: Sequence[Variable]) -> list[Column]:
        """Return the columns of variables at given values."""
        columns = []
        for variable in variables:
            at = values[variable.parameter]
            probe = variable.probe if at + variable.probe <= variable.upper else -variable.probe
            columns.append(
                Column(
                    f"{variable.name}.{variable.key}", variable.put(values, at + probe), probe,
                    variable.lower - at, variable.upper - at,
                )
            )  # fmt: skip
        return columns

    def linearise(self, values: Values, columns: Sequence[Column]) -> Linear:
        """Return the linearisation of the innovations about some values, with present gains."""
        return linearise(self.predictor, self.records, values, columns, self.pool)

    def fit(
        self, values: Values, variables: Sequence[Variable], steps: int = 4, tolerance: float = 1e-4
    ) -> Fitted:
        """Return the best values of variables, starting from `values`.

        Stops where a step gains less than `tolerance` of the cost.
        """
        present = Fitted(dict(values), self.costs(values))
        for _ in range(steps):
            linear = self.linearise(present.values, self.columns(present.values, variables))
            names = [column.name for column in linear.columns]
            step, _ = linear.solve(names)
            better = None
            for share in (1.0, 0.4, 0.1):
                tried = dict(present.values)
                for variable, change in zip(variables, step, strict=True):
                    at = present.values[variable.parameter] + share * change
                    tried = variable.put(tried, variable.within(at))
                costs = self.costs(tried)
                if costs.sum() < present.cost:
                    better = Fitted(tried, costs)
                    break
            if better is None:
                break
            gained = present.cost - better.cost
            present = better
            if gained < tolerance * present.cost:
                break
        return present
