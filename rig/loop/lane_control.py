"""The control law of rigs in lanes: that of `control.tracking`, with what it remembers by lane."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import PROPORTIONAL, ControlLaw, ControlMemory, Guide, control_memory, tracking_command
from rig.lanes import (
    LANES,
    aligned,
    empty_lanes,
    gather,
    in_lanes,
    load,
    load_fields,
    select,
    store,
)
from rig.plant import TICK, inner

Array = NDArray[np.float64]

_TRACKING: Final = PROPORTIONAL._replace(proportional=False)
"""A law with the numbers of which the tracking law sends gain times error and nothing else."""
_IS_PROPORTIONAL: Final = ControlLaw._fields.index("proportional")


class LaneGuide(NamedTuple):
    """The control laws of rigs in lanes, with what is known of their setpoints beforehand."""

    gain: Array
    """(1, LANES), gain of the position loop, V/m."""
    law: Array
    """(fields, LANES), `ControlLaw` of each rig; its first field is not used."""
    feedforward: Array
    """(n, LANES), as `Guide.feedforward`, V, from tick 0 on; a tick beyond its end has 0 V."""
    expected: Array
    """(n, LANES), as `Guide.expected`, m, from tick 0 on; in a tick beyond its end, and where it is
    NaN, it is the setpoint."""
    tones: Array
    """(n, TONE_NUMBERS, LANES), as `Guide.tones`; zeros for tones that a lane does not have."""
    kept: Array
    """(3, LANES), as `ControlMemory.kept`; updated in place."""
    learnt: Array
    """(MOST_TONES, 2, LANES), as `ControlMemory.learnt`; updated in place."""


def lane_guide(gains: Sequence[float], guides: Sequence[Guide]) -> LaneGuide:
    """Return the control laws of rigs in lanes, before their first tick.

    Args:
        gains: gain of each rig's position loop, V/m, (LANES,).
        guides: guide of each rig, (LANES,), with tables from tick 0 on.
    """
    memory = control_memory()
    laws = [_TRACKING if each.law.proportional else each.law for each in guides]
    return LaneGuide(
        aligned(np.array([gains], np.float64)),
        aligned(np.transpose(np.array(laws, np.float64))),
        _side_by_side([each.feedforward for each in guides]),
        _side_by_side([each.expected for each in guides], np.nan),
        _side_by_side([each.tones for each in guides]),
        aligned(np.repeat(memory.kept[:, None], LANES, axis=1)),
        aligned(np.repeat(memory.learnt[:, :, None], LANES, axis=2)),
    )


def _side_by_side(tables: Sequence[Array], padding: float = 0.0) -> Array:
    """Return tables (n, ...) as an array (longest n, ..., LANES), filled up with `padding`."""
    longest = max(len(table) for table in tables)
    made = np.full((longest, *tables[0].shape[1:], LANES), padding)
    for lane, table in enumerate(tables):
        made[: len(table), ..., lane] = table
    return aligned(made)


@inner
def tracking_lanes(setpoint, position, tick, where, limit, guide):
    """Return the commands of rigs in lanes by their tracking laws, V, within +-`limit`.

    Args:
        setpoint: position that is asked for, m, lanes.
        position: measured position, m, lanes.
        tick: number of each rig's tick, lanes.
        where: condition, lanes; what a law remembers is updated in the lanes where it holds.
        limit: greatest command of either sign, V.
        guide: `LaneGuide`; what its laws remember is updated.
    """
    kept, learnt = guide.kept, guide.learnt
    tried, tried_tones = empty_lanes(kept.shape[0]), np.empty_like(learnt)
    for i in range(kept.shape[0]):
        store(tried, i, load(kept, i))
    for i in range(guide.tones.shape[0]):
        store(tried_tones, 2 * i, load(learnt, 2 * i))
        store(tried_tones, 2 * i + 1, load(learnt, 2 * i + 1))
    ahead = 0.0 * tick
    known = guide.feedforward.shape[0]
    if known > 0:
        ahead = select(tick < known, gather(guide.feedforward, min(tick, known - 1.0)), ahead)
    expected = setpoint
    known = guide.expected.shape[0]
    if known > 0:
        found = gather(guide.expected, min(tick, known - 1.0))
        expected = select((tick < known) & (found == found), found, setpoint)
    command = tracking_command(
        setpoint, position, ahead, expected, tick * TICK, load(guide.gain, 0), limit, TICK,
        load_fields(guide.law, _TRACKING, _IS_PROPORTIONAL), in_lanes(guide.tones),
        ControlMemory(in_lanes(tried), in_lanes(tried_tones)),
    )  # fmt: skip
    for i in range(kept.shape[0]):
        store(kept, i, select(where, load(tried, i), load(kept, i)))
    for i in range(2 * guide.tones.shape[0]):
        store(learnt, i, select(where, load(tried_tones, i), load(learnt, i)))
    return command
