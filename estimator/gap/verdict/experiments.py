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
    Variable,
    freed,
    nuisance_variable,
    with_effect_of,
)
from estimator.gap.search import FORM, Found, Named, cosines, deviate

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

    @property
    def merit(self) -> tuple[bool, float]:
        """Return the key by which trials are compared; the greater one is better.

        A trial that settles is better than any that does not, then the one with the greater `z`.
        """
        return self.settles, self.z


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
    # A motion is judged by the rival that it excludes worst.
    tried = [
        min(_trials(plant, found, named, motion, pool, seed), key=lambda trial: trial.merit)
        for motion in plant.motions()
    ]
    if not tried:
        in_words = "no motion is known for this plant"
        return Separation(effects, in_words, {}, float("nan"), float("nan"))
    best = max(tried, key=lambda trial: trial.merit)
    if not best.settles:
        pairs = [frozenset((named.effect, rival.effect)) for rival in rivals]
        why = "; ".join(filter(None, map(plant.not_told_apart.get, pairs)))
        in_words = f"none of the motions tried separates them{': ' if why else ''}{why}"
        return Separation(effects, in_words, {}, best.cosine, best.z)
    in_words = f"{best.motion.name}, {best.motion.told}"
    return Separation(effects, in_words, best.motion.campaign, best.cosine, best.z)


def _trials(
    plant: Plant, found: Found, named: Named, motion: Motion, pool: ThreadPoolExecutor, seed: int
) -> list[Trial]:
    """Return the results to be expected of a motion, for a named effect against each rival.

    The motion is simulated by a rig that is exactly the model found.
    """
    truth, effect = found.fitted.values, plant.effects[named.effect]
    blank = made_of(motion.name, motion.inputs, motion.course, plant)
    record = Predictor(replace(plant, steering=plant.loop)).twin(blank, truth, seed)
    filtered = Fitter(Predictor(plant), [record], pool).filtered(truth)
    right = filtered.costs(truth)
    variables = without_variables(plant, found.variables, effect)
    neutral = with_effect_of(truth, effect, plant.nominal)
    without = filtered.fit(neutral, variables, 3, 1e-3)
    base, gain = without.values, max(without.cost - float(right.sum()), 0.0)
    trials = []
    for rival in named.indistinguishable:
        other = plant.effects[rival.effect]
        wrong = filtered.fit(rival.fitted.values, freed(variables, other), 3, 1e-3)
        loss = wrong.cost - float(right.sum())
        # The rival's loss in the experiment adds to its known loss in the present recordings.
        losses = (1.0 - rival.share) * named.gain + loss
        # The signatures are those from the model with neither effect.
        changes = {
            effect.name: with_effect_of(base, effect, truth),
            other.name: with_effect_of(base, other, wrong.values),
        }
        cosine = float(cosines(filtered, base, variables, changes)[1])
        share = 1.0 - losses / (named.gain + gain)
        trials.append(Trial(motion, deviate(wrong.costs - right), cosine, share))
    return trials


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
