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

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from .fit import Changes, Fitted, Fitter
from .linear import Column
from .plant import Array, Effect, Trace
from .variables import (
    Values,
    Variable,
    effect_variables,
    freed,
    nuisance_variable,
    started,
)

MATERIAL: Final = 0.01
"""Squared shift of predictions, over their variance, that an effect must cause where it acts."""
CHANCE: Final = 25.0
"""Least gain in cost: a normal deviate of five, beyond chance for any number of candidates."""
FEW_BLOCKS: Final = 2.0
"""What gains in no more blocks is not named."""
OVER_TWIN: Final = 5.0
"""Times the greatest gain among twins that a gain must be."""
FORM: Final = 0.01
"""Part of what an effect explains that its form may be wrong by: a tenth in amplitude, squared.
Another effect that explains all but this much may be the cause as well."""
MOST_EFFECTS: Final = 4
HELD_OUT: Final = 0.1
"""Excess in squared error held out, in variances a reading, that is more than a model that lacks
nothing has: ten times what matters."""
MOST: Final = 0.5
"""Part of that excess that an effect must take away."""
_TRIED: Final = 5
_TRIED_AGAIN: Final = 2
_PROMISED: Final = 2.0
"""Times the best gain so far that an effect must promise, by the linearisation, to be tried again
with gains of its own."""
_TWINS: Final = 2
_SWAPS: Final = 3
"""Times that alternatives are tried; each but the last may exchange one effect for another."""
_ROUNDS: Final = 5
"""Times that gains and values follow each other at most."""
_SETTLED: Final = 1e-3
"""Part of the cost below which a step leaves the gains as they are."""
_NEAR: Final = 0.2
"""Part of an effect's gain that another must have had at some stage to be tried in its place."""


@dataclass(frozen=True)
class Screened:
    """A candidate as the linearisation sees it: which start it is, and what it would gain."""

    effect: str
    start: Mapping[str, float]
    gain: float
    acting: float
    """Share of the readings that it moves."""


@dataclass(frozen=True)
class Alternative:
    """Another effect in the place of one.

    Attributes:
        effect: its name.
        share: part of the named effect's gain that it reaches.
        z: normal deviate of what it explains less, by the scatter of the blocks.
        fitted: the fit with it.
    """

    effect: str
    share: float
    z: float
    fitted: Fitted


@dataclass(frozen=True)
class Named:
    """An effect that earned its place.

    Attributes:
        effect: of the catalogue.
        gain: in cost, against the model without it.
        per_reading: that over the readings used.
        bar: what the gain had to pass.
        z: of the gain, by the scatter of its blocks.
        alternatives: other effects in its place, best first.
    """

    effect: str
    gain: float
    per_reading: float
    bar: float
    z: float
    alternatives: tuple[Alternative, ...] = ()

    @property
    def indistinguishable(self) -> tuple[Alternative, ...]:
        """Alternatives that may be the cause as well, at most two."""
        return tuple(a for a in self.alternatives if a.share >= 1.0 - FORM or a.z < 3.0)[:2]


@dataclass
class Found:
    """What a search ends with.

    Attributes:
        given: cost of each block with the model as given.
        refitted: with its nuisances refitted.
        fitted: with all that was found.
        variables: that were fitted.
        named: effects, in the order in which they were found.
        floor: cost of a twin of the final model, per reading.
        samples: readings used.
    """

    given: Fitted
    refitted: Fitted
    fitted: Fitted
    variables: tuple[Variable, ...]
    named: list[Named]
    floor: float = 0.0
    samples: int = 0
    errors: dict[str, float] = field(default_factory=dict)
    rejected: list[Screened] = field(default_factory=list)

    @property
    def explained(self) -> float:
        """Part of the excess over the floor that the named effects take away."""
        before = self.refitted.cost / self.samples - self.floor
        after = self.fitted.cost / self.samples - self.floor
        return 1.0 - after / before if before > 0.0 else 0.0


def deviate(differences: Array) -> float:
    """Return the normal deviate of the sum of differences (blocks,) by their scatter."""
    scatter = float(np.sqrt(len(differences)) * np.std(differences, ddof=1))
    return float(differences.sum()) / scatter if scatter > 0.0 else 0.0


def _earns(before: Fitted, fitted: Fitted, bar: float) -> bool:
    """Tell whether a fit gains more than a bar, in more than two blocks."""
    gains = before.costs - fitted.costs
    # Scaled: the cost of a block that cannot be predicted at all has no square.
    scaled = gains / max(float(np.abs(gains).max()), 1e-300)
    acting_blocks = scaled.sum() ** 2 / max(float((scaled**2).sum()), 1e-300)
    return bool(gains.sum() > bar and acting_blocks > FEW_BLOCKS)


class Search:
    """Searches the records of a fitter for effects of its plant's catalogue."""

    def __init__(self, fitter: Fitter, seed: int = 1, judged: Fitter | None = None) -> None:
        self.fitter, self.judged = fitter, judged
        self.plant = fitter.predictor.plant
        self.nuisances = tuple(nuisance_variable(n) for n in self.plant.nuisances)
        self._seed = seed
        self._twins: dict[tuple[float, ...], list[Fitter]] = {}

    def run(self) -> Found:
        """Return what the model lacks, as far as the records tell."""
        values = {**self.plant.nominal}
        self.fitter.refresh(values)
        given = Fitted(dict(values), self.fitter.costs(values))
        present = self.settled(given, self.nuisances)
        found = Found(given, present, present, self.nuisances, [])
        screened = self._grow(found)
        for _ in range(_SWAPS):
            self._eliminate(found)
            if not self._alternatives(found, screened):
                break
            screened |= self._grow(found)
        return found

    # One stage

    def _grow(self, found: Found) -> dict[str, list[Screened]]:
        """Add effects while they earn their place; return what was screened at any stage."""
        seen: dict[str, list[Screened]] = {}
        while len(found.named) < MOST_EFFECTS:
            screened = self.screen(self.fitter, found.fitted.values, found.variables)
            for candidate in screened:
                seen.setdefault(candidate.effect, []).append(candidate)
            added = self._next(found, screened) or self._next_held_out(found, screened)
            if added is None:
                found.rejected = screened
                break
            effect, fitted, bar = added
            before = found.fitted
            found.variables = freed(found.variables, effect)
            found.fitted = self.settled(fitted, found.variables)
            gain = before.cost - fitted.cost
            found.named.append(
                Named(
                    effect.name, gain, gain / found.samples, bar,
                    deviate(before.costs - fitted.costs),
                )
            )  # fmt: skip
        return seen

    def settled(self, fitted: Fitted, variables: Sequence[Variable]) -> Fitted:
        """Return the fit of variables whose gains are its own."""
        for _ in range(_ROUNDS):
            self.fitter.refresh(fitted.values)
            before = self.fitter.costs(fitted.values).sum()
            fitted = self.fitter.fit(fitted.values, variables, 4)
            # Where the values hardly moved, their gains did not either.
            if before - fitted.cost < _SETTLED * fitted.cost:
                break
        return fitted

    def _next(
        self, found: Found, screened: Sequence[Screened]
    ) -> tuple[Effect, Fitted, float] | None:
        """Return the effect to add, its fit, and the bar it passed."""
        before = found.fitted
        taken = {named.effect for named in found.named}
        found.samples = self.fitter.samples
        hopeful = [
            candidate
            for candidate in screened
            if candidate.effect not in taken
            and candidate.gain > 0.5 * max(CHANCE, MATERIAL * candidate.acting * found.samples)
        ][:_TRIED]
        chance = self._chance(found, [c.effect for c in hopeful]) if hopeful else {}
        best: tuple[Effect, Fitted, float] | None = None
        for candidate in hopeful:
            fitted = self._with(before, found.variables, candidate)
            effect = self.plant.effects[candidate.effect]
            bar = self._bar(candidate, chance, MATERIAL * found.samples)
            if _earns(before, fitted, bar) and (best is None or fitted.cost < best[1].cost):
                best = (effect, fitted, bar)
        gained = before.cost - best[1].cost if best is not None else 0.0
        for candidate in [c for c in hopeful if c.gain > _PROMISED * gained][:_TRIED_AGAIN]:
            fitted = self._with_own_gains(before, found.variables, candidate)
            effect = self.plant.effects[candidate.effect]
            bar = self._bar(candidate, chance, MATERIAL * found.samples)
            if _earns(before, fitted, bar) and (best is None or fitted.cost < best[1].cost):
                best = (effect, fitted, bar)
        return best

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
            fitted = self._with(before, found.variables, candidate)
            bar = self._bar(candidate, chance, 0.0)
            if not _earns(before, fitted, bar):
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
        self.judged.refresh(values)
        predictor = self.judged.predictor
        twins = [
            predictor.twin(record, values, self._seed + 500 + index)
            for index, record in enumerate(self.judged.records)
        ]
        twin = Fitter(predictor, twins, self.judged.pool)
        twin.refresh(values)
        costs = [f.costs(values).sum() / f.samples for f in (self.judged, twin)]
        return float(costs[0] - costs[1])

    def _bar(self, candidate: Screened, chance: Mapping[str, float], material: float) -> float:
        """Return what a candidate must gain; `material` is that of one acting on all readings."""
        over_twin = OVER_TWIN * chance.get(candidate.effect, 0.0)
        return float(max(CHANCE, material * candidate.acting, over_twin))

    def _with(self, present: Fitted, variables: Sequence[Variable], candidate: Screened) -> Fitted:
        """Return the fit with a candidate added."""
        effect = self.plant.effects[candidate.effect]
        values = started(self.plant, present.values, effect, candidate.start)
        kept = self._kept(present.values, variables)
        return self.fitter.fit(values, freed(tuple(variables), effect), 5, 3e-4, kept)

    def _with_own_gains(
        self, present: Fitted, variables: Sequence[Variable], candidate: Screened
    ) -> Fitted:
        """Return the fit with a candidate added, whose gains are its own.

        With those of a model without it, a large effect of a valve's edges hardly gains at all.
        """
        fitted = self._with(present, variables, candidate)
        effect = self.plant.effects[candidate.effect]
        fitted = self.settled(fitted, freed(tuple(variables), effect))
        self.fitter.refresh(present.values)
        return fitted

    def _kept(self, values: Values, variables: Sequence[Variable]) -> dict[str, Changes]:
        """Return the changes by variables, by the names of their columns."""
        columns = self.fitter.columns(values, variables)
        changes = self.fitter.changes(values, columns)
        return {column.name: change for column, change in zip(columns, changes, strict=True)}

    def screen(
        self,
        fitter: Fitter,
        values: Values,
        variables: tuple[Variable, ...],
        effects: Collection[str] | None = None,
    ) -> list[Screened]:
        """Return all candidates that a linearisation says gain something, best first."""
        columns = fitter.columns(values, variables)
        base = [column.name for column in columns]
        starts: dict[str, tuple[str, Mapping[str, float], list[str]]] = {}
        fitted = {variable.parameter for variable in variables if variable.key}
        for effect in self.plant.effects.values():
            if all(knob.parameter in fitted for knob in effect.knobs):
                continue
            if effects is not None and effect.name not in effects:
                continue
            given = self._starts(fitter, values, effect)
            for number, start in enumerate(given):
                column = Column(
                    f"{effect.name}#{number}", started(self.plant, values, effect, start), 1.0, 0.0
                )
                columns.append(column)
                starts[column.name] = (effect.name, start, [column.name])
            if not effect.starts and effect.propose is None:
                added = fitter.columns(values, effect_variables(effect))
                columns += added
                starts[added[0].name] = (effect.name, {}, [column.name for column in added])
        linear = fitter.linearise(values, columns)
        without = linear.solve(base)[1]
        reached = self._reached(fitter, values, [c for c in columns if "#" in c.name])
        best: dict[str, Screened] = {}
        for name, (added_effect, start, names) in starts.items():
            parameters = {v.parameter for v in effect_variables(self.plant.effects[added_effect])}
            kept = [
                c for c, v in zip(base, variables, strict=True) if v.parameter not in parameters
            ]
            gain = linear.solve([*kept, *names])[1] - without
            gain = max(gain, reached.get(name, 0.0) - without)
            index = linear.indices([name])[0]
            square = float(linear.products[:, index, index].sum())
            acting = min(
                1.0, 3.0 * square**2 / max(linear.quartics[index], 1e-300) / linear.samples
            )
            if gain > 0.0 and (added_effect not in best or gain > best[added_effect].gain):
                best[added_effect] = Screened(added_effect, start, gain, acting)
        return sorted(best.values(), key=lambda candidate: -candidate.gain)

    def _reached(
        self, fitter: Fitter, values: Values, columns: Sequence[Column]
    ) -> dict[str, float]:
        """Return what the cost loses at starts themselves: large effects are far from linear."""
        before = fitter.costs(values).sum()
        changes = fitter.changes(values, columns)
        costs = fitter.pool.map(lambda change: fitter.changed_costs(values, change), changes)
        return {
            column.name: float(before - left.sum())
            for column, left in zip(columns, costs, strict=True)
        }

    def _starts(
        self, fitter: Fitter, values: Values, effect: Effect
    ) -> tuple[Mapping[str, float], ...]:
        """Return where fits of an effect start: stated ones and those that the records propose."""
        if effect.propose is None:
            return effect.starts
        traces = [
            Trace(record.inputs, states, innovations, record.readings)
            for record, (innovations, states) in zip(
                fitter.records, fitter.innovations(values), strict=True
            )
        ]
        return (*effect.starts, *effect.propose(traces, values))

    def _chance(self, found: Found, effects: Sequence[str]) -> dict[str, float]:
        """Return what each of some effects gains at most on twins of the present model."""
        most: dict[str, float] = {}
        for fitter in self.twins(found.fitted.values):
            screened = self.screen(fitter, found.fitted.values, found.variables, effects)
            for candidate in screened:
                most[candidate.effect] = max(most.get(candidate.effect, 0.0), candidate.gain)
        return most

    def twins(self, values: Values, count: int = _TWINS) -> list[Fitter]:
        """Return fitters of records that a rig exactly like the model would have made."""
        key = tuple(values.values())
        if key not in self._twins:
            self._twins.clear()
        made = self._twins.setdefault(key, [])
        predictor, pool = self.fitter.predictor, self.fitter.pool
        for twin in range(len(made), count):
            numbers = range(len(self.fitter.records))
            records = pool.map(
                lambda index, first=self._seed + 1000 * twin: predictor.twin(
                    self.fitter.records[index], values, first + index
                ),
                numbers,
            )
            fitter = Fitter(predictor, list(records), pool)
            fitter.refresh(values)
            made.append(fitter)
        return made[:count]

    # After the search

    def _eliminate(self, found: Found) -> None:
        """Drop effects that no longer earn their place."""
        for named in list(found.named):
            if len(found.named) < 2:
                return
            variables, without = self._without(found, named.effect, exact=True)
            if without.cost - found.fitted.cost < named.bar:
                found.named.remove(named)
                found.variables = variables
                found.fitted = self.settled(without, variables)

    def _without(
        self, found: Found, name: str, exact: bool = False
    ) -> tuple[tuple[Variable, ...], Fitted]:
        """Return variables and fit without an effect, with the gains of the fit with it."""
        kept = [v for v in found.variables if not (v.name == name and v.key)]
        values = dict(found.fitted.values)
        for variable in effect_variables(self.plant.effects[name]):
            values = variable.put(values, self.plant.nominal[variable.parameter])
        refitted = found.refitted.values
        present = {variable.parameter for variable in kept}
        back = [v for v in self.nuisances if v.parameter not in present]
        back = [v for v in back if v.parameter in {w.parameter for w in found.variables}]
        variables = (*back, *kept)
        # The nuisances may have to go far: from where they are now, or from where they once were.
        once = {**values, **{v.parameter: refitted[v.parameter] for v in variables if not v.key}}
        if self.fitter.costs(once).sum() < self.fitter.costs(values).sum():
            values = once
        changes = None if exact else self._kept(found.fitted.values, kept)
        return variables, self.fitter.fit(values, variables, 6, 3e-4, changes)

    def _alternatives(self, found: Found, seen: Mapping[str, Sequence[Screened]]) -> bool:
        """Try other effects in the place of each that was named.

        Returns:
            Whether one was better and took its place.
        """
        taken = {named.effect for named in found.named}
        for position, named in enumerate(found.named):
            variables, without = self._without(found, named.effect)
            gain = without.cost - found.fitted.cost
            most = {name: max(c.gain for c in stages) for name, stages in seen.items()}
            near = {
                name
                for name, reached in most.items()
                if name not in taken and reached > _NEAR * most.get(named.effect, 0.0)
            }
            screened = self.screen(self.fitter, without.values, variables, near | {named.effect})
            own = next((c.gain for c in screened if c.effect == named.effect), 0.0)
            likely = [c for c in screened if c.effect != named.effect and c.gain > 0.4 * own]
            alternatives = []
            for candidate in likely[: _TRIED + 2]:
                fitted = self._with(without, variables, candidate)
                if found.fitted.cost - fitted.cost > CHANCE:
                    effect = self.plant.effects[candidate.effect]
                    found.variables = freed(variables, effect)
                    found.fitted = self.settled(fitted, found.variables)
                    better = deviate(without.costs - fitted.costs)
                    found.named[position] = Named(
                        effect.name, without.cost - fitted.cost,
                        (without.cost - fitted.cost) / found.samples, named.bar, better,
                    )  # fmt: skip
                    return True
                alternatives.append(
                    Alternative(
                        candidate.effect, (without.cost - fitted.cost) / gain,
                        deviate(fitted.costs - found.fitted.costs), fitted,
                    )
                )  # fmt: skip
            alternatives.sort(key=lambda alternative: -alternative.share)
            found.named[position] = Named(
                named.effect, gain, gain / found.samples, named.bar,
                deviate(without.costs - found.fitted.costs), tuple(alternatives),
            )  # fmt: skip
        return False
