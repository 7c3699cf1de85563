"""Draws what a trial hides and how it moves, and records it.

All of it follows from the trial's kind, seed and number alone. What is hidden is called the
envelope: the workflow does not get it, and it is opened when the answer is scored.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from tools.hidden_effects.menu import MENU, OFF_MENU, with_effects
from tools.hidden_effects.motions import BRISK, MOTIONS, STILL, Motion, drawn
from tools.hidden_effects.recordings import Recorded, record, write
from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.hidden_effects.sizes import NUISANCES, OFF_MENU_SIZES, SIZES, Sizes

KINDS: Final = ("single", "double", "none", "off_menu", "unexcited")
"""Kinds of trials: one effect is hidden; two are; none is; one that is not in the catalogue; one
that the motions hardly show."""
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

    def values(self) -> RigValues:
        """Return the values of the trial's rig, with all hidden effects in them."""
        rig = TABLE._replace(**self.nuisances)
        return with_effects(rig, {**self.effects, **self.off_menu})

    def without_effects(self) -> "Envelope":
        """Return an envelope of the same rig with nothing hidden in it; its kind stays."""
        return replace(self, effects={}, off_menu={})

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


def _turn(number: int, seed: int, names: list[str]) -> str:
    """Return the name for trial `number`: each name comes once before any comes again."""
    order = np.random.default_rng([seed, 7, number // len(names)]).permutation(len(names))
    return names[int(order[number % len(names)])]


def _parameters(
    name: str, rng: Generator, first: Motion, limits: Mapping[str, float]
) -> dict[str, float]:
    table = SIZES.get(name) or OFF_MENU_SIZES[name]
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
    for place in ("tight_place", "worn_place"):
        if place in found:
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


def _hidden(kind: str, seed: int, number: int, rng: Generator) -> list[str]:
    menu = list(MENU)
    if kind == "none":
        return []
    if kind == "off_menu":
        return [_turn(number, seed, list(OFF_MENU))]
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

    Raises:
        ValueError: the kind is not one of `KINDS`.
    """
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r} is not one of {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    names = _motion_names(kind, rng)
    rows = round(seconds / 1e-3)
    motions = {file: drawn(name, rng, rows) for file, name in zip(RECORDINGS, names, strict=True)}
    hidden = _hidden(kind, seed, number, rng)
    shifted = {_SHIFTED_BY[name] for name in hidden if name in _SHIFTED_BY}
    nuisances = drawn_nuisances(rng, shifted)
    parameters = {
        name: _parameters(name, rng, motions["identify_1"], limits or {}) for name in hidden
    }
    envelope = Envelope(
        seed, number, kind,
        {name: found for name, found in parameters.items() if name in MENU},
        {name: found for name, found in parameters.items() if name in OFF_MENU},
        nuisances, dict(zip(RECORDINGS, names, strict=True)), seconds,
    )  # fmt: skip
    return Drawn(envelope, motions)


def recordings(trial: Drawn) -> dict[str, Recorded]:
    """Run the trial's motions on its rig, each from rest, and return the recordings by name.

    The noise depends only on the seed, kind and number of the trial and the place of the motion.
    """
    envelope = trial.envelope
    found = {}
    for place, (name, motion) in enumerate(trial.motions.items()):
        # The noise has its own seed, so that it stays the same when only a size is changed.
        noise = [envelope.seed, KINDS.index(envelope.kind), envelope.number, place, 1]
        found[name] = record(envelope.values(), motion, np.random.default_rng(noise))
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
