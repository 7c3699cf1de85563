"""Searches the catalogue for what a model lacks: adds effects while they earn their place.

Every candidate is fitted together with the nuisances and with what was found before (nested
extension, prediction error). It is judged by what the cost gains, against two bars:

- It must matter: where it acts it must move the predictions by a tenth of their standard deviation
  or more (`MATERIAL`), on average.
- It must be more than chance and the filter's own imperfection would give: records of a twin, a rig
  that is exactly the present model on the same course (`Predictor.twin`), are searched likewise,
  and the gain must be well above what the candidate gains there.

Where nothing matters any more in the motions fitted to, but recordings held out are still predicted
worse than noise allows, an effect that is beyond chance and twins is named as well if, fitted
without them, it takes away most of what they have too much: it matters in their motion.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from estimator.gap.plant import Effect
from estimator.gap.prediction import Filtered, Fitted, Fitter, Values, freed

from .findings import (
    CHANCE,
    HELD_OUT,
    MATERIAL,
    MOST_EFFECTS,
    Found,
    Named,
    Screened,
    deviate,
    earns,
)
from .refits import Refits
from .rivals import Rivals
from .screening import Screening
from .twins import FEW, Twins

OVER_TWIN: Final = 5.0
"""How large a gain must be, in multiples of the greatest gain among twins."""
MOST: Final = 0.5
"""An effect that takes away this part of the held-out excess is named for that alone."""
_TRIED: Final = 5
_TRIED_AGAIN: Final = 2
_PROMISED: Final = 2.0
"""What an effect must promise by the linearisation, in multiples of the best gain so far, to be
tried again with filter gains of its own."""
_CLOSE: Final = 0.7
"""Part of the best gain from which an effect is tried again beside the best."""
_FAR: Final = 4.0
"""Cost of a reading above which it is so: gains of a model that is off by several standard
deviations favour what is wrong as well as what is right."""
_SWAPS: Final = 3
"""How often alternatives are tried; each time but the last may exchange one effect for another."""


class Search:
    """Searches the records of a fitter for effects of its plant's catalogue."""

    def __init__(self, fitter: Fitter, seed: int = 1, judged: Fitter | None = None) -> None:
        self.fitter, self.judged = fitter, judged
        self.plant = fitter.predictor.plant
        self.refits = Refits(fitter)
        self._seed = seed
        self._twins = Twins(fitter, seed)
        self._screening = Screening(self.plant)
        self.rivals = Rivals(self.refits, self._screening)

    def run(self) -> Found:
        """Return what the model lacks, as far as the records tell."""
        values = dict(self.plant.nominal)
        given = Fitted(values, self.fitter.filtered(values).costs(values))
        present, filtered = self.refits.settled(values, self.refits.nuisances)
        found = Found(given, present, present, filtered, self.refits.nuisances, [])
        screened = self._grow(found)
        for _ in range(_SWAPS):
            self._eliminate(found)
            if not self.rivals.exchange(found, screened):
                break
            # What was like an effect before it was exchanged for another is like that one, too.
            for name, stages in self._grow(found).items():
                screened.setdefault(name, []).extend(stages)
        return found

    # One stage

    def _grow(self, found: Found) -> dict[str, list[Screened]]:
        """Add effects while they earn their place; return what was screened at any stage."""
        seen: dict[str, list[Screened]] = {}
        while len(found.named) < MOST_EFFECTS:
            screened = self._screening.screen(found.filtered, found.fitted.values, found.variables)
            for candidate in screened:
                seen.setdefault(candidate.effect, []).append(candidate)
            added = self._next(found, screened) or self._next_held_out(found, screened)
            if added is None:
                found.rejected = screened
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
        return seen

    def _next(
        self, found: Found, screened: Sequence[Screened]
    ) -> tuple[Effect, Fitted, float] | None:
        """Return the effect to add, its fit, and the bar it passed."""
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
            # What comes after has the gains of the model itself, not of the last step towards it.
            found.filtered = found.filtered.at(before.values)
            effect = self.plant.effects[candidate.effect]
            bar = self._bar(candidate, chance, MATERIAL * found.samples)
            if earns(before, fitted, bar) and (best is None or fitted.cost < best[1].cost):
                best = (effect, fitted, bar)
        return best or first

    def _next_held_out(
        self, found: Found, screened: Sequence[Screened]
    ) -> tuple[Effect, Fitted, float] | None:
        """Return, as `_next`, an effect that matters in recordings held out only."""
        before = found.fitted
        excess = self.held_out_excess(before.values)
        if self.judged is None or excess <= HELD_OUT:
            return None
        taken = {named.effect for named in found.named}
        hopeful = [c for c in screened if c.effect not in taken and c.gain > 0.5 * CHANCE][:_TRIED]
        chance = self._chance(found, [c.effect for c in hopeful]) if hopeful else {}
        best: tuple[Effect, Fitted, float] | None = None
        least = (1.0 - MOST) * excess
        for candidate in hopeful:
            fitted = self.refits.with_effect(
                found.filtered, before.values, found.variables, candidate
            )
            bar = self._bar(candidate, chance, 0.0)
            if not earns(before, fitted, bar):
                continue
            left = self.held_out_excess(fitted.values)
            if left < least:
                best, least = (self.plant.effects[candidate.effect], fitted, bar), left
        return best

    def held_out_excess(self, values: Values) -> float:
        """Return by how much recordings held out are predicted worse than a twin would be.

        In squared errors over their variances, a reading; NaN without such recordings.
        """
        if self.judged is None:
            return float("nan")
        predictor = self.judged.predictor
        twins = [
            predictor.twin(record, values, self._seed + 500 + index)
            for index, record in enumerate(self.judged.records)
        ]
        both = (self.judged, Fitter(predictor, twins, self.judged.pool))
        filtered = [fitter.filtered(values) for fitter in both]
        costs = [each.costs(values).sum() / each.samples for each in filtered]
        return float(costs[0] - costs[1])

    def _bar(self, candidate: Screened, chance: Mapping[str, float], material: float) -> float:
        """Return what a candidate must gain; `material` is that of one acting on all readings."""
        over_twin = OVER_TWIN * chance.get(candidate.effect, 0.0)
        return float(max(CHANCE, material * candidate.acting, over_twin))

    def _chance(self, found: Found, effects: Sequence[str]) -> dict[str, float]:
        """Return what each of some effects gains at most on twins of the present model."""
        most: dict[str, float] = {}
        for twin in self.twins(found.fitted.values):
            screened = self._screening.screen(twin, found.fitted.values, found.variables, effects)
            for candidate in screened:
                most[candidate.effect] = max(most.get(candidate.effect, 0.0), candidate.gain)
        return most

    def twins(self, values: Values, count: int = FEW) -> list[Filtered]:
        """Return records that a rig exactly like the model would have made, filtered with it."""
        return self._twins.of(values, count)

    # After the search

    def _eliminate(self, found: Found) -> None:
        """Drop effects that no longer earn their place."""
        for named in list(found.named):
            if len(found.named) < 2:
                return
            variables, without = self.refits.without(found, named.effect, exact=True)
            if without.cost - found.fitted.cost < named.bar:
                found.named.remove(named)
                found.variables = variables
                found.fitted, found.filtered = self.refits.settled(without.values, variables)
