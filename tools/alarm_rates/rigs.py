"""Draws rigs of another maker, and motions that change about every minute.

The rigs are those of the independent simulator `tools.hidden_effects`: its air, oil, lines and
edges may follow other formulas than the product's, and each rig has up to three further small
effects, most of which neither the product's model nor its nuisances hold.
"""

from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tools.hidden_effects.motions import Motion, drawn
from tools.hidden_effects.physics import TICK
from tools.hidden_effects.rig_values import RigValues
from tools.intermittent.trials import healthy_rig

Array = NDArray[np.float64]

KINDS: Final = (
    "multisine",
    "pseudorandom",
    "steps",
    "sines",
    "ramps",
    "standstill",
    "in_the_seals",
    "pressed_on_the_stop",
)
"""Kinds of motion of the stretches, as `tools.hidden_effects.motions` names them."""
_CHANCES: Final = np.array([0.18, 0.14, 0.18, 0.14, 0.14, 0.12, 0.06, 0.04])
_STRETCH_S: Final = (30.0, 90.0)
_SMALL: Final = {
    "overlap": (0.5e-6, 3e-6),
    "underlap": (0.5e-6, 3e-6),
    "spool_play": (0.2e-6, 1e-6),
    "gauge_lag": (2e-4, 1e-3),
    "port_2_loss": (0.005, 0.03),
    "gauge_1_gain": (0.995, 1.005),
    "gauge_2_gain": (0.995, 1.005),
    "encoder_gain": (0.998, 1.002),
    "ripple": (1e4, 8e4),
}
"""Further effects and their sizes (SI), small beside those that `rig gap` would name."""


def drawn_rig(rng: Generator) -> RigValues:
    """Return a healthy rig of another maker."""
    rig = healthy_rig(rng, other_forms=True)
    names = rng.choice(list(_SMALL), int(rng.integers(0, 4)), replace=False)
    values = {str(name): float(rng.uniform(*_SMALL[str(name)])) for name in names}
    if "ripple" in values:
        values["ripple_frequency"] = float(rng.uniform(15.0, 150.0))
    return rig._replace(**values)


def mixed_motion(rng: Generator, rows: int) -> tuple[Motion, tuple[str, ...], NDArray[np.int64]]:
    """Return a motion of stretches of 30 to 90 s in closed loop, their kinds and their first rows.

    Args:
        rng: draws kinds, lengths, motions and the gain of the position loop.
        rows: number of rows of 1 ms.
    """
    setpoint = np.empty(rows)
    kinds, starts, first = [], [], 0
    while first < rows:
        length = min(round(float(rng.uniform(*_STRETCH_S)) / TICK), rows - first)
        kind = KINDS[int(rng.choice(len(KINDS), p=_CHANCES))]
        setpoint[first : first + length] = drawn(kind, rng, length).setpoint
        kinds.append(kind)
        starts.append(first)
        first += length
    gain = float(rng.uniform(25.0, 70.0))
    return Motion(setpoint, np.zeros(rows), gain), tuple(kinds), np.array(starts)
