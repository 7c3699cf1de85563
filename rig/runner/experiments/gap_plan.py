"""The motions of `rig gap --live`, laid out within a rig's limits.

The programme excites what the catalogue has: fast strokes (flows, supply), steps (valve, delays),
slow reversals (friction), small fast strokes (valve, play). All are in closed loop.
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
    """Which motions of the library are run, and for how long, s.

    Attributes:
        fitted: to fit to.
        held: held out, in every round the same.
        check: of a revised model: run anew, in other phases.
        experiment_s: of a motion that distinguishes effects.
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
    """Return where experiments may move a rig's ram: within its limits, less a margin."""
    limits = rig.limits
    return Room(
        limits.position_min_m + MARGIN_M, limits.position_max_m - MARGIN_M, rig.gain_V_per_m
    )


def motions_campaign(
    name: str, wanted: tuple[tuple[str, float], ...], rig: Rig, assumed: Model, seed: int
) -> Campaign:
    """Return a campaign of motions of the library.

    Args:
        name: of the campaign, and of its folder.
        wanted: name and duration in s of each motion.
        rig: whose limits are kept.
        assumed: what the filter of its recordings assumes.
        seed: of the motions' phases, and of a simulated rig's noise.
    """
    # Each test has phases and noise unlike the others'.
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
