"""This module fits parameters to records by prediction error, with the filter's gains fixed."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final
from weakref import WeakValueDictionary

import numpy as np

from estimator.gap.plant import Array, BoolArray, Gains, Record
from rig.lanes import LANES

from .linear import Column, Linear, assemble, cost_of, slices_of
from .predictor import Predictor
from .variables import Values, Variable

Measured = dict[tuple[object, ...], tuple[Array, Array, Array]]
"""Errors, whiteness and band powers of predictions of records or their twins (`held_out`), by the
values of all parameters, the index of the record, and the seed of the twin's noise (None: of the
record itself)."""

Changes = list[Array]
"""One array for each record, float64 (n, outputs): the change of its innovations by a unit step
along a column."""

_SHARES: Final = (1.0, 0.4, 0.1)
"""Parts of a Gauss-Newton step, which are tried in turn until one lowers the cost."""
_HOPELESS: Final = 1e300
"""Cost that is given to a block whose predictions are not finite."""
_BREAKDOWN: Final = 1e8
"""Standard deviations. A model whose predictions miss by more has broken down."""


@dataclass(frozen=True)
class Fitted:
    """Values of all parameters by name, and each block's cost with them (float64 (blocks,)).

    Attributes:
        values: the values, SI.
        costs: the costs.
        before: sum of the costs where the fit started; NaN if the values come from no fit.
    """

    values: dict[str, float]
    costs: Array
    before: float = float("nan")

    @property
    def cost(self) -> float:
        """Return the sum of the costs of all blocks."""
        return float(self.costs.sum())


def _change(changed: Array, base: Array, size: float) -> Array:
    """Return the change of innovations (n, outputs) per unit of a change that has the given size.

    The result is 0 everywhere if the plant breaks down with the change.
    """
    change = changed - base
    # Where the plant breaks down with a probe, nothing is known about that direction.
    if not np.abs(change).max() < _BREAKDOWN:
        return np.zeros_like(change)
    return np.asarray(change / size)


_KEPT: Final = 3
"""Number of sets of values whose gains are kept, because a search returns to earlier values."""


class Fitter:
    """Filters the records of a plant, so that the plant's parameters can be fitted to them.

    Args:
        predictor: predictor of the plant.
        records: records to fit to.
        pool: threads to run in.

    Attributes:
        measured: what `channel_gaps` has measured of these records.
    """

    def __init__(
        self, predictor: Predictor, records: Sequence[Record], pool: ThreadPoolExecutor
    ) -> None:
        self.predictor, self.records, self.pool = predictor, tuple(records), pool
        self.measured: Measured = {}
        self.blocks = [slices_of(record, predictor.plant.period) for record in self.records]
        self._gains: dict[tuple[float, ...], tuple[Gains, ...]] = {}
        self._in_use: WeakValueDictionary[tuple[float, ...], Filtered] = WeakValueDictionary()

    def filtered(self, values: Values) -> "Filtered":
        """Return the records with the gains of a filter whose parameters have these values.

        The gains of the last three sets of values are kept and not computed again. An object that
        is in use with these values is returned itself, with all that it has computed.
        """
        key = tuple(values.values())
        in_use = self._in_use.get(key)
        gains = self._gains.pop(key, None if in_use is None else in_use.gains)
        if gains is None:
            run = self.pool.map(lambda record: self.predictor.filter(record, values), self.records)
            gains = tuple(run)
        self._gains[key] = gains
        while len(self._gains) > _KEPT:
            self._gains.pop(next(iter(self._gains)))
        if in_use is None:
            in_use = self._in_use[key] = Filtered(self, values, gains)
        return in_use


class Filtered:
    """Records with the gains of a filter whose parameters had given values.

    With these gains it predicts, scores and fits, whatever values the predictions are made with.
    Results depend on the records, the gains and the arguments alone. They are cached and must not
    be changed. The cost of a block is the sum of the squares of its innovations, of which outliers
    count less (`cost_of`).

    Attributes:
        fitter: fitter that made this object.
        predictor: predictor of the plant.
        records: records to fit to.
        blocks: for each record, its blocks as slices.
        pool: threads to run in.
        values: values of all parameters with which the gains were computed.
        gains: gains of each record.
    """

    def __init__(self, fitter: Fitter, values: Values, gains: Sequence[Gains]) -> None:
        self.fitter, self.predictor, self.pool = fitter, fitter.predictor, fitter.pool
        self.records, self.blocks = fitter.records, fitter.blocks
        self.values, self.gains = dict(values), tuple(gains)
        self._bases: dict[tuple[float, ...], list[tuple[Array, Array]]] = {}
        self._changes: dict[tuple[object, ...], Changes] = {}

    def at(self, values: Values) -> "Filtered":
        """Return the records filtered with these values: this object itself if they are its own."""
        return self if self.values == values else self.fitter.filtered(values)

    @property
    def used(self) -> list[BoolArray]:
        """Return for each record whether each reading is used, bool (n, outputs)."""
        return [np.isfinite(gains.variances) for gains in self.gains]

    @property
    def samples(self) -> int:
        """Return the number of readings used inside the blocks of all records."""
        return sum(
            int(used[block].sum())
            for used, blocks in zip(self.used, self.blocks, strict=True)
            for block in blocks
        )

    def innovations(self, values: Values) -> list[tuple[Array, Array]]:
        """Return for each record the innovations (n, outputs) and the filtered states (n, states).

        `values` are those of the predictions; the gains stay as they are. The innovations are
        divided by their standard deviations, and 0 where a reading is not used.
        """
        key = tuple(values.values())
        if key not in self._bases:
            self._bases[key] = list(
                self.pool.map(
                    lambda record, gains: self.predictor.innovations(record, gains, values),
                    self.records, self.gains,
                )
            )  # fmt: skip
        return self._bases[key]

    def costs(self, values: Values) -> Array:
        """Return the cost of each block of all records with these values, float64 (blocks,).

        A block whose innovations are not finite costs 1e300.
        """
        return self.costs_of([innovations for innovations, _ in self.innovations(values)])

    def changed_costs(self, values: Values, changes: Changes) -> Array:
        """Return the costs (blocks,) of the innovations at `values` with `changes` added.

        `changes` has an array (n, outputs) for each record. A block whose innovations are not
        finite costs 1e300.
        """
        bases = self.innovations(values)
        return self.costs_of(
            [base + change for (base, _), change in zip(bases, changes, strict=True)]
        )

    def costs_of(self, innovations: Sequence[Array]) -> Array:
        """Return the cost of each block of all records, float64 (blocks,), of given innovations.

        `innovations` has an array (n, outputs) for each record. A block whose innovations are not
        finite costs 1e300.
        """
        parts = []
        for of_record, blocks in zip(innovations, self.blocks, strict=True):
            cost = cost_of(of_record).sum(1)
            parts += [float(cost[block].sum()) for block in blocks]
        costs = np.array(parts)
        return np.where(np.isfinite(costs), costs, _HOPELESS)

    def columns(self, values: Values, variables: Sequence[Variable]) -> list[Column]:
        """Return for each variable the direction in which it is probed, with bounds of its steps.

        The directions begin at the given values. Nothing is run here: the method `changes` computes
        what they change in the innovations.
        """
        return [variable.column(values) for variable in variables]

    def changes(self, values: Values, columns: Sequence[Column]) -> list[Changes]:
        """Return, for each column and each record, the change of the innovations by a unit step.

        The changes are differences from the innovations at `values`. They are all 0 in a record in
        which the plant breaks down with the column. Columns that are asked for together run side by
        side in lanes where the plant can do that (`Predictor.groups`). Runs in lanes round
        differently from runs alone, so that both are cached separately.
        """
        groups = self.predictor.groups([column.values for column in columns])
        alone = {group[0] for group in groups if len(group) == 1}
        at = tuple(values.values())
        keys = [
            (at, tuple(column.values.values()), column.size, number in alone)
            for number, column in enumerate(columns)
        ]
        missing = [[i for i in group if keys[i] not in self._changes] for group in groups]
        bases = self.innovations(values)

        def run(task: tuple[list[int], int]) -> list[Array]:
            group, number = task
            record, gains, base = self.records[number], self.gains[number], bases[number][0]
            values_of = [columns[i].values for i in group]
            if group[0] in alone:
                changed = [self.predictor.innovations(record, gains, values_of[0])[0]]
            else:
                # The base runs in lanes too, because rounding makes a large difference where a ram
                # sticks and slips.
                base, *changed = self.predictor.innovations_of(record, gains, [values, *values_of])
            return [
                _change(each, base, columns[i].size) for i, each in zip(group, changed, strict=True)
            ]

        found: dict[int, Changes] = {}
        tasks = [(group, n) for group in missing if group for n in range(len(self.records))]
        for (group, _), changes in zip(tasks, self.pool.map(run, tasks), strict=True):
            for i, change in zip(group, changes, strict=True):
                found.setdefault(i, []).append(change)
        self._changes |= {keys[i]: changes for i, changes in found.items()}
        return [self._changes[key] for key in keys]

    def linearise(
        self, values: Values, columns: Sequence[Column], kept: Mapping[str, Changes] | None = None
    ) -> Linear:
        """Return the linearisation of the innovations about `values`, along these columns.

        The changes of columns that are in `kept`, by column name, are taken from there and not run.
        """
        kept = kept or {}
        asked = [column for column in columns if column.name not in kept]
        found = dict(kept)
        found |= zip([column.name for column in asked], self.changes(values, asked), strict=True)
        bases = [innovations for innovations, _ in self.innovations(values)]
        changes = [found[column.name] for column in columns]
        return assemble(columns, bases, changes, self.used, self.blocks, self.pool)

    def fit(
        self, values: Values, variables: Sequence[Variable], steps: int = 4,
        tolerance: float = 1e-4, kept: Mapping[str, Changes] | None = None,
        first: Mapping[str, Changes] | None = None,
    ) -> Fitted:  # fmt: skip
        """Return all values with the best ones of the variables, and the costs (blocks,) with them.

        The fit ends after `steps` steps, with a step that lowers the cost by less than the part
        `tolerance` of it, or if not even a tenth of a step lowers it. Variables stay within their
        bounds. Where the model breaks down at the start, the start is returned.

        Args:
            values: values of all parameters at the start.
            variables: parameters to fit.
            steps: greatest number of Gauss-Newton steps.
            tolerance: part of the cost.
            kept: changes by column name that are used in every step and not run again (chord
                method), such as those of nuisances, which can then be fitted along without further
                runs.
            first: changes of all columns by name at the start, if they are known.
        """
        kept = kept or {}
        columns = self.columns(values, variables)
        if first is None:
            innovations, changes = self._ahead(values, columns, kept)
        else:
            # These were run at the start, and so were the innovations there.
            innovations, changes = [each for each, _ in self.innovations(values)], first
        costs = self.costs_of(innovations)
        before = float(costs.sum())
        present = Fitted(dict(values), costs, before)
        if not before < _BREAKDOWN * self.samples:
            return present
        for left in reversed(range(steps)):
            asked = [column for column in columns if column.name not in changes]
            found = {**changes, **self._by_name(present.values, asked)}
            of_columns = [found[column.name] for column in columns]
            linear = assemble(columns, innovations, of_columns, self.used, self.blocks, self.pool)
            step, _ = linear.solve([column.name for column in columns])
            better = None
            for share in _SHARES:
                tried = dict(present.values)
                for variable, change in zip(variables, step, strict=True):
                    tried = variable.moved(tried, share * change)
                columns = self.columns(tried, variables)
                innovations, changes = self._ahead(tried, columns if left else [], kept)
                costs = self.costs_of(innovations)
                if costs.sum() < present.cost:
                    better = Fitted(tried, costs, before)
                    break
            if better is None:
                break
            gained = present.cost - better.cost
            present = better
            if gained < tolerance * present.cost:
                break
        return present

    def _by_name(self, values: Values, columns: Sequence[Column]) -> dict[str, Changes]:
        """Return the changes by columns (`changes`), by the names of these."""
        names = [column.name for column in columns]
        return dict(zip(names, self.changes(values, columns), strict=True)) if names else {}

    def _ahead(
        self, values: Values, columns: Sequence[Column], kept: Mapping[str, Changes]
    ) -> tuple[list[Array], Mapping[str, Changes]]:
        """Return for each record the innovations at `values`, and the changes that are known there.

        The changes are by the columns' names, those in `kept` among them. Whether a step is good is
        known once the innovations after it are; then the changes about the new values are wanted.
        In lanes both take hardly longer than the innovations alone, so the columns that are not in
        `kept` are run together with these if one run holds them all, and are left out if not.
        """
        asked = [column for column in columns if column.name not in kept]
        sets = [values, *(column.values for column in asked)]
        if not 1 < len(sets) <= LANES or not self.predictor.are_alike(sets):
            return [innovations for innovations, _ in self.innovations(values)], kept
        runs = list(
            self.pool.map(
                lambda record, gains: self.predictor.innovations_of(record, gains, sets),
                self.records, self.gains,
            )
        )  # fmt: skip
        found = dict(kept)
        for k, column in enumerate(asked, 1):
            found[column.name] = [_change(run[k], run[0], column.size) for run in runs]
        return [run[0] for run in runs], found
