"""Tracking on rigs drawn at random, half of them with an effect that no model of them has."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.random import Generator

from control import Constant, ControlSettings, feedforward_command
from rig.configuration import Rig
from rig.plant import CATALOGUE, Model
from rig.plant.integrator import TICK
from tools.hidden_effects.sizes import SIZES, Sizes
from tools.simulated.drawn_rigs import drawn_rig

from .runs import SINE, STEPS, run

SEED: Final = 21
"""Seed of the rigs of docs/tracking.md."""
SINE_S: Final = 30.0
STEPS_S: Final = 8.0
HOLD_S: Final = 60.0
HELD_FROM_S: Final = 20.0
"""Hunting is looked for from this time of a hold on, s, when the ram has come to rest."""
_FASTEST_DIVERGENCE_M: Final = 0.03
"""A sine's error in its last 10 s beyond which the loop counts as unstable, m."""


@dataclass(frozen=True)
class Drawn:
    """A rig drawn at random, with what came of it.

    Attributes:
        number: number of the rig.
        effect: name of the effect that no model has; "" for none.
        reachable: whether the sine needs no more volts than the rig has, by the rig's own model.
        rms: rms error of the sine from its start on, m.
        worst: greatest error of its last 10 s, m.
        hunting: how far the position goes to and fro in a hold, m.
        creep: range of the position in that hold, m.
        overshoot: greatest overshoot of small steps, as a part of the step.
        settling_s: longest time until a small step stays within 5 % of it, s; infinite if one is
            not there after two seconds.
    """

    number: int
    effect: str
    reachable: bool
    rms: float
    worst: float
    hunting: float
    creep: float
    overshoot: float
    settling_s: float

    @property
    def unstable(self) -> bool:
        """Whether the loop swings by itself."""
        return self.reachable and self.worst > _FASTEST_DIVERGENCE_M


def _size(sizes: Sizes, rng: Generator) -> float:
    low, high = sizes.intervals[rng.integers(len(sizes.intervals))]
    return float(rng.uniform(low, high))


def drawn_plant(number: int, seed: int = SEED) -> tuple[Model, str]:
    """Return the true model of rig `number` of a seed, and the effect that is hidden in it.

    Rigs of even number are healthy rigs as docs/detection.md draws them; those of odd number have
    one effect besides, in a size of the trials of `rig gap`.
    """
    rng = np.random.default_rng([seed, number])
    model = Model(parameters=drawn_rig(rng))
    if number % 2 == 0:
        return model, ""
    known = [name for name in SIZES if name in CATALOGUE]
    name = known[rng.integers(len(known))]
    sizes = {key: _size(each, rng) for key, each in SIZES[name].items()}
    return model.with_effect(name, **sizes), name


def is_reachable(rig: Rig, plant: Model) -> bool:
    """Return whether the sine needs no more than the command limit on a rig."""
    samples = SINE.sample(np.arange(round(4.0 / TICK)) * TICK)
    settings = ControlSettings(feedforward="model", lead=0.0)
    needed = np.abs(feedforward_command(samples, settings, plant.parameters, np.inf)).max()
    return bool(needed <= rig.limits.command_V)


def tracked(
    rig: Rig, control: ControlSettings, gain: float, count: int, seed: int = SEED
) -> Iterator[Drawn]:
    """Yield what comes of a sine, of a hold and of small steps on each of `count` drawn rigs."""
    for number in range(count):
        plant, effect = drawn_plant(number, seed)
        true = replace(rig, plant=plant)
        moved = run(true, SINE, SINE_S, control, gain, seed=number)
        held = run(true, Constant(0.3), HOLD_S, control, gain, seed=number)
        answers = run(true, STEPS, STEPS_S, control, gain, seed=number).step_answers()
        yield Drawn(
            number, effect, is_reachable(rig, plant), moved.rms(),
            float(np.abs(moved.error(SINE_S - 10.0)).max()), held.hunting(HELD_FROM_S),
            held.swing(HELD_FROM_S),
            max(overshoot for overshoot, _ in answers), max(late_s for _, late_s in answers),
        )  # fmt: skip
