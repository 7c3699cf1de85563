"""This module finds where model and recordings disagree, as disturbances that would explain it.

A disturbance is a sum of hat functions of a region's quantity (velocity, spool opening, time, ...).
It is added to an equation or to a reading, sample by sample along the filtered course. How it
changes the innovations follows from the linearised course (`sensitivities`), so that all pairs of
equation and region together take as long as a few runs of the plant. Disturbances are fitted
together with the variables of the fit, with the same blocks and error bars as any column.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import DIRECTION, TIME_NAME, Array, Equation, Plant, Region, Varying
from estimator.gap.prediction import (
    BlockSums,
    Column,
    Course,
    Curve,
    Excerpt,
    Filtered,
    Linear,
    Values,
    Variable,
    course_of,
    excerpts,
    weights_of,
)

from .shapes import hats

HATS: Final = 9
"""Number of hat functions in a curve. The outermost ones are constant beyond their middles."""
TIME: Final = Region(TIME_NAME, "s", lambda states, inputs: states[:, 0], ("s", 1.0), "t")
"""Time since the beginning of a recording. Any plant has this region. Its `value` must not be
called, because no state holds the time; `Attribution.along` has it."""


@dataclass(frozen=True)
class Place:
    """A place where a disturbance enters: an equation, a reading or a parameter.

    Attributes:
        name: name of the equation, or "reading of" and the channel, or of the parameter.
        unit: SI unit of the disturbance.
        shown: unit used in reports, and the number of such units in one SI unit.
        rows: indices of the states that are kicked; for a reading, the number of states plus the
            index of its output; for a parameter all of both.
        of: names of the regions that the disturbance may depend on, besides time.
        equation: the equation; None for a reading and for a parameter.
        varying: the parameter; None for the others.
    """

    name: str
    unit: str
    shown: tuple[str, float]
    rows: tuple[int, ...]
    of: tuple[str, ...]
    equation: Equation | None = None
    varying: Varying | None = None

    @property
    def turned(self) -> bool:
        """Return whether what enters here may change its sign with the direction of motion.

        A reading may, as play does, and an equation that lists the direction among its regions. A
        parameter may not.
        """
        return self.varying is None and (self.equation is None or DIRECTION in self.of)

    def rates(self, states: Array, values: Values) -> Array:
        """Return the kicks (n, rows) by one unit of disturbance, SI; 1 for a reading.

        The place must not be a parameter.

        Args:
            states: float64 (n, states), at which the kicks are taken.
            values: values of all parameters.
        """
        if self.equation is None:
            return np.ones((len(states), 1))
        of = (self.equation.rate, *(rate for _, rate in self.equation.also))
        return np.stack([rate(states, values) for rate in of], axis=1)


def places_of(plant: Plant) -> list[Place]:
    """Return the equations of a plant, then its readings, as places for disturbances.

    Parameters are places, too: `varying_of` has them.
    """
    found = [
        Place(e.name, e.unit, e.shown, (e.state, *(state for state, _ in e.also)), e.of, e)
        for e in plant.equations
    ]
    for index, output in enumerate(plant.outputs):
        found.append(
            Place(
                f"reading of {output.channel}", output.unit, output.shown or (output.unit, 1.0),
                (len(plant.states) + index,), output.of,
            )
        )  # fmt: skip
    return found


def varying_of(plant: Plant) -> list[Place]:
    """Return the parameters of a plant that may change with a quantity, as places."""
    rows = tuple(range(len(plant.states) + len(plant.outputs)))
    return [
        Place(each.name, each.unit, each.shown, rows, each.of, None, each) for each in plant.varying
    ]


class Attribution:
    """Finds the disturbances of a plant's equations and readings that explain what a fit leaves.

    It works on courses (`Course`), which are linearised parts of records.

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters.
        variables: variables that were fitted; a disturbance must explain what these cannot.
        parts: part of each record that is used (`excerpts`); a record without blocks in its part is
            left out.
        drifting: places of parameters that disturbances may enter.

    Attributes:
        plant: plant that the records belong to.
        values: values of all parameters, as given.
        courses: course of each record that is not left out.
        numbers: number of the recording that each of these courses belongs to.
    """

    def __init__(
        self, filtered: Filtered, values: Values, variables: Sequence[Variable],
        parts: Sequence[Excerpt], drifting: Sequence[Place] = (),
    ) -> None:  # fmt: skip
        self.plant = filtered.predictor.plant
        self.values = values
        self._period = self.plant.period
        self._base = filtered.columns(values, variables)
        whole = zip(filtered.records, filtered.gains, parts, strict=True)
        kept = [(record, gains, part) for record, gains, part in whole if part.blocks]
        self._blocks = [part.blocks for *_, part in kept]
        self._first = [record.first for record, *_ in kept]
        self.numbers = [record.number for record, *_ in kept]
        probes = [column.values for column in self._base]
        self._drifting: dict[str, int] = {}
        for place in drifting:
            if place.varying is not None:
                self._drifting[place.name] = len(probes)
                probe = place.varying.probe
                moved = {name: values[name] + probe for name in place.varying.parameters}
                probes.append({**values, **moved})
        self.courses: list[Course] = list(
            filtered.pool.map(
                lambda each: course_of(
                    filtered.predictor, each[0], each[1], values, probes, each[2].samples
                ),
                kept,
            )
        )
        self._pool = filtered.pool
        rows = range(len(self.plant.states) + len(self.plant.outputs))
        sizes = np.array([column.size for column in self._base])
        self._known = [
            course.answers(rows, course.shifts[:, :, : len(sizes)] / sizes)
            for course in self.courses
        ]
        self._sums: list[BlockSums] | None = None
        self._pulls: list[Array] | None = None
        self._base_pulls: tuple[list[Array], Array] | None = None

    def region(self, name: str) -> Region:
        """Return the region with this name, either of the plant or the time."""
        return TIME if name == TIME.name else self.plant.regions[name]

    def along(self, name: str) -> list[Array]:
        """Return the quantity that a region is named after, at each sample of each course, SI.

        Such a quantity is velocity or time, say. The list has one array (m,) for each of `courses`;
        time counts from the beginning of the recording.
        """
        if name == TIME.name:
            return [
                np.asarray((first + course.samples) * self._period, np.float64)
                for first, course in zip(self._first, self.courses, strict=True)
            ]
        region = self.plant.regions[name]
        return [region.value(course.states, course.inputs) for course in self.courses]

    def is_held(self, name: str) -> bool:
        """Return whether the quantity of a region depends on inputs alone, which stay in a sample.

        The time does not.
        """
        if name == TIME.name:
            return False
        course, value = self.courses[0], self.plant.regions[name].value
        rest = np.zeros_like(course.states)
        return bool(np.array_equal(value(course.states, course.inputs), value(rest, course.inputs)))

    def middles(self, name: str, count: int = HATS) -> Array:
        """Return the middles (count,) of the hats along a region's quantity, SI.

        They are evenly spread from its 1 % quantile to its 99 % quantile. A quantity that is always
        at one of these ends or 0, such as the direction, has only the two ends as middles. The
        result is empty if both quantiles are equal.
        """
        values = np.concatenate(self.along(name))
        low, high = np.quantile(values, (0.01, 0.99))
        if not high > low:
            return np.empty(0)
        if np.all((values == low) | (values == high) | (values == 0.0)):
            return np.array([low, high])
        return np.linspace(low, high, count)

    def linears(self, place: Place, shapes: Sequence[Array], counts: Sequence[int]) -> list[Linear]:
        """Return the block sums of the fit's variables and of groups of shapes at a place.

        There is one result for each group. Its columns are those of the variables, then the shapes
        ("#0", "#1", ...), without bounds. Its `quartics` are 0.

        Args:
            place: place where a disturbance enters.
            shapes: for each course, float64 (m, columns), SI: the shapes of all groups.
            counts: number of columns of each group, in their order.
        """
        squares, used = self.left()
        found = []
        for count, (products, slopes) in zip(
            counts, self.summed(place, shapes, counts), strict=True
        ):
            columns = [*self._base, *(Column(f"#{k}", self.values, 1.0) for k in range(count))]
            quartics = np.zeros(len(columns))
            found.append(Linear(columns, products, slopes, squares, quartics, used))
        return found

    def left(self) -> tuple[Array, int]:
        """Return the weighted squares of each block's innovations, and the number of readings."""
        sums = self._block_sums()
        return np.concatenate([each.squares for each in sums]), sum(each.used for each in sums)

    def of_variables(self) -> tuple[Array, Array]:
        """Return the block sums of the fit's variables alone, as `summed` does."""
        sums = self._block_sums()
        products, slopes = ([getattr(e, name) for e in sums] for name in ("products", "slopes"))
        return np.concatenate(products), np.concatenate(slopes)

    def keep(self, kept: Iterable[bool]) -> None:
        """Leave out blocks, and courses without any; `kept` says of each block whether it stays."""
        said = iter(kept)
        blocks = [tuple(block for block in own if next(said)) for own in self._blocks]
        some = [k for k, own in enumerate(blocks) if own]
        self._blocks = [blocks[k] for k in some]
        self.courses = [self.courses[k] for k in some]
        self.numbers = [self.numbers[k] for k in some]
        self._first = [self._first[k] for k in some]
        self._known = [self._known[k] for k in some]
        self._sums = self._pulls = self._base_pulls = None

    def summed(
        self, place: Place, shapes: Sequence[Array], counts: Sequence[int]
    ) -> list[tuple[Array, Array]]:
        """Return the sums over all blocks (`BlockSums.summed`) for groups of shapes at a place.

        Args:
            place: place where a disturbance enters.
            shapes: for each course, float64 (m, columns), SI: the shapes of all groups.
            counts: number of columns of each group, in their order.
        """

        def run(sums: BlockSums, course: Course, each: Array) -> list[tuple[Array, Array]]:
            return sums.summed(place.rows, self._rates(place, course), each, counts)

        parts = list(self._pool.map(run, self._block_sums(), self.courses, shapes))
        return [
            (np.concatenate([p[g][0] for p in parts]), np.concatenate([p[g][1] for p in parts]))
            for g in range(len(counts))
        ]

    def in_blocks(self, place: Place, shapes: Sequence[Array]) -> Array:
        """Return what shapes of a disturbance change in the weighted innovations of each block.

        The result is (blocks, samples, outputs, columns).

        Args:
            place: place where the disturbance enters.
            shapes: for each course, float64 (m, columns), SI.
        """
        parts = zip(self._block_sums(), self.courses, shapes, strict=True)
        return np.concatenate(
            [sums.in_blocks(place.rows, self._rates(place, c), each) for sums, c, each in parts]
        )

    def _block_sums(self) -> list[BlockSums]:
        if self._sums is None:
            parts = zip(self.courses, self._known, self._blocks, strict=True)
            self._sums = [BlockSums(*each) for each in parts]
        return self._sums

    def pull(self, place: Place) -> list[Array]:
        """Return the slope of half the cost by a unit of disturbance at each sample of each course.

        The slopes, (m,) each, are those of what the fit's variables leave.
        """
        if self._pulls is None:
            self._pulls = self._pulled()
        return [
            (pulls[:, list(place.rows)] * self._rates(place, course)).sum(1)
            for pulls, course in zip(self._pulls, self.courses, strict=True)
        ]

    def base_pulls(self, place: Place) -> tuple[list[Array], Array]:
        """Return what tells by how much the fit's variables could stand in for a disturbance.

        Returns:
            For each course float64 (m, variables): the products of what each variable changes in
            the innovations with what a unit of disturbance at each sample changes there; and the
            products of the variables with each other, (variables, variables).
        """
        if self._base_pulls is None:
            weights = self._counted()
            by_course = []
            for course, known, w in zip(self.courses, self._known, weights, strict=True):
                each = [course.pulls(w * known[:, :, k]) for k in range(known.shape[2])]
                by_course.append(np.stack(each, axis=2) if each else np.empty((0, 0, 0)))
            self._base_pulls = by_course, self._gram(weights)
        by_course, gram = self._base_pulls
        rows = list(place.rows)
        found = [
            np.einsum("trk,tr->tk", pulls[:, rows], self._rates(place, course))
            for pulls, course in zip(by_course, self.courses, strict=True)
            if len(self._base)
        ]
        return found, gram

    def _counted(self) -> list[Array]:
        """Return the weights (m, outputs) of the innovations of each course; 0 outside blocks."""
        found = []
        for course, blocks in zip(self.courses, self._blocks, strict=True):
            weights = np.zeros_like(course.innovations)
            for block in blocks:
                weights[block] = weights_of(course)[block]
            found.append(weights)
        return found

    def _gram(self, weights: Sequence[Array]) -> Array:
        """Return the weighted products of the fit's variables, (variables, variables)."""
        parts = zip(self._known, weights, strict=True)
        return np.asarray(sum(np.einsum("tia,ti,tib->ab", known, w, known) for known, w in parts))

    def _pulled(self) -> list[Array]:
        """Return the slopes of half the cost by each kick at each sample, (m, rows) per course.

        The columns are those of `Course.pulls`. The fit's variables take their best values first.
        """
        counted = self._counted()
        parts = list(zip(self.courses, self._known, counted, strict=True))
        slope = sum(np.einsum("tia,ti->a", known, w * c.innovations) for c, known, w in parts)
        steps = slope
        if len(self._base):
            steps = np.linalg.lstsq(self._gram(counted), -slope, rcond=1e-12)[0]
        return [c.pulls(w * (c.innovations + known @ steps)) for c, known, w in parts]

    def take_out(self, place: Place, shapes: Sequence[Array]) -> None:
        """Change the innovations to those of the model without a disturbance, to first order.

        The innovations of `courses` are replaced, so that they hold again what the disturbance
        explains. `shapes` has an array (m, 1) for each course: the disturbance, SI.
        """
        self._pulls = self._sums = None
        for index, course in enumerate(self.courses):
            rates = self._rates(place, course)[:, :, None]
            held = course.answers(place.rows, rates, shapes[index])[:, :, 0]
            self.courses[index] = replace(course, innovations=course.innovations - held)

    def _rates(self, place: Place, course: Course) -> Array:
        """Return the kicks (m, rows) of a course by one unit of disturbance at a place, SI."""
        if place.varying is None:
            return place.rates(course.states, self.values)
        return np.asarray(course.shifts[:, :, self._drifting[place.name]] / place.varying.probe)

    @property
    def base(self) -> list[str]:
        """Return the names of the columns of the fit's variables."""
        return [column.name for column in self._base]

    def solved(self, linear: Linear) -> tuple[Array, Array, float, float]:
        """Return a disturbance's coefficients, standard errors and gain, and the cost without it.

        Args:
            linear: a result of the method `linears`.

        Returns:
            Coefficients (columns,) and standard errors (columns,), SI, of the shapes; by how much
            they lower the cost in addition to the fit's variables; and the cost that the variables
            alone leave.
        """
        base = self.base
        added = [column.name for column in linear.columns[len(base) :]]
        without = linear.solve(base)[1] if base else 0.0
        steps, gain = linear.solve([*base, *added])
        errors = linear.errors([*base, *added], steps)
        cost = float(linear.squares.sum()) - without
        return steps[len(base) :], errors[len(base) :], gain - without, cost

    def curve(self, place: Place, name: str, floor: float, count: int = HATS) -> Curve | None:
        """Return a place's disturbance as a curve against a region's quantity.

        The result is None if that quantity hardly changes (`middles`).

        Where the motion never came, the curve's values are 0 and its errors infinite.

        Args:
            place: place where the disturbance enters.
            name: name of the region.
            floor: cost per reading of a rig that is exactly the model.
            count: number of hats (`middles`).
        """
        found = self._curves_of(place, [name], floor, count)
        return found[0] if found else None

    def _curves_of(
        self, place: Place, names: Sequence[str], floor: float, count: int = HATS
    ) -> list[Curve]:
        """Return a place's disturbance as a curve against each of some regions' quantities.

        The arguments are those of `curve`, and the result leaves out what it returns None for. The
        hats of all regions are followed through the courses at once.
        """
        middles = {name: self.middles(name, count) for name in dict.fromkeys(names)}
        told = [name for name, of_name in middles.items() if of_name.size]
        if not told:
            return []
        along = [[hats(values, middles[name]) for values in self.along(name)] for name in told]
        shapes = [np.concatenate(each, axis=1) for each in zip(*along, strict=True)]
        found = []
        linears = self.linears(place, shapes, [middles[name].size for name in told])
        for name, linear in zip(told, linears, strict=True):
            steps, errors, gain, cost = self.solved(linear)
            excess = cost - floor * linear.samples
            # Where the motion never came in blocks that count, nothing is known.
            known = np.diag(linear.products.sum(0))[len(self._base) :] > 0.0
            steps, errors = np.where(known, steps, 0.0), np.where(known, errors, np.inf)
            region = self.region(name)
            found.append(
                Curve(
                    place.name, region.name, middles[name], steps, errors, place.unit, region.unit,
                    place.shown, region.shown, gain, gain / excess if excess > 0.0 else 0.0,
                )
            )  # fmt: skip
        return found

    def curves(self, floor: float) -> list[Curve]:
        """Return the disturbance of each equation and reading against each region, by falling gain.

        Only regions are taken that the place may depend on, and time. Those that do not change are
        left out. `floor` is the cost per reading of a rig that is exactly the model.
        """
        found = [
            curve
            for place in places_of(self.plant)
            for curve in self._curves_of(place, (*place.of, TIME.name), floor)
        ]
        return sorted(found, key=lambda curve: -curve.gain)


def attribution(
    filtered: Filtered,
    values: Values,
    variables: Sequence[Variable],
    drifting: Sequence[Place] = (),
) -> Attribution:
    """Return the `Attribution` of those stretches of the records that cost most with `values`.

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters.
        variables: variables that were fitted.
        drifting: places of parameters that disturbances may enter.
    """
    parts = excerpts(filtered.records, filtered.predictor.plant.period, filtered.costs(values))
    return Attribution(filtered, values, variables, parts, drifting)
