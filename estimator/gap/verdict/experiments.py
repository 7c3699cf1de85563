"""This module finds the motion that would decide between effects where the recordings do not.

For each motion of the plant's library, a rig is simulated that is exactly the model found, with the
named effect, with its own control loop closed and with sensor noise (`Predictor.twin`). Then the
model with a rival in the effect's place is fitted to that record, nuisances included, as the
workflow would fit it. The gain that the rival lacks, over its scatter from block to block, is the
normal deviate with which the experiment is expected to decide.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

from estimator.gap.plant import Effect, Motion, Plant, made_of
from estimator.gap.prediction import (
    Fitter,
    Predictor,
    Separation,
    Values,
    Variable,
    effect_variables,
    freed,
    nuisance_variable,
)
from estimator.gap.search import FORM, Alternative, Found, Named, cosines, deviate

SETTLES: Final = 5.0
"""Least normal deviate that must be predicted of an experiment. Three would decide, but predictions
err."""
SURE: Final = 2.0
"""A rival must be predicted to explain less than the right effect by this many times `FORM`, from
all data together."""


@dataclass(frozen=True)
class Trial:
    """The result that one motion is expected to give for an effect against a rival.

    Attributes:
        motion: motion that was tried.
        z: normal deviate by which the right effect would be better.
        cosine: cosine between the signatures of both, with nuisances and all else that was found
            projected out.
        share: part of the right effect's gain that the rival would reach, from this motion and the
            present recordings together.
    """

    motion: Motion
    z: float
    cosine: float
    share: float

    @property
    def settles(self) -> bool:
        """Return whether the motion would decide: `z` reaches `SETTLES`, and `share` is below 1.

        The share must be below 1 by more than `SURE` times `FORM`.
        """
        return self.z >= SETTLES and self.share < 1.0 - SURE * FORM


def separations(
    plant: Plant, found: Found, pool: ThreadPoolExecutor, seed: int = 1
) -> list[Separation]:
    """Return, for each effect with rivals, the motion that would best settle which is the cause.

    Its rivals are the alternatives that may be the cause as well (`Named.indistinguishable`). A
    motion is judged by the rival that it excludes worst. Where none of the motions would decide,
    the separation has no campaign, and says so in words.

    Args:
        plant: plant with the motions to choose from.
        found: finding of the search.
        pool: threads to run in.
        seed: seed of the simulated sensor noise.
    """
    return [
        _separation(plant, found, named, pool, seed) for named in found.named
        if named.indistinguishable
    ]  # fmt: skip


def _separation(
    plant: Plant, found: Found, named: Named, pool: ThreadPoolExecutor, seed: int
) -> Separation:
    rivals = named.indistinguishable
    effects = (named.effect, *(rival.effect for rival in rivals))
    best: Trial | None = None
    for motion in plant.motions():
        stage = _Stage(plant, found, named, motion, pool, seed)
        # An experiment is judged by the rival that it excludes worst.
        worst = min((stage.against(rival) for rival in rivals), key=_merit)
        if best is None or _merit(worst) > _merit(best):
            best = worst
    if best is None:
        in_words = "no motion is known for this plant"
        return Separation(effects, in_words, {}, float("nan"), float("nan"))
    if not best.settles:
        reasons = [
            plant.not_told_apart.get(frozenset((named.effect, rival.effect)), "")
            for rival in rivals
        ]
        why = "; ".join(reason for reason in reasons if reason)
        in_words = f"none of the motions tried separates them{': ' if why else ''}{why}"
        return Separation(effects, in_words, {}, best.cosine, best.z)
    in_words = f"{best.motion.name}, {best.motion.told}"
    return Separation(effects, in_words, best.motion.campaign, best.cosine, best.z)


def _merit(trial: Trial) -> tuple[bool, float]:
    return trial.settles, trial.z


class _Stage:
    """Simulates one motion of a rig that is the model found, and compares rivals in it."""

    def __init__(
        self,
        plant: Plant,
        found: Found,
        named: Named,
        motion: Motion,
        pool: ThreadPoolExecutor,
        seed: int,
    ) -> None:
        self._plant, self._named, self._motion = plant, named, motion
        self._truth: Values = found.fitted.values
        blank = made_of(motion.name, motion.inputs, motion.course, plant)
        looped = Predictor(replace(plant, steering=plant.loop))
        record = looped.twin(blank, self._truth, seed)
        self._filtered = Fitter(Predictor(plant), [record], pool).filtered(self._truth)
        self._right = self._filtered.costs(self._truth)
        effect = plant.effects[named.effect]
        self._variables = without_variables(plant, found.variables, effect)
        neutral = neutralised(plant, self._truth, effect)
        self._without = self._filtered.fit(neutral, self._variables, 3, 1e-3)

    def against(self, rival: Alternative) -> Trial:
        """Return the result to be expected of the motion, for the named effect against a rival."""
        effect = self._plant.effects[rival.effect]
        variables = freed(self._variables, effect)
        wrong = self._filtered.fit(rival.fitted.values, variables, 3, 1e-3)
        gain = max(self._without.cost - float(self._right.sum()), 0.0)
        loss = wrong.cost - float(self._right.sum())
        # The rival's loss in the experiment adds to its known loss in the present recordings.
        losses = (1.0 - rival.share) * self._named.gain + loss
        total = self._named.gain + gain
        cosine = self._cosine(wrong.values, effect)
        return Trial(self._motion, deviate(wrong.costs - self._right), cosine, 1.0 - losses / total)

    def _cosine(self, wrong: Values, rival: Effect) -> float:
        """Return the cosine of the signatures of effect and rival, from the model with neither."""
        base = self._without.values
        changes = {}
        for effect, values in (
            (self._plant.effects[self._named.effect], self._truth), (rival, wrong)
        ):  # fmt: skip
            changed = dict(base)
            for variable in effect_variables(effect):
                changed = variable.put(changed, values[variable.parameter])
            changes[effect.name] = changed
        return float(cosines(self._filtered, base, self._variables, changes)[1])


def neutralised(plant: Plant, values: Values, effect: Effect) -> dict[str, float]:
    """Return a copy of all values in which an effect's parameters are as in the model given."""
    changed = dict(values)
    for variable in effect_variables(effect):
        changed = variable.put(changed, plant.nominal[variable.parameter])
    return changed


def without_variables(
    plant: Plant, variables: Sequence[Variable], effect: Effect
) -> tuple[Variable, ...]:
    """Return the variables without those of an effect, and with the nuisances that it replaced."""
    kept = [
        variable for variable in variables if not (variable.key and variable.name == effect.name)
    ]
    present = {variable.parameter for variable in kept}
    nuisances = [nuisance_variable(nuisance) for nuisance in plant.nuisances]
    return (*(each for each in nuisances if each.parameter not in present), *kept)
