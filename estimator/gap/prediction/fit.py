"""Fits parameters to records by prediction error: Gauss-Newton steps with given gains."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Gains, Record

from .linear import Column, Linear, assemble, cost_of, slices_of
from .predictor import Predictor
from .variables import Values, Variable

Changes = list[Array]
"""An array a record, float64 (n, outputs): how its innovations change by a unit step along a
column."""

_SHARES: Final = (1.0, 0.4, 0.1)
"""Parts of a step, which are tried in turn until one lowers the cost."""
_HOPELESS: Final = 1e300
"""Cost of a block that a model cannot predict at all."""
_BREAKDOWN: Final = 1e8
"""Standard deviations: a plant that is predicted so far off has broken down."""


@dataclass(frozen=True)
class Fitted:
    """Values of all parameters, and the cost of each block with them (float64 (blocks,))."""

    values: dict[str, float]
    costs: Array

    @property
    def cost(self) -> float:
        """Cost of all blocks."""
        return float(self.costs.sum())


def _change(changed: Array, base: Array, size: float) -> Array:
    """Return the change of innovations (n, outputs) by one unit of what changed them by `size`."""
    change = changed - base
    # A plant that breaks down with a probe says nothing of that direction.
    if not np.abs(change).max() < _BREAKDOWN:
        return np.zeros_like(change)
    return np.asarray(change / size)


_KEPT: Final = 3
"""Values whose gains are kept: a search goes back to those that it came from."""


class Fitter:
    """Fits a plant's parameters to records.

    What was run is kept until the gains change: searches ask for the same columns again and again.

    Args:
        predictor: of the plant.
        records: to fit to; their gains are those of the last `refresh`.
        pool: threads to run in.
    """

    def __init__(
        self, predictor: Predictor, records: Sequence[Record], pool: ThreadPoolExecutor
    ) -> None:
        self.predictor, self.records, self.pool = predictor, tuple(records), pool
        self.blocks = [slices_of(record, predictor.plant.period) for record in self.records]
        self._bases: dict[tuple[float, ...], list[tuple[Array, Array]]] = {}
        self._changes: dict[tuple[object, ...], Changes] = {}
        self._filtered: dict[str, float] = {}
        self._gains: dict[tuple[float, ...], list[Gains]] = {}

    def refresh(self, values: Values) -> None:
        """Filter the records anew with these values, for their gains; the last few are kept."""
        if self._filtered == values:
            return
        self._filtered = dict(values)
        self._bases.clear()
        self._changes.clear()
        key = tuple(values.values())
        known = self._gains.pop(key, None)
        if known is None:
            list(self.pool.map(lambda record: self.predictor.filter(record, values), self.records))
            known = [record.gains for record in self.records]
        for record, gains in zip(self.records, known, strict=True):
            record.gains = gains
        self._gains[key] = known
        while len(self._gains) > _KEPT:
            self._gains.pop(next(iter(self._gains)))

    @property
    def samples(self) -> int:
        """Readings used, those of the settling left out."""
        return sum(
            int(np.isfinite(record.gains.variances[block]).sum())
            for record, blocks in zip(self.records, self.blocks, strict=True)
            for block in blocks
        )

    def innovations(self, values: Values) -> list[tuple[Array, Array]]:
        """Return of each record innovations (n, outputs) and filtered states (n, states)."""
        key = tuple(values.values())
        if key not in self._bases:
            self._bases[key] = list(
                self.pool.map(lambda r: self.predictor.innovations(r, values), self.records)
            )
        return self._bases[key]

    def costs(self, values: Values) -> Array:
        """Return the cost of each block of the records (float64 (blocks,))."""
        return self._block_costs([innovations for innovations, _ in self.innovations(values)])

    def changed_costs(self, values: Values, changes: Changes) -> Array:
        """Return the costs (blocks,) of what is left at `values` with changes added."""
        bases = self.innovations(values)
        return self._block_costs(
            [base + change for (base, _), change in zip(bases, changes, strict=True)]
        )

    def _block_costs(self, innovations: Sequence[Array]) -> Array:
        parts = []
        for of_record, blocks in zip(innovations, self.blocks, strict=True):
            cost = cost_of(of_record).sum(1)
            parts += [float(cost[block].sum()) for block in blocks]
        costs = np.array(parts)
        return np.where(np.isfinite(costs), costs, _HOPELESS)

    def columns(self, values: Values, variables: Sequence[Variable]) -> list[Column]:
        """Return the columns of variables at given values."""
        return [variable.column(values) for variable in variables]

    def changes(self, values: Values, columns: Sequence[Column]) -> list[Changes]:
        """Return of each column and record the change of innovations by a unit step."""
        at = tuple(values.values())
        keys = [(at, column.name, column.size, tuple(column.values.values())) for column in columns]
        missing = [i for i, key in enumerate(keys) if key not in self._changes]
        found: dict[int, Changes] = {}
        bases = self.innovations(values)

        def run(task: tuple[list[int], int]) -> list[Array]:
            group, number = task
            values_of = [columns[i].values for i in group]
            record, base = self.records[number], bases[number][0]
            if len(group) == 1:
                changed = [self.predictor.innovations(record, values_of[0])[0]]
            else:
                # Lanes round otherwise, and where a ram sticks and slips that is not little.
                base, *changed = self.predictor.innovations_of(record, [values, *values_of])
            return [
                _change(each, base, columns[i].size) for i, each in zip(group, changed, strict=True)
            ]

        count = range(len(self.records))
        groups = self.predictor.groups([columns[i].values for i in missing])
        tasks = [([missing[k] for k in group], number) for group in groups for number in count]
        for (group, _), changes in zip(tasks, self.pool.map(run, tasks), strict=True):
            for i, change in zip(group, changes, strict=True):
                found.setdefault(i, []).append(change)
        self._changes |= {keys[i]: found[i] for i in missing}
        return [self._changes[key] for key in keys]

    def linearise(
        self, values: Values, columns: Sequence[Column], kept: Mapping[str, Changes] | None = None
    ) -> Linear:
        """Return the linearisation of the innovations about some values, with present gains.

        Columns whose changes are in `kept`, by name, are taken from there.
        """
        kept = kept or {}
        asked = [column for column in columns if column.name not in kept]
        found = dict(kept)
        found |= zip([column.name for column in asked], self.changes(values, asked), strict=True)
        bases = [innovations for innovations, _ in self.innovations(values)]
        used = [np.isfinite(record.gains.variances) for record in self.records]
        changes = [found[column.name] for column in columns]
        return assemble(columns, bases, changes, used, self.blocks, self.pool)

    def fit(
        self, values: Values, variables: Sequence[Variable], steps: int = 4,
        tolerance: float = 1e-4, kept: Mapping[str, Changes] | None = None,
    ) -> Fitted:  # fmt: skip
        """Return the best values of variables, starting from `values`.

        Stops where a step gains less than `tolerance` of the cost. Columns in `kept`, by name, are
        not run again (chord method): with these, nuisances follow at the cost of none.
        """
        present = Fitted(dict(values), self.costs(values))
        if not present.cost < _BREAKDOWN * self.samples:
            return present
        for _ in range(steps):
            columns = self.columns(present.values, variables)
            linear = self.linearise(present.values, columns, kept)
            step, _ = linear.solve([column.name for column in columns])
            better = None
            for share in _SHARES:
                tried = dict(present.values)
                for variable, change in zip(variables, step, strict=True):
                    tried = variable.moved(tried, share * change)
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
