"""What a trial hides, drawn from its seed and number alone; its recordings; its envelope."""

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
"""One effect, two, none, one that the catalogue has not, one that the motions do not show."""
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
"""Values of the effects that are not neutral at zero."""
THE_SMALLER: Final = ("valve_rate_limit",)
"""Effects that are the larger, the smaller their value."""
_ONE_KNOB: Final = (
    {"command_delay", "valve_bandwidth"},
    {"constant_force", "friction_asymmetry"},
    {"entrained_air", "bulk_modulus"},
    {"supply_droop", "return_back_pressure"},
    {"stiction_level", "coulomb_level"},
    {"pressure_1_bias", "pressure_1_gain"},
    {"pressure_2_bias", "pressure_2_gain"},
)
"""Pairs that recordings hardly tell apart: not hidden together."""
_SIZED: Final = ("value", "stiffness", "amplitude")
"""The parameter that is an effect's size."""
_SHIFTED_BY: Final[Mapping[str, str]] = {
    "bulk_modulus": "oil_stiffness",
    "viscous_friction": "drag",
    "supply_pressure": "pump_pressure",
}


@dataclass(frozen=True)
class Envelope:
    """What is hidden.

    Attributes:
        seed, number: what it was drawn from.
        kind: one of `KINDS`.
        effects: on the menu, by name, with their parameters in SI as the catalogue has them.
        off_menu: the same of effects that the catalogue has not.
        nuisances: values of the rig, within the tolerances of healthy ones.
        motions: kind of motion, by recording.
        seconds: length of each recording.
        shown: of the hidden effects, the smallest size that the motions to identify with would
            show, where it was computed (`shown.smallest_shown`).
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
        """Return the rig that this describes."""
        rig = TABLE._replace(**self.nuisances)
        return with_effects(rig, {**self.effects, **self.off_menu})

    def without_effects(self) -> "Envelope":
        """Return the same rig with nothing hidden in it."""
        return replace(self, effects={}, off_menu={})

    def shows(self, times: float) -> bool:
        """Tell whether every hidden effect is so many times as large as the motions would show."""
        for name, limit in self.shown.items():
            size = distance(name, self.effects[name])
            if size * times > limit if name in THE_SMALLER else size < times * limit:
                return False
        return True

    def write(self, file: Path) -> None:
        """Write it as JSON."""
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def read_envelope(fields: Mapping[str, Any]) -> Envelope:
    """Return the envelope that `Envelope.write` wrote, from its JSON fields."""
    return Envelope(**fields)


@dataclass(frozen=True)
class Drawn:
    """A trial before it is run: what is hidden, and the motions by recording."""

    envelope: Envelope
    motions: Mapping[str, Motion]


def _turn(number: int, seed: int, names: list[str]) -> str:
    """Return one of the names; each comes once before any comes again."""
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
    # Places are of use where the ram gets to.
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
        # No plausible size is so large: the effect can't be found, and is hidden at its most.
        ends = [end for interval in sizes.intervals for end in interval]
        by_size = sorted(ends, key=lambda end: abs(end - neutral))
        most = by_size[0] if name in THE_SMALLER else by_size[-1]
        return Sizes(((most, most),), even=True)


def distance(name: str, parameters: Mapping[str, float]) -> float:
    """Return how far an effect's size is from its neutral value; of a rate limit, its value."""
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
    """Return a rig's nuisances within healthy rigs' tolerances, by name; some may be left out."""
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
    """Draw a trial.

    Args:
        kind: one of `KINDS`.
        seed: of the study.
        number: of the trial in it.
        limits: smallest distance from the neutral value (of a rate limit the largest value), by
            effect; absent ones go by `SIZES`.
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
    """Return what the trial's rig was recorded to do, by recording."""
    envelope = trial.envelope
    found = {}
    for place, (name, motion) in enumerate(trial.motions.items()):
        # The noise hangs on nothing that was drawn before, so that a size may be changed alone.
        noise = [envelope.seed, KINDS.index(envelope.kind), envelope.number, place, 1]
        found[name] = record(envelope.values(), motion, np.random.default_rng(noise))
    return found


def write_recordings(trial: Drawn, folder: Path) -> dict[str, Path]:
    """Write the recordings of a trial as `*.csv.gz` into a folder; return them by name."""
    files = {}
    for name, recorded in recordings(trial).items():
        files[name] = folder / f"{name}.csv.gz"
        write(recorded.table, files[name])
    return files
