"""What a search of the catalogue comes to: candidates, effects that earned their place, bars."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from estimator.gap.plant import Array
from estimator.gap.prediction import Filtered, Fitted, Variable

MATERIAL: Final = 0.01
"""Squared shift of predictions, over their variance, that an effect must cause where it acts."""
CHANCE: Final = 25.0
"""Least gain in cost: a normal deviate of five, beyond chance for any number of candidates."""
FEW_BLOCKS: Final = 2.0
"""What gains in no more blocks is not named."""
FORM: Final = 0.01
"""Part of what an effect explains that its form may be wrong by: a tenth in amplitude, squared.
Another effect that explains all but this much may be the cause as well."""
MOST_EFFECTS: Final = 4
HELD_OUT: Final = 0.1
"""Excess in squared error held out, in variances a reading, that is more than a model that lacks
nothing has: ten times what matters."""


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
        filtered: the records with the gains that `fitted` has its costs by.
        variables: that were fitted.
        named: effects, in the order in which they were found.
        floor: cost of a twin of the final model, per reading.
        samples: readings used.
    """

    given: Fitted
    refitted: Fitted
    fitted: Fitted
    filtered: Filtered
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


def earns(before: Fitted, fitted: Fitted, bar: float) -> bool:
    """Tell whether a fit gains more than a bar, in more than two blocks."""
    gains = before.costs - fitted.costs
    # Scaled: the cost of a block that cannot be predicted at all has no square.
    scaled = gains / max(float(np.abs(gains).max()), 1e-300)
    acting_blocks = scaled.sum() ** 2 / max(float((scaled**2).sum()), 1e-300)
    return bool(gains.sum() > bar and acting_blocks > FEW_BLOCKS)
