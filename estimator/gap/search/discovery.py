"""This module discovers disturbances that no catalogue holds, and adds them to the model.

All places where a disturbance may enter, against all quantities that it may depend on, compete in
one figure: by how much they lower the error of predictions that they were not fitted to. The blocks
of the recordings are divided into folds; the coefficients are fitted to all folds but one, together
with the variables of the fit, and judged on that one (cross-validation, Stone 1974). The best is
fitted in the plant itself, and the search goes on with what it leaves.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.gap.plant import SLOTS, TIME_NAME, Addition, Array, Effect, Layout, Plant
from estimator.gap.prediction import (
    Excerpt,
    Filtered,
    Fitted,
    Values,
    Variable,
    excerpts,
    freed,
    started,
)

from .disturbances import Attribution, Place, places_of, varying_of
from .findings import CHANCE, MATERIAL, deviate
from .refits import Refits
from .shapes import Shape, fine_shapes, finer, periodic, symbols, tables
from .twins import Twins

ADDED: Final = "added"
"""Name of the variables of additions."""
MOST: Final = 3
"""Greatest number of disturbances that are discovered."""
SURE: Final = 2.0
"""Least normal deviate of a gain by the blocks' scatter. Chance is kept out by `CHANCE`: a gain in
blocks that nothing was fitted to is below zero on average where there is nothing."""
PART: Final = 0.05
"""Least part of the excess in error that a disturbance must take away."""
OVER_TWIN: Final = 5.0
"""Least gain in multiples of the gain of the same shape on a twin: what the filter's own
imperfection gives it."""
NEAR: Final = 2.0
"""Standard errors of a difference between gains below which two explanations are equal."""
_FOLD: Final = 8
"""Number of half-second blocks in a fold: neighbouring errors are alike for less than that."""
_FOLDS: Final = 4
_LIKELY: Final = 14
"""Number of places and quantities that compete with one that was added."""
_TRIED: Final = 3
"""Greatest number of shapes that are tried in the plant at one stage."""
_TOGETHER: Final = 60
"""Number of columns that are followed through the linearised course at once."""


@dataclass(frozen=True)
class Explanation:
    """A shape of a disturbance of one place, fitted on the linearised course and cross-validated.

    Attributes:
        place: where it enters.
        shape: how it depends on its quantity.
        coefficients: float64 (count,), SI.
        errors: float64 (count,), their standard errors.
        gains: float64 (blocks,), by how much it lowers the cost of blocks it was not fitted to.
        share: part of the excess that the gains are.
    """

    place: Place
    shape: Shape
    coefficients: Array
    errors: Array
    gains: Array
    share: float

    @property
    def gain(self) -> float:
        """Return the gain of all blocks together."""
        return float(self.gains.sum())

    @property
    def z(self) -> float:
        """Return the normal deviate of the gain, by the scatter of the blocks."""
        return deviate(self.gains)

    @property
    def addition(self) -> Addition:
        """Return the disturbance as a model holds it."""
        return self.shape.addition(self.place.name, self.coefficients)

    @property
    def where(self) -> tuple[str, str, str]:
        """Return the names of the place, the quantity and the factor."""
        return self.place.name, self.shape.of, self.shape.times


@dataclass(frozen=True)
class Discovery:
    """A disturbance that was discovered, and is a part of the model.

    Attributes:
        explanation: what it was when it was chosen.
        addition: the disturbance as fitted in the plant.
        errors: standard errors of its values, in their order.
        rivals: explanations that these recordings do not tell from it, at most two.
        share: part of the excess at the beginning that it takes away.
        before: values of all parameters before it was added.
        after: values of all parameters with it.
        reach: least and greatest value of its quantity in the recordings, SI.
    """

    explanation: Explanation
    addition: Addition
    errors: tuple[float, ...]
    rivals: tuple[Explanation, ...]
    share: float
    before: Values
    after: Values
    reach: tuple[float, float]


@dataclass
class DiscoveredModel:
    """A model with what was discovered.

    Attributes:
        fitted: fit with all disturbances.
        filtered: the records, with gains for it.
        variables: variables of that fit.
        discoveries: the disturbances, in the order in which they were found.
        near: explanations of what is left that come nearest, the best first.
        additions: the disturbances as the fit has them, in the same order.
    """

    fitted: Fitted
    filtered: Filtered
    variables: tuple[Variable, ...]
    discoveries: list[Discovery] = field(default_factory=list)
    near: list[Explanation] = field(default_factory=list)
    additions: tuple[Addition, ...] = ()


class Explaining:
    """Explains what a model leaves in some records by disturbances, cross-validated.

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters.
        variables: variables of the fit, which are refitted together with each disturbance.
        floor: cost per reading of a rig that is exactly the model.
        like: another object whose excerpts are used; None to choose the costliest.
        without: an addition that the values hold, which is taken out, so that all others compete
            with it; None if nothing is.
    """

    def __init__(
        self,
        filtered: Filtered,
        values: Values,
        variables: Sequence[Variable],
        floor: float,
        like: "Explaining | None" = None,
        without: Addition | None = None,
    ) -> None:
        self.plant = filtered.predictor.plant
        period = self.plant.period
        self.parts: list[Excerpt] = (
            excerpts(filtered.records, period, filtered.costs(values))
            if like is None
            else like.parts
        )
        self._drifting = varying_of(self.plant)
        self.attribution = Attribution(filtered, values, variables, self.parts, self._drifting)
        self.places = [*places_of(self.plant), *self._drifting]
        names = [*self.plant.regions, TIME_NAME]
        self._along = {name: self.attribution.along(name) for name in names}
        self._together = {name: np.concatenate(parts) for name, parts in self._along.items()}
        if without is not None:
            place = next(each for each in self.places if each.name == without.place)
            self.attribution.take_out(place, [values[:, None] for values in self._values(without)])
        self._base = len(self.attribution.base)
        self._without: Array | None = None
        self._floor = floor
        columns = filtered.columns(values, variables)
        self._bounds = (
            np.array([column.lower for column in columns]),
            np.array([column.upper for column in columns]),
        )

    def explanations(self) -> list[Explanation]:
        """Return all that would explain what is left, by falling gain."""
        found: list[Explanation] = []
        for place in self.places:
            found += self._of_place(place)
        return sorted(found, key=lambda each: -each.gain)

    def _values(self, addition: Addition) -> list[Array]:
        """Return an addition at each sample of each course, a list of (m,)."""
        found = []
        for k, course in enumerate(self.attribution.courses):
            ones = np.ones(len(course.samples))
            value = addition.shape(self._along[addition.of][k] if addition.of else ones)
            found.append(value * (self._along[addition.times][k] if addition.times else ones))
        return found

    def reach(self, of: str) -> tuple[float, float]:
        """Return the 1 % and the 99 % quantile of a quantity, SI; zeros for none."""
        if not of:
            return 0.0, 0.0
        low, high = np.quantile(self._together[of], (0.01, 0.99))
        return float(low), float(high)

    def again(self, explanations: Sequence[Explanation]) -> list[Explanation]:
        """Return explanations of the same shapes, fitted to what is to be explained here."""
        by_place: dict[str, list[Explanation]] = {}
        for each in explanations:
            by_place.setdefault(each.place.name, []).append(each)
        found: list[Explanation] = []
        for members in by_place.values():
            found += self.of(members[0].place, [each.shape for each in members])
        return sorted(found, key=lambda each: -each.gain)

    def _of_place(self, place: Place) -> list[Explanation]:
        turned = place.turned
        shapes = tables(self._together, [*place.of, TIME_NAME], turned)
        found = self.of(place, shapes)
        names = periodic(self.plant.regions, place.of) if place.varying is None else []
        for name in names:
            fine = self.of(place, fine_shapes(name, self._together[name], turned))
            fine.sort(key=lambda each: -each.gain)
            span = float(np.ptp(self._together[name]))
            best = [next((e for e in fine if e.shape.form == f), None) for f in ("wave", "bump")]
            for each in best:
                if each is not None and each.gain > 0.0:
                    found += self.of(place, finer(each.shape, span))
        return found

    def of(self, place: Place, shapes: Sequence[Shape]) -> list[Explanation]:
        """Return an explanation for each shape of a place."""
        found: list[Explanation] = []
        group: list[Shape] = []
        for shape in [*shapes, None]:
            if group and (shape is None or sum(s.count for s in group) >= _TOGETHER):
                found += self._evaluated(place, group)
                group = []
            if shape is not None:
                group.append(shape)
        return found

    def _evaluated(self, place: Place, shapes: Sequence[Shape]) -> list[Explanation]:
        columns = [
            np.concatenate(
                [
                    shape.columns({name: parts[k] for name, parts in self._along.items()})
                    for shape in shapes
                ],
                axis=1,
            )
            for k in range(len(self.attribution.courses))
        ]
        changes, residual, samples = self.attribution.stacked(place, columns)
        base = changes[:, :, : self._base]
        with_base = np.matmul(changes.transpose(0, 2, 1), base)
        slopes = np.matmul(residual[:, None, :], changes)[:, 0]
        if self._without is None:
            inner = range(self._base)
            self._without = _changes_out_of_fold(
                with_base[:, inner], slopes[:, inner], self._bounds, np.zeros((self._base,) * 2)
            )
        excess = float(np.square(residual).sum()) - self._floor * samples
        found, first = [], self._base
        for shape in shapes:
            own = slice(first, first + shape.count)
            first += shape.count
            known = [*range(self._base), *range(own.start, own.stop)]
            products = np.empty((len(changes), len(known), len(known)))
            products[:, :, : self._base] = with_base[:, known]
            products[:, : self._base, self._base :] = with_base[:, own].transpose(0, 2, 1)
            mine = changes[:, :, own]
            products[:, self._base :, self._base :] = np.matmul(mine.transpose(0, 2, 1), mine)
            best: Explanation | None = None
            for rough in shape.roughness():
                each = _crossed(products, slopes[:, known], self._bounds, rough, self._without)
                if each is None:
                    continue
                gains, steps, errors = each
                share = float(gains.sum()) / excess if excess > 0.0 else 0.0
                if best is None or gains.sum() > best.gain:
                    best = Explanation(place, shape, steps, errors, gains, share)
            if best is not None:
                found.append(best)
        return found

    @property
    def samples(self) -> int:
        """Return the number of readings in the excerpts' blocks."""
        none = [np.zeros((len(course.samples), 1)) for course in self.attribution.courses]
        return self.attribution.stacked(self.places[0], none)[2]


def _crossed(
    products: Array, slopes: Array, bounds: tuple[Array, Array], rough: Array, without: Array
) -> tuple[Array, Array, Array] | None:
    """Return the gains of blocks not fitted to, and the coefficients fitted to all of them.

    Args:
        products: float64 (blocks, k, k), products of the columns, the variables first.
        slopes: float64 (blocks, k), products with the innovations.
        bounds: least and greatest steps of the variables, float64 (variables,) each.
        rough: float64 (count, count), penalty for the other columns, as if their mean square were
            one.
        without: float64 (blocks,), changes of the cost of blocks not fitted to by the variables
            alone.

    Returns:
        The gains (blocks,), coefficients (count,) and standard errors; None if the columns do
        nothing.
    """
    base = len(bounds[0])
    blocks, count = slopes.shape
    total = products.sum(0)
    scale = np.sqrt(np.maximum(np.diag(total), 0.0))
    if not (np.isfinite(total).all() and np.isfinite(slopes).all()):
        return None
    if not np.any(scale[base:] > 0.0):
        return None
    scale[base:] = np.maximum(scale[base:], 1e-6 * float(scale[base:].max()))
    scale = np.where(scale > 0.0, scale, 1.0)
    m = products / np.outer(scale, scale)
    s = slopes / scale
    # The penalty is on the coefficients themselves; the columns were scaled one by one.
    own = scale[base:]
    mean = float(np.exp(np.mean(np.log(own))))
    penalty = np.zeros((count, count))
    penalty[base:, base:] = rough * np.outer(mean / own, mean / own)
    lower, upper = (np.asarray(end * scale[:base]) for end in bounds)
    gains = without - _changes_out_of_fold(m, s, (lower, upper), penalty)
    total = m.sum(0) + penalty + 1e-9 * np.eye(count)
    steps = _bounded(total, -s.sum(0), lower, upper)
    inverse = np.linalg.inv(total)
    scores = s + m @ steps
    scatter = scores.T @ scores * blocks / max(blocks - 1, 1)
    errors = np.sqrt(np.maximum(np.diag(inverse @ scatter @ inverse), 0.0))
    return gains, steps[base:] / own, errors[base:] / own


def _changes_out_of_fold(
    products: Array, slopes: Array, bounds: tuple[Array, Array], penalty: Array
) -> Array:
    """Return by how much a fit to all other folds changes the cost of each block, (blocks,)."""
    blocks = len(slopes)
    total, slope = products.sum(0), slopes.sum(0)
    total = total + penalty + 1e-9 * np.diag(np.maximum(np.diag(total), 1e-300))
    folds = _folds(blocks)
    changes = np.empty(blocks)
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        m, s = products[out], slopes[out]
        steps = _bounded(total - m.sum(0), s.sum(0) - slope, *bounds)
        changes[out] = 2.0 * s @ steps + (m @ steps) @ steps
    return changes


def _bounded(matrix: Array, right: Array, lower: Array, upper: Array) -> Array:
    """Return x (k,) with matrix x = right, its first elements held within bounds.

    Elements beyond a bound are put there one after the other, and the others solved for again.
    """
    x = np.zeros(len(right))
    free = np.ones(len(right), dtype=bool)
    for _ in range(len(lower) + 1):
        rest = right[free] - matrix[np.ix_(free, ~free)] @ x[~free]
        x[free] = np.linalg.solve(matrix[np.ix_(free, free)], rest)
        inside = np.clip(x[: len(lower)], lower, upper)
        beyond = free[: len(lower)] & (inside != x[: len(lower)])
        if not beyond.any():
            break
        free[: len(lower)][beyond] = False
        x[: len(lower)][beyond] = inside[beyond]
    return x


def _folds(blocks: int) -> Array:
    """Return the fold of each block (blocks,), from 0: neighbours are in the same fold."""
    size = max(1, min(_FOLD, blocks // _FOLDS))
    return np.asarray(np.minimum(np.arange(blocks) // size, max(blocks // size - 1, 0)))


class Discovering:
    """Discovers disturbances in the records of a fitter, beside what is in a model already.

    Args:
        refits: refits of the records.
        twins: makes twins of the records.

    Attributes:
        plant: plant of the records.
        nuisances: variables of the plant's nuisances.
    """

    def __init__(self, refits: Refits, twins: Twins) -> None:
        self._refits, self._twins = refits, twins
        self.plant: Plant = refits.plant
        self.nuisances = refits.nuisances

    def run(
        self,
        fitted: Fitted,
        variables: tuple[Variable, ...],
        floor: float,
        most: int = MOST,
    ) -> DiscoveredModel:
        """Return the model with all disturbances that earn their place.

        Args:
            fitted: fit of the model that they are added to.
            variables: variables of that fit.
            floor: cost per reading of a rig that is exactly the model.
            most: greatest number of disturbances.
        """
        filtered = self._refits.fitter.filtered(fitted.values)
        present = Fitted(fitted.values, filtered.costs(fitted.values))
        found = DiscoveredModel(present, filtered, variables)
        layout = self.plant.layout
        if layout is None:
            return found
        first = present.cost - floor * filtered.samples
        room = min(most, SLOTS - len(layout.additions(fitted.values)))
        while len(found.discoveries) < room:
            explaining = Explaining(found.filtered, found.fitted.values, found.variables, floor)
            ranked = explaining.explanations()
            found.near = ranked[:8]
            if not self._add(found, explaining, ranked, first):
                break
        if found.discoveries:
            found.fitted, found.filtered = self._refits.settled(
                found.fitted.values, found.variables, rounds=3
            )
            found.filtered = found.filtered.at(found.fitted.values)
            costs = found.filtered.costs(found.fitted.values)
            found.fitted = Fitted(found.fitted.values, costs)
            given = layout.additions(self.plant.nominal)
            every = held_as(layout, found.fitted.values, [*given, *found.additions])
            found.additions = tuple(every[len(given) :])
            found.discoveries = [
                replace(each, addition=addition)
                for each, addition in zip(found.discoveries, found.additions, strict=True)
            ]
        return found

    def with_effect(
        self, values: Values, effect: Effect
    ) -> tuple[Fitted | None, tuple[Variable, ...]]:
        """Return the best fit with an effect of the catalogue and its variables, from its starts.

        The fit is None if the model breaks down. The filter's gains are those of the fit itself.

        Args:
            values: values of all parameters without the effect.
            effect: the effect, which starts from its stated starts or else from these values.
        """
        variables = freed(self.nuisances, effect)
        best: Fitted | None = None
        starts: tuple[Mapping[str, float], ...] = effect.starts or ({},)
        for start in starts:
            began = started(self.plant, values, effect, start)
            ended = self._refits.settled(began, variables, rounds=3)[0].values
            costs = self._refits.fitter.filtered(ended).costs(ended)
            if np.isfinite(costs).all() and (best is None or costs.sum() < best.cost):
                best = Fitted(ended, costs)
        return best, variables

    def _add(
        self,
        found: DiscoveredModel,
        explaining: Explaining,
        ranked: Sequence[Explanation],
        first: float,
    ) -> bool:
        """Add the best explanation that earns its place; return whether there is one.

        Explanations that promise nearly as much as the best compete in the plant itself, where
        they are more than linear.

        Args:
            found: what was discovered so far; changed in place.
            explaining: explains what that leaves.
            ranked: explanations, by falling gain.
            first: excess in cost before anything was discovered.
        """
        layout = self.plant.layout
        assert layout is not None
        bar = max(CHANCE, MATERIAL * explaining.samples)
        earning = [
            each
            for each in ranked
            if each.gain > bar
            and each.z > SURE
            and each.share > PART
            and not layout.why_not(each.addition)
        ]
        if not earning:
            return False
        values = found.fitted.values
        on_twin = Explaining(
            self._twins.of(values, 1)[0], values, found.variables, 0.0, explaining
        )
        for each in _distinct(earning)[:_TRIED]:
            chance = on_twin.of(each.place, [each.shape])
            if chance and each.gain < OVER_TWIN * chance[0].gain:
                continue
            added = self._in_plant(found, each)
            if added is None:
                continue
            added, rivals = self._settled(found, explaining, added, ranked)
            gained = found.fitted.costs - added.fitted.costs
            if gained.sum() < PART * first or deviate(gained) < SURE:
                continue
            share = float(gained.sum()) / first if first > 0.0 else 0.0
            found.discoveries.append(
                Discovery(
                    added.explanation, added.addition, added.errors, rivals, share,
                    found.fitted.values, added.fitted.values,
                    explaining.reach(added.addition.of),
                )
            )  # fmt: skip
            found.fitted, found.filtered = added.fitted, added.filtered
            found.variables, found.additions = added.variables, added.additions
            return True
        return False

    def _settled(
        self,
        found: DiscoveredModel,
        explaining: Explaining,
        added: "_InPlant",
        ranked: Sequence[Explanation],
    ) -> tuple["_InPlant", tuple[Explanation, ...]]:
        """Return the best explanation in the place of one that was added, and its rivals.

        The model was far off before anything was added, so that the linearisation about it tells
        roughly what is missing. About the model with an explanation it tells better whether another
        one explains as much.
        """
        rivals: tuple[Explanation, ...] = ()
        likely = _distinct(ranked)[:_LIKELY]
        for last in (False, False, True):
            own = added.addition
            again = Explaining(
                added.filtered, added.fitted.values, found.variables, 0.0, explaining, own
            )
            of = added.explanation
            simple = []
            if of.shape.form == "table":
                along = np.concatenate(again.attribution.along(of.shape.of))
                simple = symbols(of.shape, along)
            tried = again.again([*likely, of])
            tried += again.of(of.place, simple)
            tried.sort(key=lambda each: -each.gain)
            best = _simplest(tried)
            near = [each for each in tried if not _worse(tried[0], each)]
            rivals = tuple(e for e in _distinct(near) if e.where != best.where)[:2]
            same = best.where == of.where and best.shape.form == of.shape.form
            if last or same:
                break
            other = self._in_plant(found, best, added.fitted.values)
            if other is None or _loses(added, other):
                break
            added = other
        return added, rivals

    def _in_plant(
        self, found: DiscoveredModel, each: Explanation, start: Values | None = None, rounds: int = 3
    ) -> "_InPlant | None":
        """Return the model with an explanation in the plant; None if that does not lower the cost.

        In each of some rounds the filter's gains are computed and all variables fitted with them.
        The fit starts from the values `start`, or else from those without the explanation.
        """
        layout = self.plant.layout
        assert layout is not None
        at = found.fitted
        additions = [*layout.additions(self.plant.nominal), *found.additions, each.addition]
        values = {**(start or at.values), **layout.values(additions)}
        base = tuple(v for v in found.variables if v.name != ADDED)
        given = len(additions) - len(found.additions) - 1
        own = addition_variables(layout, additions, range(given, len(additions)))
        variables = (*base, *own)
        for _ in range(rounds):
            filtered = self._refits.fitter.filtered(values)
            values = filtered.fit(values, variables, 2, 3e-3).values
        filtered = self._refits.fitter.filtered(values)
        fitted = Fitted(values, filtered.costs(values))
        if not fitted.cost < at.cost:
            return None
        columns = filtered.columns(values, variables)
        names = [column.name for column in columns]
        linear = filtered.linearise(values, columns)
        errors = linear.errors(names, linear.solve(names)[0])
        sizes = set(layout.names(additions, len(additions) - 1)[0])
        shown = tuple(
            float(error)
            for variable, error in zip(variables, errors, strict=True)
            if variable.parameter in sizes
        )
        present = held_as(layout, values, additions)
        if not _is_possible(self.plant, values, each.place, present[-1]):
            return None
        return _InPlant(
            each, fitted, filtered, variables, present[-1], shown, tuple(present[given:])
        )


@dataclass(frozen=True)
class _InPlant:
    """A model with one explanation more, fitted in the plant."""

    explanation: Explanation
    fitted: Fitted
    filtered: Filtered
    variables: tuple[Variable, ...]
    addition: Addition
    errors: tuple[float, ...]
    additions: tuple[Addition, ...]


def _loses(one: _InPlant, other: _InPlant) -> bool:
    """Return whether the other predicts worse than the one, beyond chance and one per cent."""
    lost = other.fitted.costs - one.fitted.costs
    error = float(np.sqrt(len(lost)) * np.std(lost, ddof=1))
    return float(lost.sum()) > max(NEAR * error, 0.01 * one.fitted.cost)


def _worse(best: Explanation, other: Explanation) -> bool:
    """Return whether an explanation predicts worse than the best, beyond chance and one per cent."""
    lost = best.gains - other.gains
    error = float(np.sqrt(len(lost)) * np.std(lost, ddof=1))
    return float(lost.sum()) > max(NEAR * error, 0.01 * best.gain)


def _simplest(ranked: Sequence[Explanation]) -> Explanation:
    """Return the simplest explanation at the first one's place that predicts as well as that.

    It depends on the same quantity or on none, and is as good to within chance. The simplest has
    the fewest coefficients.
    """
    best = ranked[0]
    same = [
        e
        for e in ranked
        if e.where[0] == best.where[0] and e.shape.of in ("", best.shape.of) and not _worse(best, e)
    ]
    return min(same, key=lambda each: (each.shape.count, -each.gain))


def _is_possible(plant: Plant, values: Values, place: Place, addition: Addition) -> bool:
    """Return whether a parameter that an addition changes stays above its least value.

    A friction level below zero would be a force that drives the ram.
    """
    if place.varying is None or not addition.values:
        return True
    least = min(addition.values) if addition.form == "table" else 0.0
    lower = {each.name: each.lower for each in plant.parameters}
    return all(values[name] + least >= lower[name] for name in place.varying.parameters)


def addition_variables(
    layout: Layout, additions: Sequence[Addition], which: Iterable[int]
) -> tuple[Variable, ...]:
    """Return the variables with which some of a model's additions are refitted.

    They are all values of a table, and of a form in symbols its size, with the period and phase of
    a wave, the middle and width of a bump, or the beginning of a hinge. Their name is `ADDED`, and
    each key is the name of the parameter.

    Args:
        layout: how models of the plant hold additions.
        additions: all additions of the model.
        which: indices of those that are refitted.
    """
    found: list[Variable] = []
    for index in which:
        each = additions[index]
        sizes, places = layout.names(additions, index)
        largest = max(max(abs(value) for value in each.values), 1e-300)
        steps = [(name, 0.03 * largest, -10.0 * largest, 10.0 * largest) for name in sizes]
        if each.form == "wave":
            pitch, phase = each.at
            steps.append((places[0], 1e-3 * pitch, pitch / 1.3, pitch * 1.3))
            steps.append((places[1], 0.03, phase - 10.0, phase + 10.0))
        elif each.form == "bump":
            middle, width = each.at
            steps.append((places[0], 0.03 * width, middle - 2.0 * width, middle + 2.0 * width))
            steps.append((places[1], 0.03 * width, width / 3.0, width * 3.0))
        found += [
            Variable(ADDED, name, name, probe, lower, upper) for name, probe, lower, upper in steps
        ]
    return tuple(found)


def held_as(
    layout: Layout, values: Values, additions: Sequence[Addition]
) -> list[Addition]:
    """Return a model's additions with the values that it has for them now."""
    found = []
    for index, each in enumerate(additions):
        sizes, places = layout.names(additions, index)
        found.append(
            replace(
                each,
                values=tuple(float(values[name]) for name in sizes),
                at=tuple(float(values[name]) for name in places),
            )
        )
    return found


def _distinct(ranked: Sequence[Explanation]) -> list[Explanation]:
    """Return the first explanation of each place and quantity."""
    seen: dict[tuple[str, str, str], Explanation] = {}
    for each in ranked:
        seen.setdefault(each.where, each)
    return list(seen.values())
