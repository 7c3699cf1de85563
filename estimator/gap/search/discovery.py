"""This module discovers disturbances that no catalogue holds, and adds them to the model.

All places where a disturbance may enter, against all quantities that it may depend on, compete in
one figure: by how much they lower the error of predictions that they were not fitted to
(`explaining`). The best is fitted in the plant itself, and the search goes on with what it leaves.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.gap.plant import SLOTS, Addition, Array, Effect, Layout, Plant
from estimator.gap.prediction import Changes, Filtered, Fitted, Values, Variable, freed, started

from .disturbances import Place
from .explaining import Explaining, Explanation, Wheres
from .findings import CHANCE, MATERIAL, deviate
from .refits import Refits, changes_by_name
from .screening import starts_of
from .shapes import symbols
from .standing_in import ADDED, stood_in_for
from .twins import Twins

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
_LIKELY: Final = 14
"""Number of places and quantities that compete with one that was added."""
_TURNS: Final = 3
"""Greatest number of times that others compete with what was added."""
_FAR: Final = 4.0
"""Cost per reading above which a model is far off."""
_TRIED: Final = 3
"""Greatest number of shapes that are tried in the plant at one stage."""


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
        reach: 1 % and 99 % quantile of its quantity in the recordings, SI; zeros for none.
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
        additions: the disturbances as the fit has them, in the same order.
    """

    fitted: Fitted
    filtered: Filtered
    variables: tuple[Variable, ...]
    discoveries: list[Discovery] = field(default_factory=list)
    additions: tuple[Addition, ...] = ()


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
        only: Wheres | None = None,
    ) -> DiscoveredModel:
        """Return the model with all disturbances that earn their place.

        Args:
            fitted: fit of the model that they are added to.
            variables: variables of that fit.
            floor: cost per reading of a rig that is exactly the model.
            most: greatest number of disturbances.
            only: places and quantities that are looked at; None for all.
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
            left = found.fitted.cost - floor * found.filtered.samples
            if found.discoveries and left < MATERIAL * found.filtered.samples:
                break
            explaining = Explaining(found.filtered, found.fitted.values, found.variables, floor)
            if not self._add(found, explaining, explaining.explanations(only), first, only):
                break
        return self.settled(found) if found.discoveries else found

    def settled(self, model: DiscoveredModel) -> DiscoveredModel:
        """Return a model with all its variables fitted, and with the filter's gains for them.

        The fit starts from the model's values.
        """
        layout = self.plant.layout
        assert layout is not None
        fitted, filtered = self._refits.settled(model.fitted.values, model.variables, rounds=3)
        filtered = filtered.at(fitted.values)
        given = layout.additions(self.plant.nominal)
        every = refitted(layout, fitted.values, [*given, *model.additions])
        additions = tuple(every[len(given) :])
        discoveries = [
            replace(each, addition=addition)
            for each, addition in zip(model.discoveries, additions, strict=True)
        ]
        costs = filtered.costs(fitted.values)
        return DiscoveredModel(
            Fitted(fitted.values, costs), filtered, model.variables, discoveries, additions
        )

    def with_effect(
        self, values: Values, effect: Effect
    ) -> tuple[Fitted | None, tuple[Variable, ...]]:
        """Return the best fit with an effect of the catalogue and its variables, from its starts.

        The fit is None if the model breaks down. The filter's gains are those of the fit itself.

        Args:
            values: values of all parameters without the effect.
            effect: the effect, which starts from its stated starts and those that the records
                propose, or else from these values.
        """
        variables = freed(self.nuisances, effect)
        best: Fitted | None = None
        starts = starts_of(self._refits.fitter.filtered(values), values, effect)
        for start in starts or ({},):
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
        only: Wheres | None,
    ) -> bool:
        """Add the best explanation that earns its place; return whether there is one.

        Explanations that promise nearly as much as the best compete in the plant itself, where
        they are more than linear.

        Args:
            found: what was discovered so far; changed in place.
            explaining: explains what that leaves.
            ranked: explanations, by falling gain.
            first: excess in cost before anything was discovered.
            only: places and quantities that are looked at; None for all.
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
        on_twin = Explaining(self._twins.of(values, 1)[0], values, found.variables, 0.0, explaining)
        for each in _distinct(earning)[:_TRIED]:
            chance = on_twin.of(each.place, [each.shape])
            if chance and each.gain < OVER_TWIN * chance[0].gain:
                continue
            added = self._in_plant(found, each)
            if added is None:
                continue
            added, rivals = self._settled(found, explaining, added, ranked, only)
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
        only: Wheres | None,
    ) -> tuple["_InPlant", tuple[Explanation, ...]]:
        """Return the best explanation in the place of one that was added, and its rivals.

        The model was far off before anything was added, so that the linearisation about it tells
        roughly what is missing. About the model with an explanation it tells better whether another
        one explains as much.
        """
        rivals: tuple[Explanation, ...] = ()
        likely = _distinct(ranked)[:_LIKELY]
        # About a model that was far off, even what promised nothing may be right.
        afresh = found.fitted.cost > _FAR * explaining.samples
        for turn in range(_TURNS):
            last = turn == _TURNS - 1
            own = added.addition
            again = Explaining(
                added.filtered, added.fitted.values, found.variables, 0.0, explaining, own
            )
            chosen = added.explanation
            simple = []
            if chosen.shape.form == "table":
                along = np.concatenate(again.attribution.along(chosen.shape.of))
                simple = symbols(chosen.shape, along)
            tried = again.explanations(only) if afresh else again.again(likely)
            tried += again.of(chosen.place, [chosen.shape, *simple])
            tried.sort(key=lambda each: -each.gain)
            best = _simplest(tried)
            near = [each for each in tried if not _worse(tried[0], each)]
            rivals = tuple(e for e in _distinct(near) if e.where != chosen.where)[:2]
            same = best.where == chosen.where and best.shape.form == chosen.shape.form
            if last or same:
                break
            other = self._in_plant(found, best, added.fitted.values)
            if other is None or _loses(added, other):
                break
            added = other
        return added, rivals

    def _in_plant(
        self,
        found: DiscoveredModel,
        each: Explanation,
        start: Values | None = None,
        rounds: int = 3,
    ) -> "_InPlant | None":
        """Return the model with an explanation in the plant; None if that does not lower the cost.

        In each of some rounds the filter's gains are computed and all variables fitted with them.
        The fit starts from the values `start`, or else from those without the explanation. What
        the disturbance may stand in for (`stood_in_for`) keeps its value without it: the
        disturbance is what that leaves.
        """
        layout = self.plant.layout
        assert layout is not None
        at = found.fitted
        additions = [*layout.additions(self.plant.nominal), *found.additions, each.addition]
        values = {**(start or at.values), **layout.values(additions)}
        base = found.variables
        given = len(additions) - len(found.additions) - 1
        own = addition_variables(layout, additions, [len(additions) - 1])
        fitted, filtered, kept = self._rounds(values, (*base, *own), rounds)
        if not fitted.cost < at.cost:
            return None
        vague = stood_in_for(each, self.plant, filtered, fitted.values, base, own)
        if vague:
            base = tuple(v.held(at.values) if v in vague else v for v in base)
            values = {**values, **{v.parameter: at.values[v.parameter] for v in vague}}
            fitted, filtered, _ = self._rounds(values, (*base, *own), rounds, kept)
            if not fitted.cost < at.cost:
                return None
        variables, values = (*base, *own), fitted.values
        columns = filtered.columns(values, variables)
        linear = filtered.linearise(values, columns)
        free = [c.name for c, v in zip(columns, variables, strict=True) if not v.is_held]
        of_free = dict(zip(free, linear.errors(free, linear.solve(free)[0]), strict=True))
        errors = [of_free.get(column.name, 0.0) for column in columns]
        sizes = set(layout.names(additions, len(additions) - 1)[0])
        shown = tuple(
            float(error)
            for variable, error in zip(variables, errors, strict=True)
            if variable.parameter in sizes
        )
        present = refitted(layout, values, additions)
        if not _is_possible(self.plant, values, each.place, present[-1]):
            return None
        return _InPlant(
            each, fitted, filtered, variables, present[-1], shown, tuple(present[given:])
        )

    def _rounds(
        self,
        values: Values,
        variables: tuple[Variable, ...],
        rounds: int,
        kept: Mapping[str, Changes] | None = None,
    ) -> tuple[Fitted, Filtered, Mapping[str, Changes]]:
        """Return a fit after some rounds of computing gains and fitting, and the records with it.

        The gains are those of the fit's own values. The changes by the variables are computed at
        the start and after the first step, and kept from then on (chord method): a table has a
        column for each knot, and to run the plant for each takes most of the time.

        Args:
            values: values of all parameters at the start.
            variables: parameters to fit.
            rounds: number of rounds.
            kept: changes by column name that are used from the start; None to compute them.

        Returns:
            The fit, the records with its gains, and the changes that were kept.
        """
        for _ in range(rounds):
            filtered = self._refits.fitter.filtered(values)
            if kept is None:
                values = filtered.fit(values, variables, 1, 3e-3).values
                kept = changes_by_name(filtered, values, variables)
            values = filtered.fit(values, variables, 2, 3e-3, kept).values
        filtered = self._refits.fitter.filtered(values)
        return Fitted(dict(values), filtered.costs(values)), filtered, kept or {}


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
    """Return whether the other costs more than the one, beyond chance and one per cent."""
    return _matters(other.fitted.costs - one.fitted.costs, one.fitted.cost)


def _worse(best: Explanation, other: Explanation) -> bool:
    """Return whether the other gains less than the best, beyond chance and one per cent."""
    return _matters(best.gains - other.gains, best.gain)


def _matters(lost: Array, whole: float) -> bool:
    """Return whether a loss (blocks,) is more than chance and more than one per cent of a whole."""
    error = float(np.sqrt(len(lost)) * np.std(lost, ddof=1))
    return float(lost.sum()) > max(NEAR * error, 0.01 * whole)


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
    """Return whether a table leaves the parameter that it changes above its least value.

    A friction level below zero would be a force that drives the ram. Other places have no least
    value, and forms in symbols are not looked at.
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
    a wave or the middle and width of a bump. Knots of a table and the place of a hinge stay. Their
    name is `ADDED`, and each key is the name of the parameter.

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
            Variable(name, name, probe, lower, upper, name=ADDED)
            for name, probe, lower, upper in steps
        ]
    return tuple(found)


def refitted(layout: Layout, values: Values, additions: Sequence[Addition]) -> list[Addition]:
    """Return a model's additions as a fit with these values of all parameters has them.

    They keep their order, which that of `Layout.additions` need not be.
    """
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
