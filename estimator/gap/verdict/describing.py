"""This module describes a disturbance that was discovered, and says what the model written has."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Addition, Plant
from estimator.gap.prediction import Discovered, Estimate, Fitter, Values, channel_gaps, mean_gap
from estimator.gap.search import ADDED, Discovery, Found, Search, addition_variables

from .choosing import Choice
from .lexicon import LEXICON, is_leak, sentence, shape_of, si_unit_of

_NORMAL_95: Final = 1.96
_KEYS: Final = {"wave": ("pitch", "phase"), "bump": ("middle", "width"), "hinge": ("from", "")}


@dataclass(frozen=True)
class Wanted:
    """What the model written may hold of what is discovered.

    Attributes:
        discovered: whether it holds what no catalogue does.
        leaks: whether it also holds what is suspected to be a leak. The detector would not see a
            leak that the model has.
    """

    discovered: bool = True
    leaks: bool = False


@dataclass(frozen=True)
class Kept:
    """The model that is written: values of all parameters, and the disturbances that it has."""

    values: Values
    held: tuple[Discovery, ...]

    def has(self, each: Discovery) -> bool:
        """Return whether the model has a disturbance."""
        return any(held is each for held in self.held)


def described_as(each: Discovery, plant: Plant) -> Discovered:
    """Return a disturbance with its shape's name, its units, and what it could be, in words."""
    addition = each.addition
    low, high = each.reach
    word = LEXICON[shape_of(addition, low, high)]
    unit = si_unit_of(addition.place, plant)
    of_unit = plant.regions[addition.of].unit if addition.of in plant.regions else "s"
    estimates: list[Estimate] = []
    is_table = addition.form == "table"
    if not is_table:
        reach = _NORMAL_95 * (each.errors[0] if each.errors else float("nan"))
        size = addition.values[0]
        estimates.append(Estimate("size", "", size, size - reach, size + reach, unit, 0.0))
        for key, value in zip(_KEYS.get(addition.form, ()), addition.at, strict=False):
            at_unit = "rad" if key == "phase" else of_unit
            nan = float("nan")
            estimates.append(Estimate(key, "", value, nan, nan, at_unit, 0.0))
    return Discovered(
        word.name, addition.place, addition.of, addition.times, addition.form,
        sentence(addition, word, plant, low, high), tuple(estimates),
        np.array(addition.at if is_table else ()), np.array(addition.values if is_table else ()),
        np.array(each.errors if is_table else ()), unit, of_unit if addition.of else "",
        each.explanation.gain, each.explanation.z, each.share,
        could_also_be=tuple(
            _rival(rival.addition, each.reach if rival.shape.of == addition.of else None)
            for rival in each.rivals
        ),
        suspected_leak=is_leak(addition, low, high),
        experiment=word.experiment,
    )  # fmt: skip


def _rival(addition: Addition, reach: tuple[float, float] | None) -> str:
    """Return another explanation in words: the name of its shape, its place and its quantity."""
    ends = reach or ((addition.at[0], addition.at[-1]) if len(addition.at) > 2 else (0.0, 1.0))
    name = shape_of(addition, *ends)
    times = f" x {addition.times}" if addition.times else ""
    return f"{name} in {addition.place} of {addition.of or 'nothing'}{times}"


def kept_of(
    search: Search,
    found: Found,
    choice: Choice,
    described: Mapping[int, Discovered],
    wanted: Wanted,
) -> Kept:
    """Return the model without the disturbances that are not wanted, refitted.

    Args:
        search: the search whose records are refitted.
        found: finding with everything that was chosen.
        choice: what was chosen.
        described: descriptions of the disturbances, by `id`.
        wanted: what the model may hold.
    """
    layout = search.plant.layout
    everything = (*choice.corrections.values(), *choice.discovered)
    held = tuple(
        each
        for each in everything
        if wanted.discovered and (wanted.leaks or not described[id(each)].suspected_leak)
    )
    if len(held) == len(everything) or layout is None:
        return Kept(found.fitted.values, held)
    given = layout.additions(search.plant.nominal)
    additions = [*given, *(each.addition for each in held)]
    values = {**found.fitted.values, **layout.values(additions)}
    own = addition_variables(layout, additions, range(len(given), len(additions)))
    others = [v for v in found.variables if v.name != ADDED]
    return Kept(search.refits.settled(values, (*others, *own))[0].values, held)


def measured(
    discovered: Discovered, each: Discovery, fitter: Fitter, judged: Fitter
) -> Discovered:
    """Return a disturbance with the held-out gap before it was added and with it."""
    gaps = channel_gaps(fitter.predictor, judged.records, each.before, each.after, fitter.pool)
    return replace(discovered, gap=mean_gap(gaps))
