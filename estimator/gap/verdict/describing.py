"""This module describes disturbances that were discovered, and leaves out those not wanted.

It reports channels that are stuck in a recording as such disturbances, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import MEMORIES, Addition, Plant, Stuck, as_term, stuck_stretches
from estimator.gap.prediction import (
    Curve,
    Discovered,
    Estimate,
    Fitter,
    Values,
    channel_gaps,
    mean_gap,
)
from estimator.gap.search import ADDED, NORMAL_95, Discovery, Found, Search, addition_variables
from rig.plant import unit_per
from rig.recording import Recording

from .choosing import Choice
from .lexicon import LEXICON, is_leak, likely_parts, shape_of
from .phases import known_phases
from .sentences import quantity_unit, sentence, si_unit_of, unit_of

_KEYS: Final = {
    "wave": ("pitch", "phase"),
    "tone": ("period",),
    "bump": ("middle", "width"),
    "hinge": ("from",),
    "beyond": ("limit",),
    "lag": ("time_constant",),
    "resonance": ("frequency", "damping"),
    "play": ("half_width",),
}
"""Names of what is told of a form in symbols besides its size, in the order of `Addition.at`."""
_UNITS: Final = {"phase": "rad", "time_constant": "s", "frequency": "Hz", "damping": ""}
"""Units of those that are not in the unit of the quantity."""
_DRAWN: Final = 121
"""Number of points at which a form in symbols is drawn."""
_TURNS: Final = 4
"""Number of periods of a tone that are drawn."""
_STUCK: Final = "stuck_channel"


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

    def allows(self, each: Discovered) -> bool:
        """Return whether the model may hold a disturbance, by what is wanted.

        Tones, lags and resonances are not looked at here: the model written has none, whatever this
        returns.
        """
        return self.discovered and (self.leaks or not each.suspected_leak)


def described_as(each: Discovery, plant: Plant) -> Discovered:
    """Return a disturbance as it is reported: with a name, units, a sentence and likely parts.

    Its held-out gap is not set, and it is said to be in the model written.
    """
    addition = each.addition
    low, high = each.reach
    name = shape_of(addition, low, high, plant)
    unit = si_unit_of(addition.place, plant)
    of_unit = plant.regions[addition.of].unit if addition.of in plant.regions else "s"
    is_table = addition.form == "table"
    return Discovered(
        name, addition.place, addition.of, addition.times, addition.form,
        sentence(addition, name, each.errors, plant, low, high),
        likely_parts(name, addition.place, plant),
        () if is_table else _estimates(each, unit, of_unit),
        np.array(addition.at if is_table else ()), np.array(addition.values if is_table else ()),
        np.array(each.errors if is_table else ()), unit, of_unit if addition.of else "",
        each.explanation.gain, each.explanation.z, each.share,
        could_also_be=tuple(
            _rival(rival.addition, each.reach if rival.shape.of == addition.of else None, plant)
            for rival in each.rivals
        ),
        suspected_leak=is_leak(addition, low, high),
        experiment=LEXICON[name].experiment,
        curve=(
            _drawn(each, plant, unit, of_unit)
            if addition.of and addition.form not in MEMORIES
            else None
        ),
    )  # fmt: skip


def _estimates(each: Discovery, unit: str, of_unit: str) -> tuple[Estimate, ...]:
    """Return the size of a form in symbols and what else it has (`_KEYS`), SI.

    Only sizes have an interval; the others' ends are NaN. `unit` is the SI unit of the place,
    `of_unit` that of the quantity.
    """
    addition, nan = each.addition, float("nan")
    per = unit_per(unit, of_unit, as_term(addition).form)
    reach = NORMAL_95 * (each.errors[0] if each.errors else nan)
    size = addition.values[0]
    found = [Estimate("size", "", size, size - reach, size + reach, per, 0.0)]
    if addition.form == "resonance":
        speed, reach = addition.values[1], NORMAL_95 * (each.errors[1] if each.errors else nan)
        found.append(Estimate("size_of_speed", "", speed, speed - reach, speed + reach, per, 0.0))
    for key, value in zip(_KEYS.get(addition.form, ()), addition.at, strict=False):
        found.append(Estimate(key, "", value, nan, nan, _UNITS.get(key, of_unit), 0.0))
    return tuple(found)


def _drawn(each: Discovery, plant: Plant, unit: str, of_unit: str) -> Curve:
    """Return a disturbance as a curve against its quantity, to be drawn.

    A table is given at its knots, a form in symbols at `_DRAWN` places that are evenly spread over
    the quantity's range; of a tone only the first periods are given. `unit` and `of_unit` are SI.
    """
    addition = each.addition
    if addition.form == "table":
        at, values = np.array(addition.at), np.array(addition.values)
        errors = np.array(each.errors) if each.errors else np.full(len(at), np.nan)
    else:
        low, high = each.reach
        if addition.form == "tone":
            high = min(high, low + _TURNS * addition.at[0])
        at = np.linspace(low, high, _DRAWN)
        values = addition.shape(at)
        of_size = each.errors[0] / abs(addition.values[0]) if each.errors else np.nan
        errors = np.abs(values) * of_size
    return Curve(
        addition.place, addition.of, at, values, errors, unit, of_unit,
        unit_of(addition.place, plant), quantity_unit(addition.of, plant),
        each.explanation.gain, each.share,
    )  # fmt: skip


def _rival(addition: Addition, reach: tuple[float, float] | None, plant: Plant) -> str:
    """Return another explanation in words: the name of its shape, its place and its quantity.

    `reach` is the range of its quantity, SI, if known; None for that of its knots.
    """
    ends = reach or ((addition.at[0], addition.at[-1]) if len(addition.at) > 2 else (0.0, 1.0))
    name = shape_of(addition, *ends, plant)
    times = f" x {addition.times}" if addition.times else ""
    return f"{name} in {addition.place} of {addition.of or 'nothing'}{times}"


def without_unwanted(
    search: Search,
    found: Found,
    choice: Choice,
    described: Mapping[int, Discovered],
    wanted: Wanted,
) -> Values:
    """Return values of all parameters, refitted without the disturbances that are not wanted.

    If all are wanted, these are the values of the finding.

    Args:
        search: the search whose records are refitted.
        found: finding with everything that was chosen.
        choice: what was chosen.
        described: descriptions of the disturbances, by the `id` of each `Discovery`.
        wanted: what the model may hold.
    """
    layout = search.plant.layout
    everything = (*choice.corrections.values(), *choice.discovered)
    held = [each for each in everything if wanted.allows(described[id(each)])]
    if len(held) == len(everything) or layout is None:
        return found.fitted.values
    given = layout.additions(search.plant.nominal)
    additions = [*given, *(each.addition for each in held)]
    values = {**found.fitted.values, **layout.values(additions)}
    own = addition_variables(layout, additions, range(len(given), len(additions)))
    others = [v for v in found.variables if v.name != ADDED]
    return search.refits.settled(values, (*others, *own))[0].values


def measured(discovered: Discovered, each: Discovery, judged: Fitter) -> Discovered:
    """Return a disturbance with `gap` set: the held-out gap before it was added and with it.

    Both models have the phases of tones in the held-out recordings (`known_phases`).
    """
    before, after = (known_phases(values, judged) for values in (each.before, each.after))
    gaps = channel_gaps(
        judged.predictor, judged.records, before, after, judged.pool, measured=judged.measured
    )
    return replace(discovered, gap=mean_gap(gaps))


def stuck_channels(recordings: Sequence[Recording], plant: Plant) -> list[Discovered]:
    """Return each channel that is stuck in any of the recordings, in the order of the outputs.

    The filter leaves out what such a channel repeats, so that the model written has no part of it
    and no gap is computed from it.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
    stretches = [each for recording in recordings for each in stuck_stretches(recording, plant)]
    return [
        _stuck(index, [each for each in stretches if each.output == index], plant)
        for index in sorted({each.output for each in stretches})
    ]


def _stuck(index: int, stretches: Sequence[Stuck], plant: Plant) -> Discovered:
    """Return one channel's stretches as a disturbance of its reading."""
    output = plant.outputs[index]
    place = f"reading of {output.channel}"
    unit, factor = unit_of(place, plant)
    times = [
        f"{each.value * factor:.4g} {unit} from {each.first * plant.period:.3g} s to "
        f"{each.end * plant.period:.3g} s of {each.source}"
        for each in stretches
    ]
    none = np.empty(0)
    return Discovered(
        _STUCK, place, "", "", _STUCK,
        f"The reading of {output.channel} repeats one value, which its noise would not let it do: "
        f"{'; '.join(times)}. These readings are left out of every fit and every gap",
        likely_parts(_STUCK, place, plant), (), none, none, none, output.unit, "",
        float("nan"), float("nan"), float("nan"),
        in_model=False, experiment=LEXICON[_STUCK].experiment,
    )  # fmt: skip
