"""This module searches the catalogue for what a model lacks, adding one effect after the other.

Every candidate is fitted together with the nuisances and with the effects found before (nested
extension, prediction error). Its gain, by which it lowers the cost, must exceed two bars:

- It must matter: where it acts it must move the predictions by a tenth of their standard deviation
  or more (`MATERIAL`), on average.
- It must be more than what chance and the filter's own imperfection give. Records of a twin, a rig
  that is exactly the present model on the same course (`Predictor.twin`), are searched in the same
  way, and the gain must be well above what the candidate gains there.

Held-out recordings are not looked at.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

from estimator.gap.plant import Effect
from estimator.gap.prediction import Fitted, Fitter, Values, Variable, effect_variables, freed

from .findings import (
    CHANCE,
    MATERIAL,
    MOST_EFFECTS,
    NORMAL_95,
    Found,
    Named,
    Screened,
    deviate,
    earns,
)
from .refits import Refits
from .rivals import Rivals
from .screening import Screening
from .twins import Twins

OVER_TWIN: Final = 5.0
"""Least gain of an effect, in multiples of its greatest gain on a twin."""
_TRIED: Final = 5
"""Greatest number of candidates that are fitted at one stage."""
_TRIED_AGAIN: Final = 2
"""Greatest number of promising candidates that are fitted again with gains of their own."""
_PROMISED: Final = 2.0
"""A candidate is fitted again with filter gains of its own if the linearisation promises more than
this many times the best gain so far."""
_CLOSE: Final = 0.7
"""A candidate that gains more than this part of the best gain is fitted again beside the best."""
_FAR: Final = 4.0
"""Cost per reading above which close candidates are fitted again: the gains of a model that is off
by several standard deviations favour wrong effects as well as right ones."""
_REST: Final = 1e-3
"""Least part of what all effects explain together that each must explain: 3 % in amplitude. So much
the formulas of the others may be wrong by."""
_SWAPS: Final = 3
"""Greatest number of times that alternatives are tried, each of which may exchange one effect for
another."""


class Search:
    """Searches the records of a fitter for effects of its plant's catalogue.

    Args:
        fitter: fitter of the records.
        seed: seed of the twins' sensor noise.

    Attributes:
        plant: plant of the fitter.
        refits: refits of the fitter's records.
        rivals: tries other effects in the place of those named.
        twins: makes twins of the fitter's records.
    """

    def __init__(self, fitter: Fitter, seed: int = 1) -> None:
        self.fitter = fitter
        self.plant = fitter.predictor.plant
        self.refits = Refits(fitter)
        self._seed = seed
        self.twins = Twins(fitter, seed)
        self._screening = Screening(self.plant)
        self.rivals = Rivals(self.refits, self._screening)

    def run(self, narrowed: Callable[[Found], Collection[str] | None] | None = None) -> Found:
        """Search the fitter's records, and return the finding: the effects that the model lacks.

        The nuisances are refitted first. Then effects are added while they earn their place, those
        that no longer do so are removed, and others are tried in the place of each. The finding
        names no effects if none earns its place; its `floor` is not set.

        Args:
            narrowed: is asked, once one effect was added, which effects are worth looking at. If it
                returns their names, the search begins anew with these alone; if None, it goes on
                with all.
        """
        values = dict(self.plant.nominal)
        given = Fitted(values, self.fitter.filtered(values).costs(values))
        present, filtered = self.refits.settled(values, self.refits.nuisances)
        found = Found(given, present, present, filtered, self.refits.nuisances, [])
        # Candidates that were near an effect are also near the effect that took its place.
        screened: dict[str, list[Screened]] = {}
        self._grow(found, screened, most=1)
        if not found.named:
            return found
        names = narrowed(found) if narrowed is not None else None
        if names is not None:
            found.fitted, found.filtered = present, filtered
            found.variables, found.named = self.refits.nuisances, []
            screened.clear()
        self._grow(found, screened, names)
        for _ in range(_SWAPS):
            self.eliminate(found)
            if not self.rivals.exchange(found, screened):
                break
            self._grow(found, screened, names)
        return found

    # One stage

    def _grow(
        self,
        found: Found,
        seen: dict[str, list[Screened]],
        names: Collection[str] | None = None,
        most: int = MOST_EFFECTS,
    ) -> None:
        """Add effects while they earn their place, until the finding has `most` of them.

        Args:
            found: the finding; changed in place.
            seen: takes all candidates that are screened, by the name of the effect.
            names: effects that are looked at; None for all.
            most: greatest number of effects of the finding.
        """
        while len(found.named) < most and (names is None or names):
            screened = self._screening.screen(
                found.filtered, found.fitted.values, found.variables, names
            )
            for candidate in screened:
                seen.setdefault(candidate.effect, []).append(candidate)
            added = self._next(found, screened)
            if added is None:
                break
            effect, fitted, bar = added
            before = found.fitted
            found.variables = freed(found.variables, effect)
            found.fitted, found.filtered = self.refits.settled(fitted.values, found.variables)
            gain = before.cost - fitted.cost
            found.named.append(
                Named(
                    effect.name, gain, gain / found.samples, bar,
                    deviate(before.costs - fitted.costs),
                )
            )  # fmt: skip

    def _next(
        self, found: Found, screened: Sequence[Screened]
    ) -> tuple[Effect, Fitted, float] | None:
        """Return the effect to add next, its fit, and the bar that its gain passed.

        The candidates that promise most are fitted, some of them again with filter gains of their
        own. Of those that pass their bar it is the one that costs least; the result is None if
        there is none. In `found`, `samples` is set, on which the caller relies, and `filtered` may
        be replaced by the records with gains for the values of `found.fitted`.

        Args:
            found: finding so far; changed in place.
            screened: candidates, that with most gain first.
        """
        before = found.fitted
        taken = {named.effect for named in found.named}
        found.samples = found.filtered.samples
        hopeful = [
            candidate
            for candidate in screened
            if candidate.effect not in taken
            and candidate.gain > 0.5 * max(CHANCE, MATERIAL * candidate.acting * found.samples)
        ][:_TRIED]
        chance = self._chance(found, [c.effect for c in hopeful]) if hopeful else {}
        best: tuple[Effect, Fitted, float] | None = None
        gains: dict[str, float] = {}
        for candidate in hopeful:
            fitted = self.refits.with_effect(
                found.filtered, before.values, found.variables, candidate
            )
            gains[candidate.effect] = before.cost - fitted.cost
            effect = self.plant.effects[candidate.effect]
            bar = self._bar(candidate, chance, MATERIAL * found.samples)
            if earns(before, fitted, bar) and (best is None or fitted.cost < best[1].cost):
                best = (effect, fitted, bar)
        first = best
        gained = before.cost - best[1].cost if best is not None else 0.0
        again = [c for c in hopeful if c.gain > _PROMISED * gained][:_TRIED_AGAIN]
        if best is not None and best[1].cost > _FAR * found.samples:
            close = [c for c in hopeful if gains[c.effect] > _CLOSE * gained]
            if len(close) > 1:
                again, best = [*close, *(c for c in again if c not in close)], None
        for candidate in again:
            fitted = self.refits.with_own_gains(
                found.filtered, before.values, found.variables, candidate
            )
            # Later fits need the gains of the model itself, not of the last step towards it.
            found.filtered = found.filtered.at(before.values)
            effect = self.plant.effects[candidate.effect]
            bar = self._bar(candidate, chance, MATERIAL * found.samples)
            if earns(before, fitted, bar) and (best is None or fitted.cost < best[1].cost):
                best = (effect, fitted, bar)
        return best or first

    def held_out_excess(self, judged: Fitter, values: Values) -> float:
        """Return by how much held-out recordings are predicted worse than a twin of them would be.

        The result is a difference of costs per reading, and below 0 if they are predicted better.

        Args:
            judged: fitter of the held-out recordings.
            values: values of all parameters, with which both are predicted and the twin is made.
        """
        predictor = judged.predictor
        twins = [
            predictor.twin(record, values, self._seed + 500 + index)
            for index, record in enumerate(judged.records)
        ]
        both = (judged, Fitter(predictor, twins, judged.pool))
        filtered = [fitter.filtered(values) for fitter in both]
        costs = [each.costs(values).sum() / each.samples for each in filtered]
        return float(costs[0] - costs[1])

    def _bar(self, candidate: Screened, chance: Mapping[str, float], material: float) -> float:
        """Return the gain that a candidate must exceed.

        `chance` has the greatest gain on twins by effect. `material` is the gain that matters for a
        candidate that acts on all readings.
        """
        over_twin = OVER_TWIN * chance.get(candidate.effect, 0.0)
        return float(max(CHANCE, material * candidate.acting, over_twin))

    def _chance(self, found: Found, effects: Sequence[str]) -> dict[str, float]:
        """Return the greatest gain of each of some effects on twins of the finding's present model.

        The gains are those that the screening promises, by the names of the effects. An effect that
        gains nothing on any twin is left out.
        """
        most: dict[str, float] = {}
        for twin in self.twins.of(found.fitted.values):
            screened = self._screening.screen(twin, found.fitted.values, found.variables, effects)
            for candidate in screened:
                most[candidate.effect] = max(most.get(candidate.effect, 0.0), candidate.gain)
        return most

    # After the search

    def eliminate(self, found: Found) -> None:
        """Remove from a finding, in place, the effects that no longer earn their place.

        Such an effect gains less than its bar or than the part `_REST` of what all effects explain
        together, or its interval holds the value of the model as given (`_holds_neutral`). The last
        effect is never removed. The model is fitted anew after each removal.
        """
        for named in list(found.named):
            if len(found.named) < 2:
                return
            variables, without = self.refits.without(found, named.effect, exact=True)
            gain = without.cost - found.fitted.cost
            bar = max(named.bar, _REST * (found.refitted.cost - found.fitted.cost))
            if gain < bar or self._holds_neutral(found, named.effect):
                self._remove(found, named, variables, without)

    def give_up(self, found: Found, named: Named) -> None:
        """Remove an effect from a finding, in place, and fit the model anew."""
        variables, without = self.refits.without(found, named.effect, exact=True)
        self._remove(found, named, variables, without)

    def _remove(
        self, found: Found, named: Named, variables: tuple[Variable, ...], without: Fitted
    ) -> None:
        """Remove an effect from a finding; `variables` and `without` are those of the fit left."""
        found.named.remove(named)
        found.variables = variables
        found.fitted, found.filtered = self.refits.settled(without.values, variables)

    def _holds_neutral(self, found: Found, name: str) -> bool:
        """Return whether the 95 % interval of an effect's knob holds its value in the model given.

        The result is False for an effect with several knobs, which has no one size.
        """
        variables = effect_variables(self.plant.effects[name])
        if len(variables) != 1:
            return False
        values = found.fitted.values
        filtered = found.filtered.at(values)
        columns = filtered.columns(values, found.variables)
        names = [column.name for column in columns]
        linear = filtered.linearise(values, columns)
        errors = linear.errors(names, linear.solve(names)[0])
        (own,) = variables
        index = next(
            k for k, v in enumerate(found.variables) if v.key and v.parameter == own.parameter
        )
        reach = abs(own.reach(values, float(errors[index])))
        moved = values[own.parameter] - self.plant.nominal[own.parameter]
        return bool(abs(moved) < NORMAL_95 * reach)
