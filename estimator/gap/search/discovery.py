"""This module discovers disturbances that no catalogue holds, and adds them to the model.

All places where a disturbance may enter, against all quantities that it may depend on, compete in
one figure: by how much they lower the error of predictions that they were not fitted to
(`explaining`). The best is fitted in the plant itself, and the search goes on with what it leaves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.gap.plant import MEMORIES, SLOTS, Addition, Array, Effect, Plant
from estimator.gap.prediction import Changes, Filtered, Fitted, Values, Variable, freed, started

from .added_variables import addition_variables, errors_of, is_possible, refitted, renamed
from .explaining import ENOUGH, PART, Explaining, Explanation, Wheres
from .findings import CHANCE, MATERIAL, deviate
from .refits import Refits
from .screening import starts_of
from .shapes import CORNERS, corners, symbols
from .standing_in import stood_in_for
from .twins import Twins

MOST: Final = 3
"""Greatest number of disturbances that are discovered."""
SURE: Final = 2.0
"""Least normal deviate of a gain by the blocks' scatter. Chance is kept out by `CHANCE`: a gain in
blocks that nothing was fitted to is below zero on average where there is nothing."""
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
_CLOSE: Final = 0.7
"""Part of the best gain above which explanations are fitted in the plant to be compared, if the
model is far off or none of them explains nearly all (`ENOUGH`)."""
_AT_ONCE: Final = 6
"""Greatest number of explanations that are compared so."""
_NEAR_FREQUENCY: Final = 0.1
"""Part by which frequencies or time constants may differ that a fit reaches from one another."""
_NEAR_CORNER: Final = 0.05
"""Part by which the place of a corner may differ from the one that was fitted: the nearest that is
tried beside it is a tenth away."""
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
        begun: DiscoveredModel | None = None,
    ) -> DiscoveredModel:
        """Return the model with all disturbances that earn their place, fitted together.

        There are no more of them than the model has free slots, and none if the plant's models hold
        no additions. If none is new, the model is returned as it was.

        Args:
            fitted: fit of the model that they are added to.
            variables: variables of that fit.
            floor: cost per reading of a rig that is exactly the model.
            most: greatest number of disturbances, with those of `begun`.
            only: places and quantities that are looked at; None for all.
            begun: model with what was discovered already, with which the search goes on; None for
                none.
        """
        filtered = self.filtered(fitted.values)
        present = Fitted(fitted.values, filtered.costs(fitted.values))
        found = DiscoveredModel(present, filtered, variables)
        if begun is not None:
            found = replace(begun, discoveries=list(begun.discoveries))
        layout = self.plant.layout
        if layout is None:
            return found
        first = present.cost - floor * filtered.samples
        room = min(most, SLOTS - len(layout.additions(fitted.values)))
        while len(found.discoveries) < room:
            left = found.fitted.cost - floor * found.filtered.samples
            # Where less is left than another must take away, none could earn its place.
            if found.discoveries and left < max(MATERIAL * found.filtered.samples, PART * first):
                break
            explaining = Explaining(found.filtered, found.fitted.values, found.variables, floor)
            if not self._add(found, explaining, explaining.explanations(only), first, only):
                break
        is_new = begun is None or len(found.discoveries) > len(begun.discoveries)
        return self.settled(found) if found.discoveries and is_new else found

    def settled(self, model: DiscoveredModel) -> DiscoveredModel:
        """Return a model like the given one, with all its variables fitted anew.

        The fit starts from the model's values. The filter's gains, the costs, the additions and
        the errors of the result are those of the fit.
        """
        layout = self.plant.layout
        assert layout is not None
        fitted, filtered = self._refits.settled(model.fitted.values, model.variables, rounds=3)
        filtered = filtered.at(fitted.values)
        given = layout.additions(self.plant.nominal)
        every = refitted(layout, fitted.values, [*given, *model.additions])
        additions = tuple(every[len(given) :])
        # An error is that beside all others. What is held has the error that it had alone.
        errors = errors_of(filtered, fitted.values, model.variables)
        discoveries = []
        for index, each in enumerate(model.discoveries):
            sizes = layout.names(every, len(given) + index)[0]
            known = zip(sizes, each.errors, strict=True)
            discoveries.append(
                replace(
                    each,
                    addition=additions[index],
                    errors=tuple(errors.get(name, before) for name, before in known),
                )
            )
        costs = filtered.costs(fitted.values)
        return DiscoveredModel(
            Fitted(fitted.values, costs), filtered, model.variables, discoveries, additions
        )

    def filtered(self, values: Values) -> Filtered:
        """Return the records that are searched, with gains for these values."""
        return self._refits.fitter.filtered(values)

    def with_effect(
        self, filtered: Filtered, effect: Effect
    ) -> tuple[Fitted | None, tuple[Variable, ...]]:
        """Return the best fit of the nuisances and one effect of the catalogue, and its variables.

        The fit is None if the model breaks down from each start. Its costs are those with the
        filter's gains for its own values. The variables are those of the nuisances and the effect.

        Args:
            filtered: the records with gains for the values of all parameters without the effect.
            effect: the effect, which starts from its stated starts and those that the records
                propose, or else from these values.
        """
        variables, values = freed(self.nuisances, effect), filtered.values
        best: Fitted | None = None
        for start in starts_of(filtered, values, effect) or ({},):
            began = started(self.plant, values, effect, start)
            ended = self._refits.settled(began, variables, rounds=3)[0].values
            costs = self.filtered(ended).costs(ended)
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

        The explanations that promise most are tried in turn, one for each place and quantity, at
        most `_TRIED`. Each must gain `OVER_TWIN` times as much as its shape does on a twin. It is
        fitted in the plant itself, where it may be replaced by a better one (`_settled`). The first
        that then takes away `PART` of the excess is added.

        Args:
            found: what was discovered so far; changed in place.
            explaining: explains what the model with these discoveries leaves.
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
        likely = _distinct(earning)
        tried: list[tuple[Explanation, _InPlant | None]] = [(each, None) for each in likely]
        if found.fitted.cost > _FAR * explaining.samples or likely[0].share < ENOUGH:
            tried = self._by_cost(found, likely)
        for each, begun in tried[:_TRIED]:
            chance = on_twin.of(each.place, [each.shape])
            if chance and each.gain < OVER_TWIN * chance[0].gain:
                continue
            added = self._in_plant(found, each, begun=begun)
            if added is None:
                continue
            added, rivals = self._settled(found, explaining, added, ranked, only)
            gained = found.fitted.costs - added.fitted.costs
            if gained.sum() < PART * first or deviate(gained) < SURE:
                continue
            share = float(gained.sum()) / first if first > 0.0 else 0.0
            errors = errors_of(added.filtered, added.fitted.values, added.variables)
            every = [*layout.additions(self.plant.nominal), *added.additions]
            sizes = layout.names(every, len(every) - 1)[0]
            found.discoveries.append(
                Discovery(
                    added.explanation, added.addition,
                    tuple(errors.get(name, 0.0) for name in sizes), rivals, share,
                    found.fitted.values, added.fitted.values, explaining.reach(added.addition.of),
                )
            )  # fmt: skip
            found.fitted, found.filtered = added.fitted, added.filtered
            found.variables, found.additions = added.variables, added.additions
            return True
        return False

    def _by_cost(
        self, found: DiscoveredModel, likely: Sequence[Explanation]
    ) -> list[tuple[Explanation, "_InPlant | None"]]:
        """Return explanations, those that gain nearly most (`_CLOSE`) by their cost in the plant.

        Where a model is far off, or none of them explains nearly all, the linearisation tells only
        roughly which gains most: what the filter made up for is not in it. So of each place the
        best curve, and the best of what remembers, are fitted in the plant for one round, and have
        that fit beside them. Others of a place are told apart about the model with it (`_settled`).
        """
        best: dict[tuple[str, bool], Explanation] = {}
        for each in likely:
            if each.gain > _CLOSE * likely[0].gain:
                best.setdefault((each.place.name, each.shape.form in MEMORIES), each)
        close = list(best.values())[:_AT_ONCE]
        if len(close) < 2:
            return [(each, None) for each in likely]
        fitted = [self._in_plant(found, each, rounds=1) for each in close]
        costs = [np.inf if each is None else each.fitted.cost for each in fitted]
        first = [(close[k], fitted[k]) for k in np.argsort(costs, kind="stable")]
        return [*first, *((each, None) for each in likely if each not in close)]

    def _settled(
        self,
        found: DiscoveredModel,
        explaining: Explaining,
        added: "_InPlant",
        ranked: Sequence[Explanation],
        only: Wheres | None,
    ) -> tuple["_InPlant", tuple[Explanation, ...]]:
        """Return the model with the explanation that holds its own against others, and its rivals.

        The linearisation about the model without `added` told only roughly what is missing. So the
        likely explanations are fitted anew, linearised about the model with `added`, from which its
        disturbance is taken out. The simplest of the best is then fitted in the plant and replaces
        `added`, unless it costs more. That is repeated, at most `_TURNS` times. The rivals are at
        most two explanations elsewhere that gain as much, to within chance.

        Args:
            found: what was discovered before.
            explaining: explains what the model with these discoveries leaves.
            added: that model with one explanation more, fitted in the plant.
            ranked: explanations that compete, by falling gain.
            only: places and quantities that are looked at if the model was far off (`_FAR`) and all
                explanations compete; None for all.
        """
        rivals: tuple[Explanation, ...] = ()
        likely = _distinct(ranked)[:_LIKELY]
        # About a model that was far off, even what promised nothing may be right.
        afresh = found.fitted.cost > _FAR * explaining.samples
        for turn in range(_TURNS):
            last = turn == _TURNS - 1
            own = added.addition
            again = Explaining(
                added.filtered, added.fitted.values, added.base, 0.0, explaining, own
            )
            chosen = added.explanation
            simple = []
            if chosen.shape.form == "table":
                along = np.concatenate(again.attribution.along(chosen.shape.of))
                simple = symbols(chosen.shape, along)
            elif chosen.shape.form in CORNERS:
                simple = [replace(chosen.shape, at=own.at)]
            # Once they have all competed, those that were far behind stay behind.
            tried = again.explanations(only) if afresh and turn == 0 else again.again(likely)
            tried += again.of(chosen.place, [chosen.shape, *simple])
            tried += again.refined(chosen.place, corners(simple), tried)
            if chosen.shape.form in MEMORIES and not (afresh and turn == 0):
                tried += again.remembered(chosen.place, chosen.shape.of)
            tried.sort(key=lambda each: -each.gain)
            if afresh and turn == 0:
                likely = _distinct(tried)[:_LIKELY]
            best = _simplest(tried)
            near = [each for each in tried if not _worse(tried[0], each)]
            rivals = tuple(e for e in _distinct(near) if e.where != chosen.where)[:2]
            if last or _same(best, added):
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
        begun: "_InPlant | None" = None,
    ) -> "_InPlant | None":
        """Return the model with an explanation more, fitted in the plant.

        The result is None if that does not lower the cost, or is not possible (`is_possible`).
        In each of some rounds the filter's gains are computed and all variables fitted with them.
        The fit starts from the values `start`, or else from those without the explanation, and goes
        on where it was `begun` from there for one round. The variables that the disturbance may
        stand in for (`stood_in_for`) are held at the values that they have without it.
        """
        layout = self.plant.layout
        assert layout is not None
        at = found.fitted
        given = layout.additions(self.plant.nominal)
        additions = [*given, *found.additions, each.addition]
        values = {**(start or at.values), **layout.values(additions)}
        without = {**at.values, **layout.values(additions)}
        base = free = renamed(layout, found.variables, additions[:-1], additions)
        own = addition_variables(layout, additions, [len(additions) - 1])
        exact = each.shape.form in (*CORNERS, "play")
        kept = None
        if begun is not None:
            values, kept, rounds = begun.first.values, begun.kept, rounds - 1
        fitted, filtered, kept = self._refits.by_chords(values, (*base, *own), rounds, kept, exact)
        first = fitted
        if not fitted.cost < at.cost:
            return None
        vague = stood_in_for(each, self.plant, filtered, fitted.values, base, own)
        if vague:
            base = tuple(v.held(without) if v in vague else v for v in base)
            values = {**values, **{v.parameter: without[v.parameter] for v in vague}}
            fitted, filtered, _ = self._refits.by_chords(values, (*base, *own), rounds, kept, exact)
            if not fitted.cost < at.cost:
                return None
        variables, values = (*base, *own), fitted.values
        present = refitted(layout, values, additions)
        if not is_possible(self.plant, values, each.place, present[-1]):
            return None
        return _InPlant(
            each, fitted, filtered, variables, free, tuple(present[len(given) :]), first, kept
        )


@dataclass(frozen=True)
class _InPlant:
    """A model with one explanation more, fitted in the plant.

    Attributes:
        explanation: the explanation.
        fitted: fit with it.
        filtered: the records, with gains for the fit.
        variables: variables of the fit.
        base: those of them that were fitted before, none of them held for the explanation.
        additions: its disturbance and all discovered before, as fitted; its own is the last.
        first: fit with all variables, before any was held for the explanation.
        kept: changes by column name with which that fit was made (`Refits.by_chords`).
    """

    explanation: Explanation
    fitted: Fitted
    filtered: Filtered
    variables: tuple[Variable, ...]
    base: tuple[Variable, ...]
    additions: tuple[Addition, ...]
    first: Fitted
    kept: Mapping[str, Changes]

    @property
    def addition(self) -> Addition:
        """Return the disturbance of the explanation, as fitted."""
        return self.additions[-1]


def _loses(one: _InPlant, other: _InPlant) -> bool:
    """Return whether the other costs more than the one, beyond chance and one per cent."""
    return _matters(other.fitted.costs - one.fitted.costs, one.fitted.cost)


def _same(best: Explanation, added: _InPlant) -> bool:
    """Return whether an explanation is that of a model already.

    Place, quantity and form must be the same, and of a lag or a resonance its time constant or
    frequency, to within a tenth: the fit finds the others from there, and not these from afar. So
    it is with the place of a corner, which is looked for about the one that was fitted.
    """
    shape, addition = best.shape, added.addition
    if best.where != added.explanation.where or shape.form != added.explanation.shape.form:
        return False
    if shape.form in CORNERS:
        return abs(shape.at[0] - addition.at[0]) < _NEAR_CORNER * abs(addition.at[0])
    return shape.form not in MEMORIES or abs(shape.at[0] / addition.at[0] - 1.0) < _NEAR_FREQUENCY


def _worse(best: Explanation, other: Explanation) -> bool:
    """Return whether the other gains less than the best, beyond chance and one per cent."""
    return _matters(best.gains - other.gains, best.gain)


def _matters(lost: Array, whole: float) -> bool:
    """Return whether a loss (blocks,) is more than chance and more than one per cent of a whole."""
    error = float(np.sqrt(len(lost)) * np.std(lost, ddof=1))
    return float(lost.sum()) > max(NEAR * error, 0.01 * whole)


def _simplest(ranked: Sequence[Explanation]) -> Explanation:
    """Return the simplest explanation that predicts as well as the first one, at the same place.

    It depends on the same quantity as the first one or on none, and does not gain less beyond
    chance. The simplest has the fewest coefficients. `ranked` is sorted by falling gain.
    """
    best = ranked[0]
    same = [
        e
        for e in ranked
        if e.where[0] == best.where[0] and e.shape.of in ("", best.shape.of) and not _worse(best, e)
    ]
    return min(same, key=lambda each: (each.shape.count, -each.gain))


def _distinct(ranked: Sequence[Explanation]) -> list[Explanation]:
    """Return the first explanation of each place, quantity and factor, in the order given."""
    seen: dict[tuple[str, str, str], Explanation] = {}
    for each in ranked:
        seen.setdefault(each.where, each)
    return list(seen.values())
