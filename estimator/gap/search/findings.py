"""This module defines what a search finds, candidates and named effects, and bounds for them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array
from estimator.gap.prediction import Filtered, Fitted, Variable

MATERIAL: Final = 0.01
"""Least square of the shift of predictions that an effect must cause where it acts, in variances of
the predictions."""
CHANCE: Final = 25.0
"""Least gain in cost: a normal deviate of five, which is beyond chance for any number of
candidates."""
FEW_BLOCKS: Final = 2.0
"""An effect that gains in no more blocks than this is not named."""
FORM: Final = 0.01
"""Part of what an effect explains by which its form may be wrong: a tenth in amplitude, squared.
Another effect that explains all but this part may be the cause as well."""
SETTLED: Final = 0.1
"""Greatest excess, in variances per reading, that may be left without a look at what else may be
missing: ten times what matters. It must also be less than `FORM` of what is explained."""
MOST_EFFECTS: Final = 4
"""Greatest number of effects that are named."""
NORMAL_95: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""
HELD_OUT: Final = 0.1
"""Greatest excess in squared error on held-out recordings that a model may have if it lacks
nothing, in variances per reading: ten times what matters."""


@dataclass(frozen=True)
class Screened:
    """A candidate, with the start of its fit and the gain that the linearisation promises.

    Attributes:
        effect: name of the effect.
        start: values of the effect's knobs, by key, at the start; empty for the present values.
        gain: promised gain in cost.
        acting: share of the readings that the effect moves.
    """

    effect: str
    start: Mapping[str, float]
    gain: float
    acting: float


@dataclass(frozen=True)
class Alternative:
    """Another effect that was fitted in the place of a named one.

    Attributes:
        effect: name of the other effect.
        share: part of the named effect's gain that the other effect reaches.
        z: normal deviate of the gain that it lacks, by the scatter of the blocks.
        fitted: fit with the other effect.
    """

    effect: str
    share: float
    z: float
    fitted: Fitted


@dataclass(frozen=True)
class Named:
    """An effect that earned its place.

    Attributes:
        effect: name of the effect in the catalogue.
        gain: by how much it lowers the cost of the model without it.
        per_reading: that gain, divided by the number of readings used.
        bar: gain that it had to exceed.
        z: normal deviate of the gain, by the scatter of the blocks.
        alternatives: other effects that were fitted in its place, best first.
        read: value of its first knob and standard error, SI, if these were read off a curve that
            the model has in the place of the effect's formula; None if they were fitted.
    """

    effect: str
    gain: float
    per_reading: float
    bar: float
    z: float
    alternatives: tuple[Alternative, ...] = ()
    read: tuple[float, float] | None = None

    @property
    def indistinguishable(self) -> tuple[Alternative, ...]:
        """Return the first two alternatives that may be the cause as well, or fewer.

        Such an alternative reaches all of the gain but the part `FORM`, or the gain that it lacks
        is less than three normal deviates.
        """
        return tuple(a for a in self.alternatives if a.share >= 1.0 - FORM or a.z < 3.0)[:2]


@dataclass
class Found:
    """What a search ends with. The search changes it step by step.

    Attributes:
        given: values and costs of the model as given.
        refitted: fit of the nuisances alone.
        fitted: fit with all effects that were found.
        filtered: the records, with those filter gains with which the costs of `fitted` were
            computed.
        variables: variables of that fit.
        named: effects, in the order in which they were found.
        floor: cost per reading of a twin of the final model; 0 until it is set after the search.
        samples: number of readings used.
    """

    given: Fitted
    refitted: Fitted
    fitted: Fitted
    filtered: Filtered
    variables: tuple[Variable, ...]
    named: list[Named]
    floor: float = 0.0
    samples: int = 0

    @property
    def explained(self) -> float:
        """Return the part of the excess over the floor that the fit with all effects takes away.

        The excess is that with the nuisances alone refitted. The part is 0 if there is no excess.
        """
        before = self.refitted.cost / self.samples - self.floor
        after = self.fitted.cost / self.samples - self.floor
        return 1.0 - after / before if before > 0.0 else 0.0


def deviate(differences: Array) -> float:
    """Return the normal deviate of the sum of differences (blocks,), by their scatter.

    There must be at least two blocks. The result is 0 if all differences are equal.
    """
    scatter = float(np.sqrt(len(differences)) * np.std(differences, ddof=1))
    return float(differences.sum()) / scatter if scatter > 0.0 else 0.0


def earns(before: Fitted, fitted: Fitted, bar: float) -> bool:
    """Return whether a fit lowers the cost by more than a bar, and in more than two blocks.

    The number of blocks is (sum of gains)^2 / (sum of squared gains): a block that gains little
    counts little.
    """
    gains = before.costs - fitted.costs
    # The gains are scaled, because the cost of a block that cannot be predicted is too large to be
    # squared.
    scaled = gains / max(float(np.abs(gains).max()), 1e-300)
    acting_blocks = scaled.sum() ** 2 / max(float((scaled**2).sum()), 1e-300)
    return bool(gains.sum() > bar and acting_blocks > FEW_BLOCKS)
