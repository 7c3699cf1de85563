"""This module looks for disturbances that explain what a model leaves of some records' errors.

Each is cross-validated: the blocks of the recordings are divided into folds, and the coefficients
of a disturbance are fitted to all folds but one, together with the variables of the fit, and judged
on that one (Stone 1974).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import DIRECTION, MEMORIES, PHASES, TIME_NAME, Addition, Array
from estimator.gap.prediction import Excerpt, Filtered, Values, Variable, excerpts

from .disturbances import Attribution, Place, places_of, varying_of
from .findings import CHANCE, deviate
from .remembering import memories
from .shapes import RECORDING, STARTS, Shape, fine_shapes, finer, periodic, tables
from .tones import tones
from .waves import promising

_FOLD: Final = 8
"""Number of half-second blocks in a fold: neighbouring errors are alike for less than that."""
_FOLDS: Final = 4
"""Least number of folds. With few blocks, a fold has fewer of them than `_FOLD`."""
_TOGETHER: Final = 60
"""Number of columns from which on they are followed through the linearised course at once."""

ENOUGH: Final = 0.9
"""Part of the excess that a shape must explain for nothing that remembers to be looked for: that
takes as long as all else, and what remembers leaves more to curves than a tenth."""

PART: Final = 0.05
"""Part of the excess in error that a disturbance must take away."""
_HOPELESS: Final = PART / 3.0
"""Part of the excess. What promises less, or gains less before its period, place or time constant
was refined, is not looked at further: it would have to become three times as good to count. A wave
between two periods that are tried loses a fifth at most; a bump, a lag or a resonance about a half
between two widths, time constants or frequencies."""

Wheres = Collection[tuple[str, str]]
"""Names of places, each with the name of a quantity, "" for none."""


@dataclass(frozen=True)
class Explanation:
    """A shape of a disturbance of one place, fitted on the linearised course and cross-validated.

    Attributes:
        place: where it enters.
        shape: how it depends on its quantity.
        coefficients: float64 (count,), SI.
        errors: float64 (count,), their standard errors.
        gains: float64 (blocks,), by how much it lowers the cost of each block, if it is fitted to
            the blocks of other folds alone.
        share: sum of the gains, as a part of the cost above the floor; 0 if there is none above it.
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
        """Return the names of place, quantity and factor, the last two "" if there is none."""
        return self.place.name, self.shape.of, self.shape.times


def _gain(explanation: Explanation) -> float:
    return explanation.gain


class Explaining:
    """Looks for disturbances that explain what a model leaves of some records, cross-validated.

    Only excerpts of the records are looked at.

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters.
        variables: variables of the fit, which are refitted together with each disturbance.
        floor: cost per reading of a rig that is exactly the model.
        like: another object whose excerpts are used; None to choose the costliest.
        without: an addition that the values hold. What it explains is put back into what is to be
            explained, so that other disturbances compete with it. None if there is no such one.
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
        columns = filtered.columns(values, variables)
        self._bounds = (
            np.array([column.lower for column in columns]),
            np.array([column.upper for column in columns]),
        )
        self._leave_out_broken()
        self.places = [*places_of(self.plant), *self._drifting]
        names = [*self.plant.regions, TIME_NAME]
        self._along = {name: self.attribution.along(name) for name in names}
        self._numbers = tuple(sorted(set(self.attribution.numbers)))
        self._together = {name: np.concatenate(parts) for name, parts in self._along.items()}
        if without is not None:
            place = next(each for each in self.places if each.name == without.place)
            self.attribution.take_out(place, [values[:, None] for values in self._values(without)])
        self._without = self._change_by_variables()
        self._tables: dict[Shape, list[Array]] = {}
        self._spectra: dict[Shape, Array] = {}
        self._floor = floor
        self._hopeless: float | None = None

    def _leave_out_broken(self) -> None:
        """Leave out the blocks in which the linearised course does not hold.

        Where a ram is about to stick, small changes may grow without end in the linearised filter,
        and such a block would count for more than all others. So it is where variables that are
        fitted to the other folds alone, a step next to none from where they are, would make a block
        cost more than twice what it costs.
        """
        while True:
            squares, _ = self.attribution.left()
            kept = ~(self._change_by_variables() > squares)
            if kept.all() or kept.sum() < _FOLDS:
                break
            # The worst hides others: the steps of the variables are as small as it needs them.
            self.attribution.keep(kept)

    def _change_by_variables(self) -> Array:
        """Return by how much variables fitted to other folds alone change each block's cost."""
        products, slopes = self.attribution.of_variables()
        return _changes_out_of_fold(products, slopes, self._bounds, np.zeros_like(products[0]))

    def explanations(self, only: Wheres | None = None) -> list[Explanation]:
        """Return an explanation for each shape of each place that is tried, by falling gain.

        A gain may be below 0. Shapes that change nothing are left out. What remembers is tried as
        well (`memories`), unless one of the others explains `ENOUGH` of the excess.

        Args:
            only: places and quantities that are looked at; None for all.
        """
        found: list[Explanation] = []
        places = [
            place
            for place in self.places
            if only is None or place.name in {name for name, _ in only}
        ]
        for place in places:
            found += self._of_place(place)
        if max((each.share for each in found), default=0.0) < ENOUGH:
            for place in places:
                for name in self._remembering(place):
                    found += self.remembered(place, name)
        if only is not None:
            found = [each for each in found if each.where[:2] in only]
        return sorted(found, key=lambda each: -each.gain)

    def _remembering(self, place: Place) -> list[str]:
        """Return names of the quantities that a disturbance of a place may remember.

        In an equation it may be any of the place but the direction. A reading may follow, with
        play, what has its own unit.
        """
        if place.varying is not None:
            return []
        names = [name for name in place.of if name != DIRECTION]
        if place.equation is not None:
            return names
        return [name for name in names if self.plant.regions[name].unit == place.unit]

    def _values(self, addition: Addition) -> list[Array]:
        """Return the disturbance of an addition at each sample, SI: for each course one (m,)."""
        found = []
        for k, course in enumerate(self.attribution.courses):
            if addition.form in MEMORIES:
                held = self.attribution.is_held(addition.of)
                shape = Shape(addition.of, addition.times, addition.form, addition.at, (), held)
                found.append(shape.columns(self._at_course(k)) @ np.array(addition.values))
                continue
            ones = np.ones(len(course.samples))
            x = self._along[addition.of][k] if addition.of else ones
            value = addition.shape(x, self.attribution.numbers[k])
            found.append(value * (self._along[addition.times][k] if addition.times else ones))
        return found

    def reach(self, of: str) -> tuple[float, float]:
        """Return the 1 % and 99 % quantile, SI, of the quantity `of` in the courses; 0s for ""."""
        if not of:
            return 0.0, 0.0
        low, high = np.quantile(self._together[of], (0.01, 0.99))
        return float(low), float(high)

    def again(self, explanations: Sequence[Explanation]) -> list[Explanation]:
        """Return explanations of the same places and shapes, fitted anew, by falling gain.

        They are fitted to what this object has to explain, whatever the given ones were fitted to.
        """
        by_place: dict[str, list[Explanation]] = {}
        for each in explanations:
            by_place.setdefault(each.place.name, []).append(each)
        found: list[Explanation] = []
        for members in by_place.values():
            found += self.of(members[0].place, [each.shape for each in members])
        return sorted(found, key=lambda each: -each.gain)

    def _of_place(self, place: Place) -> list[Explanation]:
        """Return explanations of a place, unsorted, for all kinds of shapes that are tried there.

        There are tables for each quantity. Waves and bumps are tried where a disturbance may repeat
        along a quantity, and not in a parameter. Tones are tried if the recordings are few.
        """
        turned = place.turned and DIRECTION in self._along
        shapes = tables(self._together, [*place.of, TIME_NAME], turned)
        found = self.of(place, shapes)
        names = periodic(self.plant.regions, place.of) if place.varying is None else []
        for name in names:
            every = fine_shapes(name, self._together[name], turned)
            waves = [shape for shape in every if shape.form == "wave"]
            others = [shape for shape in every if shape.form != "wave"]
            some = promising(self.attribution, place, waves, self._along[name], self._least)
            fine = self.of(place, [*some, *others])
            fine.sort(key=lambda each: -each.gain)
            span = float(np.ptp(self._together[name]))
            best = [next((e for e in fine if e.shape.form == f), None) for f in ("wave", "bump")]
            for each in best:
                if each is not None and each.gain > self._least:
                    found += self.of(place, finer(each.shape, span))
        if max(self._numbers) < PHASES:
            times = self._along[TIME_NAME]
            found += self.of(place, tones(self.attribution, place, times, self._least))
        return found

    def remembered(self, place: Place, name: str) -> list[Explanation]:
        """Return explanations of a place by what remembers one quantity, unsorted."""
        along = [self._at_course(k) for k in range(len(self.attribution.courses))]
        shapes = memories(self.attribution, place, name, along, self._least, self._spectra)
        tried = self.of(place, shapes)
        found = list(tried)
        for form in MEMORIES:
            best = max((e for e in tried if e.shape.form == form), key=_gain, default=None)
            if best is not None and best.gain > self._least:
                near = finer(best.shape, 0.0)
                found += self.of(place, [each for each in near if each != best.shape])
        if place.equation is None:
            # A reading that follows with play is behind by no more than what it reads has moved.
            return [each for each in found if 0.0 < each.coefficients[0] <= 1.0]
        return found

    def refined(
        self, place: Place, shapes: Sequence[Shape], tried: Sequence[Explanation]
    ) -> list[Explanation]:
        """Return explanations by variants of those shapes that gained most of their form.

        Args:
            place: place where the disturbance enters.
            shapes: shapes of one quantity; none gives none.
            tried: explanations, those by these shapes at the place among them.
        """
        found: list[Explanation] = []
        for form in dict.fromkeys(shape.form for shape in shapes):
            own = [e for e in tried if e.place.name == place.name and e.shape in shapes]
            best = max((e for e in own if e.shape.form == form), key=_gain, default=None)
            if best is not None:
                span = float(np.ptp(self._together[best.shape.of]))
                near = [each for each in finer(best.shape, span) if each != best.shape]
                found += self.of(place, near)
        return found

    def of(self, place: Place, shapes: Sequence[Shape]) -> list[Explanation]:
        """Return an explanation for each shape of a place; shapes that change nothing are left out.

        The shapes are evaluated in groups with at least `_TOGETHER` columns, but for the last one.
        """
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
        """Return an explanation for each shape of a place; shapes that change nothing are left out.

        What all shapes change is computed at once.
        """
        columns, counts = self._columns(shapes), [shape.count for shape in shapes]
        summed = self.attribution.summed(place, columns, counts)
        squares, samples = self.attribution.left()
        excess = float(squares.sum()) - self._floor * samples
        found = []
        for shape, (products, slopes) in zip(shapes, summed, strict=True):
            best = self._smoothed(place, shape, products, slopes, excess)
            if best is not None:
                found.append(best)
        return found

    def _columns(self, shapes: Sequence[Shape]) -> list[Array]:
        """Return the columns of all shapes at the samples of each course, (m, columns) for each.

        A column is the disturbance with one coefficient of a shape at 1 and all others at 0. The
        columns of the first shape come first. A course (`Course`) is a linearised part of a record.
        """
        every = zip(*(self._columns_of(shape) for shape in shapes), strict=True)
        return [np.concatenate(each, axis=1) for each in every]

    def _columns_of(self, shape: Shape) -> list[Array]:
        """Return the columns of one shape at the samples of each course, (m, count) for each.

        Those of tables are kept, because each place is tried with the same ones.
        """
        found = self._tables.get(shape)
        if found is None:
            courses = range(len(self.attribution.courses))
            found = [shape.columns(self._at_course(k)) for k in courses]
            if shape.form == "table":
                self._tables[shape] = found
        return found

    def _at_course(self, k: int) -> dict[str, Array]:
        """Return all quantities along the course with index `k`, as `Shape.columns` takes them."""
        course, number = self.attribution.courses[k], self.attribution.numbers[k]
        return {
            **{name: parts[k] for name, parts in self._along.items()},
            RECORDING: np.array([number]),
            STARTS: course.starts.astype(np.float64),
        }

    def _smoothed(
        self, place: Place, shape: Shape, products: Array, slopes: Array, excess: float
    ) -> Explanation | None:
        """Return the explanation by a shape with that penalty on roughness which predicts best.

        The result is None if the shape changes nothing.

        Args:
            place: place where the disturbance enters.
            shape: its shape.
            products: float64 (blocks, k, k), as for `_crossed`.
            slopes: float64 (blocks, k), as for `_crossed`.
            excess: cost of the excerpts above the floor.
        """
        best: Explanation | None = None
        for rough in shape.roughness():
            crossed = _crossed(products, slopes, self._bounds, rough, self._without)
            if crossed is None:
                continue
            gains, steps, errors = crossed
            share = float(gains.sum()) / excess if excess > 0.0 else 0.0
            if best is None or gains.sum() > best.gain:
                best = Explanation(place, shape, steps, errors, gains, share)
        return best

    @property
    def _least(self) -> float:
        """Return the gain below which it is hopeless to look at a shape further (`_HOPELESS`)."""
        if self._hopeless is None:
            squares, samples = self.attribution.left()
            excess = float(squares.sum()) - self._floor * samples
            self._hopeless = max(CHANCE, _HOPELESS * excess)
        return self._hopeless

    @property
    def samples(self) -> int:
        """Return the number of readings used in the excerpts' blocks."""
        return self.attribution.left()[1]


def _crossed(
    products: Array, slopes: Array, bounds: tuple[Array, Array], rough: Array, without: Array
) -> tuple[Array, Array, Array] | None:
    """Return what a shape gains in blocks it is not fitted to, and its fit to all blocks.

    Args:
        products: float64 (blocks, k, k), products of the columns, the variables first.
        slopes: float64 (blocks, k), products with the innovations.
        bounds: least and greatest steps of the variables, float64 (variables,) each.
        rough: float64 (count, count), penalty for the other columns, as if their mean square were
            one.
        without: float64 (blocks,), changes of the cost of blocks not fitted to by the variables
            alone.

    Returns:
        The gains (blocks,) beyond those of the variables alone, and the coefficients (count,) of
        the other columns with their standard errors (count,). None if these columns change nothing,
        or if a sum is not finite.
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
    """Return by how much a fit to all other folds changes the cost of each block, (blocks,).

    The arguments are as in `_crossed`, with `penalty` (k, k) for all columns.
    """
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

    `lower` and `upper` have one bound for each of these first elements. Elements beyond a bound are
    put there, and the others are solved for again.
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
    """Return the number of the fold of each block, from 0, (blocks,).

    A fold consists of `_FOLD` consecutive blocks, or of fewer if there would not be `_FOLDS` folds.
    Blocks that are left over belong to the last fold.
    """
    size = max(1, min(_FOLD, blocks // _FOLDS))
    return np.asarray(np.minimum(np.arange(blocks) // size, max(blocks // size - 1, 0)))
