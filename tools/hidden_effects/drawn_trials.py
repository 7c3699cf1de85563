"""Draws what a trial hides and how it moves, and records it.

All of it follows from the trial's kind, seed and number alone. What is hidden is called the
envelope: the workflow does not get it, and it is opened when the answer is scored.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from tools.hidden_effects.forms import CATALOGUE, FORMS
from tools.hidden_effects.menu import MENU, with_effects
from tools.hidden_effects.motions import BRISK, MOTIONS, STILL, Motion, drawn
from tools.hidden_effects.off_menu import FIRST_TWELVE, OFF_MENU, Place, Variant
from tools.hidden_effects.recordings import Recorded, record, write
from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.hidden_effects.sizes import NUISANCES, SIZES, Sizes

KINDS: Final = ("single", "double", "none", "off_menu", "unexcited")
"""Kinds of trials: one effect is hidden; two are; none is; one that is not in the catalogue; one
that the motions hardly show."""
FORM_CHOICES: Final = (CATALOGUE, "other")
"""Forms of hidden effects on the menu: that of the catalogue, or another one wherever there is."""
OFF_MENU_CHOICES: Final = ("first", "all")
"""Kinds off the menu: the first twelve, each in its first variant, or all in any variant."""
RECORDINGS: Final = ("identify_1", "identify_2", "holdout")
SECONDS: Final = 30.0

_SHARE_OF_TOLERANCE: Final = 0.8
_NEUTRAL: Final[Mapping[str, float]] = {
    "valve_bandwidth": TABLE.spool_frequency,
    "bulk_modulus": TABLE.oil_stiffness,
    "supply_pressure": TABLE.pump_pressure,
    "stiction_level": TABLE.break_away,
    "coulomb_level": TABLE.sliding,
    "stribeck_velocity": TABLE.stribeck,
    "viscous_friction": TABLE.drag,
    "presliding_compliance": TABLE.seal_stiffness,
    "pressure_1_gain": 1.0,
    "pressure_2_gain": 1.0,
    "position_gain": 1.0,
}
"""Neutral values of those effects that are not neutral at zero, SI."""
THE_SMALLER: Final = ("valve_rate_limit",)
"""Effects that act the more, the smaller their value is."""
_ONE_KNOB: Final = (
    {"command_delay", "valve_bandwidth"},
    {"constant_force", "friction_asymmetry"},
    {"entrained_air", "bulk_modulus"},
    {"supply_droop", "return_back_pressure"},
    {"stiction_level", "coulomb_level"},
    {"pressure_1_bias", "pressure_1_gain"},
    {"pressure_2_bias", "pressure_2_gain"},
)
"""Pairs of effects that recordings hardly distinguish; they are not hidden together."""
_SIZED: Final = ("value", "stiffness", "amplitude")
"""Names of the parameter that states an effect's size; an effect has one of them."""
_SHIFTED_BY: Final[Mapping[str, str]] = {
    "bulk_modulus": "oil_stiffness",
    "viscous_friction": "drag",
    "supply_pressure": "pump_pressure",
}


@dataclass(frozen=True)
class Envelope:
    """Everything that is drawn for a trial and not shown to the workflow.

    Attributes:
        seed, number: seed of the study, and number of the trial among those of its kind; all is
            drawn from these and the kind.
        kind: one of `KINDS`.
        effects: hidden effects of the catalogue by name, with their parameters in SI.
        off_menu: hidden effects that are not in the catalogue, likewise.
        nuisances: those values of the rig that differ between healthy rigs, by name, SI.
        motions: kind of motion, by recording.
        seconds: length of each recording.
        forms: name of the form (`forms.FORMS`) by hidden effect; those that are not in it have the
            catalogue's. The parameters of such a form are among those of the effect.
        places: by hidden effect that is not in the catalogue, the answers on where it enters that
            are right; each has the fields of an `off_menu.Place`.
        by_recording: those values of the rig that differ between the recordings, by recording, SI.
        shown: by hidden effect, the smallest distance of its size from the neutral value that the
            recordings to identify with would show (`shown.smallest_shown`), SI. Effects for which
            it was not computed are left out.
    """

    seed: int
    number: int
    kind: str
    effects: Mapping[str, Mapping[str, float]]
    off_menu: Mapping[str, Mapping[str, float]]
    nuisances: Mapping[str, float]
    motions: Mapping[str, str]
    seconds: float = field(default=SECONDS)
    shown: Mapping[str, float] = field(default_factory=dict)
    forms: Mapping[str, str] = field(default_factory=dict)
    places: Mapping[str, Sequence[Mapping[str, Sequence[str]]]] = field(default_factory=dict)
    by_recording: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def values(self, recording: str = "identify_1") -> RigValues:
        """Return the values of the trial's rig in a recording, with all hidden effects in them."""
        rig = TABLE._replace(**self.nuisances)
        rig = with_effects(rig, {**self.effects, **self.off_menu}, self.forms)
        return rig._replace(**self.by_recording.get(recording, {}))

    def without_effects(self) -> "Envelope":
        """Return an envelope of the same rig with nothing hidden in it; its kind stays."""
        return replace(self, effects={}, off_menu={}, forms={}, places={}, by_recording={})

    def shows(self, times: float) -> bool:
        """Return whether each effect has at least `times` the smallest size that would show.

        Only the effects in `shown` are looked at; if it is empty, the answer is True. The value of
        `valve_rate_limit` must be at most the limit in `shown` divided by `times`.
        """
        for name, limit in self.shown.items():
            size = distance(name, self.effects[name])
            if size * times > limit if name in THE_SMALLER else size < times * limit:
                return False
        return True

    def write(self, file: Path) -> None:
        """Write the envelope to `file` as JSON; create the folder if it is missing."""
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def read_envelope(fields: Mapping[str, Any]) -> Envelope:
    """Return the envelope that has the given fields, as `Envelope.write` wrote them to JSON."""
    return Envelope(**fields)


@dataclass(frozen=True)
class Drawn:
    """A trial before it is run: what is hidden, and the motion of each recording by its name."""

    envelope: Envelope
    motions: Mapping[str, Motion]


@dataclass(frozen=True)
class Choice:
    """What may be hidden.

    Attributes:
        forms: one of `FORM_CHOICES`; with "other", only effects that have another form are hidden.
        off_menu: one of `OFF_MENU_CHOICES`.
    """

    forms: str = CATALOGUE
    off_menu: str = "first"

    def __post_init__(self) -> None:
        if self.forms not in FORM_CHOICES or self.off_menu not in OFF_MENU_CHOICES:
            raise ValueError(f"forms {self.forms!r} or off menu {self.off_menu!r} is not known")


AS_EVER: Final = Choice()
"""With this, a seed draws the trials that it drew before there was a choice."""


def _turn(number: int, seed: int, names: list[str]) -> str:
    """Return the name for trial `number`: each name comes once before any comes again."""
    order = np.random.default_rng([seed, 7, number // len(names)]).permutation(len(names))
    return names[int(order[number % len(names)])]


def _parameters(
    name: str,
    table: Mapping[str, Sizes],
    rng: Generator,
    first: Motion,
    limits: Mapping[str, float],
) -> dict[str, float]:
    found = {}
    for parameter, sizes in table.items():
        bounded = sizes
        if name in limits and parameter in _SIZED:
            bounded = _from_limit(name, sizes, limits[name])
        found[parameter] = bounded.drawn(rng)
    # An effect at a place acts only if the ram gets there, so places lie within the ram's reach.
    low, high = np.quantile(first.setpoint, (0.1, 0.9))
    reach = low + (high - low) * np.array([0.15, 0.35, 0.65, 0.85])
    if name == "spring_load":
        found["contact"] = float(rng.uniform(reach[1], reach[2]))
    for place in found:
        if place.endswith("_place"):
            found[place] = float(rng.uniform(reach[1], reach[2]))
    if name == "end_stop":
        side, ends = [("low", reach[:2]), ("high", reach[2:])][int(rng.integers(2))]
        found[side] = float(rng.uniform(*ends))
    return found


def _from_limit(name: str, sizes: Sizes, limit: float) -> Sizes:
    neutral = _NEUTRAL.get(name, 0.0)
    try:
        return sizes.below(limit) if name in THE_SMALLER else sizes.beyond(limit, neutral)
    except ValueError:
        # No plausible size is so large. The effect cannot be found, and has its greatest size.
        ends = [end for interval in sizes.intervals for end in interval]
        by_size = sorted(ends, key=lambda end: abs(end - neutral))
        most = by_size[0] if name in THE_SMALLER else by_size[-1]
        return Sizes(((most, most),), even=True)


def distance(name: str, parameters: Mapping[str, float]) -> float:
    """Return how far an effect's size is from its neutral value (SI); for a rate limit, its value.

    The size is the parameter `value`, `stiffness` or `amplitude`; an effect of the menu has one.
    """
    key = next(key for key in _SIZED if key in parameters)
    return abs(parameters[key] - _NEUTRAL.get(name, 0.0))


def _hidden(kind: str, seed: int, number: int, rng: Generator, choice: Choice) -> list[str]:
    menu = list(MENU if choice.forms == CATALOGUE else FORMS)
    if kind == "none":
        return []
    if kind == "off_menu":
        kinds = FIRST_TWELVE if choice.off_menu == "first" else OFF_MENU
        return [_turn(number, seed, list(kinds))]
    first = _turn(number, seed, menu)
    if kind != "double":
        return [first]
    others = [
        name
        for name in menu
        if name != first and not any({name, first} <= pair for pair in _ONE_KNOB)
    ]
    return [first, others[int(rng.integers(len(others)))]]


def _motion_names(kind: str, rng: Generator) -> list[str]:
    if kind == "unexcited":
        return [str(name) for name in rng.choice(list(STILL), 3)]
    first = str(rng.choice(list(BRISK)))
    others = rng.permutation([name for name in MOTIONS if name != first])[:2]
    return [first, *map(str, others)]


def drawn_nuisances(rng: Generator, without: Collection[str] = ()) -> dict[str, float]:
    """Return nuisances of a rig, by name in SI, drawn evenly within 80 % of healthy tolerances.

    The tolerances are those in `NUISANCES`. The nuisances named in `without` are left out.
    """
    return {
        name: nominal * (1.0 + _SHARE_OF_TOLERANCE * tolerance * float(rng.uniform(-1.0, 1.0)))
        for name, (nominal, tolerance) in NUISANCES.items()
        if name not in without
    }


def drawn_trial(
    kind: str,
    seed: int,
    number: int,
    limits: Mapping[str, float] | None = None,
    seconds: float = SECONDS,
    choice: Choice = AS_EVER,
) -> Drawn:
    """Return a trial: the effects that are hidden, the values of its rig, and the motions.

    Args:
        kind: one of `KINDS`.
        seed: seed of the study.
        number: number of the trial among those of its kind.
        limits: by effect, the smallest distance of its size from the neutral value (for a rate
            limit the largest value). If no plausible size is so large, the largest plausible one is
            taken. Effects that are not in it are drawn from `SIZES`.
        seconds: length of each recording.
        choice: what may be hidden; by default, a seed draws what it always drew.

    Raises:
        ValueError: the kind is not one of `KINDS`.
    """
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r} is not one of {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    names = _motion_names(kind, rng)
    rows = round(seconds / 1e-3)
    motions = {file: drawn(name, rng, rows) for file, name in zip(RECORDINGS, names, strict=True)}
    hidden = _hidden(kind, seed, number, rng, choice)
    shifted = {_SHIFTED_BY[name] for name in hidden if name in _SHIFTED_BY}
    nuisances = drawn_nuisances(rng, shifted)
    # Form, variant and what differs between recordings have a generator of their own, so that all
    # else is the same without them.
    other = np.random.default_rng([seed, KINDS.index(kind), number, len(RECORDINGS), 1])
    variants = {name: _variant(name, other, choice) for name in hidden if name in OFF_MENU}
    parameters = {
        name: _parameters(
            name,
            variants[name].sizes if name in variants else SIZES[name],
            rng,
            motions["identify_1"],
            limits or {},
        )
        for name in hidden
    }
    forms = {}
    for name in hidden:
        if name in FORMS and choice.forms != CATALOGUE:
            forms[name] = str(other.choice(list(FORMS[name])))
            sizes = FORMS[name][forms[name]].sizes
            parameters[name] |= {key: each.drawn(other) for key, each in sizes.items()}
    by_recording = _by_recording(variants, other, seconds)
    differing = {key for values in by_recording.values() for key in values}
    parameters = {
        name: {key: value for key, value in found.items() if key not in differing}
        for name, found in parameters.items()
    }
    envelope = Envelope(
        seed, number, kind,
        {name: found for name, found in parameters.items() if name in MENU},
        {name: found for name, found in parameters.items() if name in OFF_MENU},
        nuisances, dict(zip(RECORDINGS, names, strict=True)), seconds,
        forms=forms,
        places={name: [_listed(place) for place in variant.places]
                for name, variant in variants.items()},
        by_recording=by_recording,
    )  # fmt: skip
    return Drawn(envelope, motions)


def _variant(name: str, rng: Generator, choice: Choice) -> Variant:
    variants = OFF_MENU[name]
    return variants[0 if choice.off_menu == "first" else int(rng.integers(len(variants)))]


def _listed(place: Place) -> dict[str, list[str]]:
    return {key: list(answers) for key, answers in asdict(place).items()}


def _by_recording(
    variants: Mapping[str, Variant], rng: Generator, seconds: float
) -> dict[str, dict[str, float]]:
    """Return phases and moments of each recording: nothing is in step with a recording's start."""
    sizes = {name: each for variant in variants.values() for name, each in variant.sizes.items()}
    length = {name: seconds for name in sizes if name.endswith("_at")}
    length |= {name: 1.0 for name in sizes if name == "tone_phase"}
    if not length:
        return {}
    return {
        recording: {name: sizes[name].drawn(rng) * times for name, times in length.items()}
        for recording in RECORDINGS
    }


def recordings(trial: Drawn) -> dict[str, Recorded]:
    """Run the trial's motions on its rig, each from rest, and return the recordings by name.

    The noise depends only on the seed, kind and number of the trial and the place of the motion.
    """
    envelope = trial.envelope
    found = {}
    for place, (name, motion) in enumerate(trial.motions.items()):
        # The noise has its own seed, so that it stays the same when only a size is changed.
        noise = [envelope.seed, KINDS.index(envelope.kind), envelope.number, place, 1]
        found[name] = record(envelope.values(name), motion, np.random.default_rng(noise))
    return found


def write_recordings(trial: Drawn, folder: Path) -> dict[str, Path]:
    """Record a trial, write its recordings as `*.csv.gz` into `folder`, and return files by name.

    The folder is created if it is missing.
    """
    files = {}
    for name, recorded in recordings(trial).items():
        files[name] = folder / f"{name}.csv.gz"
        write(recorded.table, files[name])
    return files
