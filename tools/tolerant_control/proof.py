"""Checks, on rigs and motions drawn at random, how much worse tolerant control can be.

It is compared with proportional control. On healthy rigs, the controller is given a leak that does
not exist; on leaking rigs, the leak with a wrong size.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from rig.plant import Parameters
from tools.simulated.drawn_rigs import MOTIONS, OPEN_LOOP, drawn_rig, standstill
from tools.thesis_tables.markdown import fixed, table

from .runs import NO_LEAK, Array, Coefficients, Run, leak_coefficients, run, ticks

FALSE_ALARMS: Final = (0.1, 0.2, 0.3, 0.5)
"""Sizes of the leaks that the controller is given although there are none, L/min."""
MISJUDGED: Final = (0.8, 1.0, 1.2)
"""Flows that the controller is given for a leak, divided by its true flow."""
_DRAWS: Final = {name: draw for name, draw in MOTIONS.items() if name not in OPEN_LOOP}


@dataclass(frozen=True)
class Drawn:
    """The runs of one rig in one motion.

    Attributes:
        still: whether the motion is a standstill.
        healthy: run without a leak, under proportional control.
        detecting: run without a leak, under tolerant control with the detector in the loop.
        alarmed: runs without a leak, in which the controller is given each of `FALSE_ALARMS`.
        proportional: run with a leak, under proportional control.
        misjudged: runs with that leak, whose size the controller is given times each of
            `MISJUDGED`.
    """

    still: bool
    healthy: Run
    detecting: Run
    alarmed: tuple[Run, ...]
    proportional: Run
    misjudged: tuple[Run, ...]


def _scaled(leak: Coefficients, factor: float) -> Coefficients:
    return leak[0] * factor, leak[1] * factor, leak[2] * factor


def _run(
    wanted: Array,
    rig: Parameters,
    seed: int,
    tracking: bool,
    leaks: Coefficients,
    assumed: Coefficients | None,
) -> Run:
    return run(wanted, rig=rig, leaks=leaks, told=assumed, seed=seed, tracking=tracking)


def drawn(seeds: range, tracking: bool = False) -> Iterator[Drawn]:
    """Draw a rig, a motion and a leak of 0.5 to 4 L/min by each seed; yield its runs, seed by seed.

    The motion is a closed-loop one of `MOTIONS` or a standstill; the leak may be in any place. With
    `tracking` the position loop has the tracking law in all runs, instead of its gain alone.
    """
    draws = {**_DRAWS, "standstill": standstill}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        rig = drawn_rig(rng)
        kind = tuple(draws)[rng.integers(len(draws))]
        wanted = np.ascontiguousarray(draws[kind](rng, ticks()))
        place = int(rng.integers(3))
        leak = leak_coefficients(place, rng.uniform(0.5, 4.0))

        of = partial(_run, wanted, rig, seed, tracking)
        yield Drawn(
            kind == "standstill",
            of(NO_LEAK, NO_LEAK),
            of(NO_LEAK, None),
            tuple(of(NO_LEAK, leak_coefficients(place, flow)) for flow in FALSE_ALARMS),
            of(leak, NO_LEAK),
            tuple(of(leak, _scaled(leak, factor)) for factor in MISJUDGED),
        )


def _row(
    name: str, pairs: list[tuple[Run, Run]], still: list[tuple[Run, Run]], tracking: bool
) -> list[str]:
    """Return the cells of a row that compares runs with their references.

    Moving rams under the tracking law are compared by difference, as its errors are next to
    nothing, others by ratio.

    Args:
        name: first cell.
        pairs: (run, reference) of moving rams.
        still: (run, reference) of rams that stand still.
        tracking: whether the position loop has the tracking law.
    """
    same = sum(np.array_equal(mine.command, other.command) for mine, other in [*pairs, *still])
    more, moved = (
        [1e3 * (mine.rms_error - other.rms_error) for mine, other in each]
        for each in (still, pairs)
    )
    worst = max(mine.rms_error / other.rms_error for mine, other in pairs)
    return [
        name,
        str(len(pairs) + len(still)),
        str(same),
        fixed(max(moved), 2) if tracking else fixed(worst, 3),
        fixed(max(more, default=None), 2),
    ]


def proof_table(found: list[Drawn], tracking: bool = False) -> str:
    """Return the table of the worst rms errors, compared with a loop that makes up for no leak.

    Moving rams are compared by the ratio of the errors, under the tracking law by their difference,
    as rams at standstill are.

    Raises:
        ValueError: no rig of `found` moves.
    """
    moving = [one for one in found if not one.still]
    still = [one for one in found if one.still]

    def row(name: str, way: str, reference: str, index: int | None = None) -> list[str]:
        def pair(one: Drawn) -> tuple[Run, Run]:
            mine = getattr(one, way)
            return (mine if index is None else mine[index]), getattr(one, reference)

        return _row(name, [pair(one) for one in moving], [pair(one) for one in still], tracking)

    rows = [row("healthy, detector in the loop", "detecting", "healthy")]
    rows += [
        row(f"healthy, false alarm of {flow:g} L/min", "alarmed", "healthy", index)
        for index, flow in enumerate(FALSE_ALARMS)
    ]
    rows += [
        row(f"leaking, {factor:.0%} of it taken for it", "misjudged", "proportional", index)
        for index, factor in enumerate(MISJUDGED)
    ]
    head = (
        "rigs", "runs", "identical commands",
        "most added to the rms error, mm" if tracking
        else "worst rms error over proportional control's",
        "at standstill: most added to the rms error, mm",
    )  # fmt: skip
    return table(head, rows)
