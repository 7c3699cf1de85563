"""Whether a model that was fitted is kept: it must not predict worse than the model as given.

What is compared are predictions over the horizon, those that the gap is told in. A refit claims
nothing, so that it must not raise the gap held out at all. A name has evidence of its own, and a
motion held out that hardly shows it raises or lowers the gap by chance: it falls if the gap rises
by more than that. Neither may raise the error on the recordings fitted to by more than chance.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .held_out import filtered_errors
from .judging import PINNED, SURE
from .linear import mean_squares, slices_of
from .plant import Array, Plant
from .predictor import Predictor
from .records import Record
from .results import GapResult
from .variables import Values, Variable


@dataclass(frozen=True)
class Growth:
    """By how much squared errors over the horizon are larger with one model than with another.

    Attributes:
        mean: over half-second blocks and channels, in noise variances; infinite where the one
            predicts nothing finite and the other does.
        error: its standard error, by the scatter of the blocks.
    """

    mean: float
    error: float

    @property
    def beyond_chance(self) -> bool:
        """Whether the errors have grown by more than twice their standard error."""
        return self.mean > SURE * self.error


def growth(
    predictor: Predictor, records: Sequence[Record], given: Values, fitted: Values,
    pool: ThreadPoolExecutor,
) -> Growth:  # fmt: skip
    """Return how squared errors over the horizon grow from the model as given to one fitted.

    Each model filters the records with gains of its own.
    """
    variances = np.array([output.variance for output in predictor.plant.outputs])

    def squares(task: tuple[Record, Values]) -> Array:
        record, values = task
        errors, _ = filtered_errors(predictor, record.unfiltered(), values)
        blocks = slices_of(record, predictor.plant.period)
        return np.array([mean_squares(errors[block]) for block in blocks]) / variances

    tasks = [(record, values) for values in (given, fitted) for record in records]
    found = list(pool.map(squares, tasks))
    before, after = (
        np.concatenate(part) for part in (found[: len(records)], found[len(records) :])
    )
    known = np.isfinite(before)
    if not np.isfinite(after[known]).all():
        return Growth(np.inf, 0.0)
    known &= np.isfinite(after)
    changes = np.where(known, after, 0.0) - np.where(known, before, 0.0)
    used = known.any(axis=1)
    of_blocks = changes[used].sum(axis=1) / known[used].sum(axis=1)
    if len(of_blocks) < 2:
        return Growth(0.0, 0.0)
    return Growth(float(of_blocks.mean()), float(of_blocks.std(ddof=1) / np.sqrt(len(of_blocks))))


def why_worse(
    held_out: Growth, gap: tuple[float, float], fitted_to: Growth | None = None, *, named: bool
) -> str | None:
    """Return in words by what a model is worse than the one given; None if it is not.

    Args:
        held_out: growth of its errors on the recordings held out.
        gap: held out, of the model as given and of this one, above the floor of this one.
        fitted_to: as `held_out`, on the recordings fitted to.
        named: whether it has effects that were named, so that chance may raise the gap held out.
    """
    given, left = gap
    if held_out.beyond_chance or (not named and left > given):
        if not np.isfinite(held_out.mean):
            return "the recordings held out could not be predicted at all"
        grown = f"by {held_out.mean:.3g} noise variances over the horizon"
        if left > given:
            grown = f"{left:.3g} noise variances above the floor instead of {given:.3g}"
        return (
            f"the recordings held out would be predicted worse than by the model as given: {grown}"
        )
    if fitted_to is not None and fitted_to.beyond_chance:
        return (
            "over the horizon even the recordings fitted to would be predicted worse than by the "
            f"model as given, by {fitted_to.mean:.2g} noise variances"
        )
    return None


def take_back(result: GapResult, plant: Plant, worse: str) -> None:
    """Write the model as given, and say why; its gap is to be measured anew.

    Effects that were named go with it: what they explain is unknown then.
    """
    names = " and ".join(effect.name for effect in result.effects)
    result.reasons.append(f"with {names or 'the refit'}, {worse}; the model is written as given")
    if result.effects:
        result.verdict, result.effects, result.experiments = "unknown_effect", [], []
        result.rest, result.explained = result.where, float("nan")
    result.values, result.names, result.as_given = dict(plant.nominal), (), True
    result.channels = []


def at_an_end(variable: Variable, values: Values) -> bool:
    """Tell whether a refitted parameter has come to an end of its tolerance."""
    near = PINNED * (variable.upper - variable.lower)
    value = values[variable.parameter]
    return bool(min(value - variable.lower, variable.upper - value) <= near)


def ends_in_words(variables: Sequence[Variable], values: Values) -> list[str]:
    """Return a warning of refitted parameters that have come to an end of their tolerances."""
    names = [v.parameter for v in variables if not v.key and at_an_end(v, values)]
    if not names:
        return []
    were, end = (
        ("was", "an end of its tolerance")
        if len(names) == 1
        else ("were", "the ends of their tolerances")
    )
    return [
        f"{' and '.join(names)} {were} refitted to {end}: something else is wrong that this makes "
        "up for in part, or the rig is farther from its model than that"
    ]
