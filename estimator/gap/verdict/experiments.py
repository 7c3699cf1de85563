"""Which motion would tell effects apart that the recordings do not.

A rig that is exactly the model found, with the named effect, is simulated in each motion of the
plant's library, its own loop closed and its sensors' noise added (`Predictor.twin`). The model with
a rival in the effect's place is then fitted to that record, nuisances included, as the workflow
would fit it. What it explains less, over the scatter of its blocks, is the normal deviate by which
the experiment is expected to decide.
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
"""Normal deviate that must be predicted of an experiment: three decides, and predictions err."""
SURE: Final = 2.0
"""By how many times `FORM` a rival must be predicted to explain less, all data together."""


@dataclass(frozen=True)
class Trial:
    """What one motion is expected to show of an effect against a rival.

    Attributes:
        motion: tried.
        z: normal deviate by which the right effect would be better.
        cosine: of the two signatures, nuisances and what else was found projected out.
        share: part of the right effect's gain that the rival would reach, with the recordings that
            there are.
    """

    motion: Motion
    z: float
    cosine: float
    share: float

    @property
    def settles(self) -> bool:
        """Whether it would decide."""
        return self.z >= SETTLES and self.share < 1.0 - SURE * FORM


def separations(
    plant: Plant, found: Found, pool: ThreadPoolExecutor, seed: int = 1
) -> list[Separation]:
    """Return for each effect that has rivals the motion that would settle which it is.

    Where none of the motions would, the separation has no campaign, and says so.

    Args:
        plant: with the motions to choose from.
        found: by the search.
        pool: threads to run in.
        seed: of the simulated sensors' noise.
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
        # An experiment is as good as it is against the rival that it excludes worst.
        worst = min((stage.against(rival) for rival in rivals), key=_merit)
        if best is None or _merit(worst) > _merit(best):
            best = worst
    if best is None:
        told = "no motion is known for this plant"
        return Separation(effects, told, {}, float("nan"), float("nan"))
    if not best.settles:
        reasons = [
            plant.not_told_apart.get(frozenset((named.effect, rival.effect)), "")
            for rival in rivals
        ]
        why = "; ".join(reason for reason in reasons if reason)
        told = f"none of the motions tried separates them{': ' if why else ''}{why}"
        return Separation(effects, told, {}, best.cosine, best.z)
    told = f"{best.motion.name}, {best.motion.told}"
    return Separation(effects, told, best.motion.campaign, best.cosine, best.z)


def _merit(trial: Trial) -> tuple[bool, float]:
    return trial.settles, trial.z


class _Stage:
    """Simulates one motion of a rig that is the model found, and what it would tell of rivals."""

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
        """Return what the motion shows of the effect against a rival."""
        effect = self._plant.effects[rival.effect]
        variables = freed(self._variables, effect)
        wrong = self._filtered.fit(rival.fitted.values, variables, 3, 1e-3)
        gain = max(self._without.cost - float(self._right.sum()), 0.0)
        loss = wrong.cost - float(self._right.sum())
        # The rival's loss in the recordings that there are is known; here it adds to that.
        losses = (1.0 - rival.share) * self._named.gain + loss
        total = self._named.gain + gain
        cosine = self._cosine(wrong.values, effect)
        return Trial(self._motion, deviate(wrong.costs - self._right), cosine, 1.0 - losses / total)

    def _cosine(self, wrong: Values, rival: Effect) -> float:
        """Return the cosine of the two signatures, from the same model without either."""
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
    """Return values with an effect as in the model that was given."""
    changed = dict(values)
    for variable in effect_variables(effect):
        changed = variable.put(changed, plant.nominal[variable.parameter])
    return changed


def without_variables(
    plant: Plant, variables: Sequence[Variable], effect: Effect
) -> tuple[Variable, ...]:
    """Return the variables without those of an effect, whose nuisances are nuisances again."""
    kept = [
        variable for variable in variables if not (variable.key and variable.name == effect.name)
    ]
    present = {variable.parameter for variable in kept}
    nuisances = [nuisance_variable(nuisance) for nuisance in plant.nuisances]
    return (*(each for each in nuisances if each.parameter not in present), *kept)
