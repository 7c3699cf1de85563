"""Plans the motions of `rig gap --live` within a rig's limits.

The programme of motions excites all effects of the catalogue: fast strokes (flows, supply), steps
(valve, delays), slow reversals (friction), small fast strokes (valve, play). The position loop is
closed in all of them.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from faults import Campaign, CampaignTest
from rig.configuration import Rig
from rig.plant import Model

from .gap_motions import MARGIN_M, Room, Stroke, strokes
from .parts import part_campaign, part_test

_SETTLE_S: Final = 2.0


@dataclass(frozen=True)
class Programme:
    """The motions of the library that are run, each as its name and its duration in s.

    Attributes:
        fitted: motions to whose recordings the model is fitted.
        held: motions whose recordings are held out; they are run once, for all rounds.
        check: motions on which a revised model is checked; each check runs them anew with other
            phases.
        experiment_s: duration of a motion that distinguishes effects, s.
    """

    fitted: tuple[tuple[str, float], ...] = (
        ("wide strokes", 25.0),
        ("small steps", 15.0),
        ("slow reversals", 20.0),
        ("small fast strokes", 10.0),
    )
    held: tuple[tuple[str, float], ...] = (("wide strokes", 10.0), ("small steps", 10.0))
    check: tuple[tuple[str, float], ...] = (("wide strokes", 20.0), ("small steps", 10.0))
    experiment_s: float = 20.0


def room_of(rig: Rig) -> Room:
    """Return the range in which experiments may move a rig's ram: its limits less a margin."""
    limits = rig.limits
    return Room(
        limits.position_min_m + MARGIN_M, limits.position_max_m - MARGIN_M, rig.gain_V_per_m
    )


def motions_campaign(
    name: str, wanted: tuple[tuple[str, float], ...], rig: Rig, assumed: Model, seed: int
) -> Campaign:
    """Return a campaign with one test for each of some motions of the library.

    Args:
        name: name of the campaign, and of its folder.
        wanted: name and duration in s of each motion.
        rig: the rig, within whose limits the motions stay.
        assumed: the model that the filter assumes while it is recorded.
        seed: sets the motions' phases, and the noise of a simulated rig.
    """
    # Each test gets phases and noise that differ from those of the others.
    seeds = np.random.SeedSequence([seed, len(wanted)]).generate_state(len(wanted)) >> 1
    tests = [
        _test(strokes(room_of(rig), int(drawn))[motion], duration_s, int(drawn))
        for (motion, duration_s), drawn in zip(wanted, seeds, strict=True)
    ]
    return part_campaign(name, "Motions of rig gap --live.", rig, assumed, tests)


def _test(stroke: Stroke, duration_s: float, seed: int) -> CampaignTest:
    stroke = replace(stroke, duration_s=duration_s)
    start = float(stroke.setpoint.sample(np.zeros(1))[0])
    return part_test(stroke.name, stroke.setpoint, duration_s, start, _SETTLE_S, seed)
