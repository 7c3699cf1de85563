"""This module reads effects of the catalogue off curves that were discovered.

Here an effect is known by where it enters, against what, and in which regime. The catalogue's
formula may explain nothing of it: straight edges shift the flow at large openings too, a spool that
is worn round does so near its null alone.
"""

from typing import Final

import numpy as np

from estimator.gap.plant import Array, Likeness

_MOST: Final = 0.5
"""Least part of a curve's squares that must be of an effect's kind: half."""
_NEAR: Final = 1.0 / 3.0
"""Part of a curve's range about 0 in which a peak counts as being at the valve's null."""


def _underlap(at: Array, values: Array) -> float | None:
    """Return the underlap, m, of a curve of openings (k,) that peaks at the null of the spool."""
    top = int(np.argmax(np.abs(values)))
    near = abs(at[top]) < _NEAR * np.max(np.abs(at))
    fades = max(values[0], values[-1]) < _MOST * values[top]
    return float(values[top]) if values[top] > 0.0 and near and fades else None


def _uneven_friction(at: Array, values: Array) -> float | None:
    """Return the asymmetry of friction, N, of a force (k,) that is the same in both directions.

    A force against extension that is the same in both directions adds to the friction of extension.
    """
    reach = min(-at[0], at[-1])
    speeds = np.linspace(0.0, reach, len(at))[1:] if reach > 0.0 else np.empty(0)
    forth, back = np.interp(speeds, at, values), np.interp(-speeds, at, values)
    even, odd = 0.5 * (forth + back), 0.5 * (forth - back)
    if not even @ even > _MOST * (even @ even + odd @ odd):
        return None
    return float(np.mean(even))


def _scale(at: Array, values: Array) -> float | None:
    """Return the scale of a transducer whose error (k,) grows in proportion to its reading."""
    used = at != 0.0
    slope = float(np.median(values[used] / at[used]))
    lacks = values - slope * at
    return 1.0 + slope if lacks @ lacks < _MOST * (values @ values) else None


LIKE: Final[dict[str, tuple[Likeness, ...]]] = {
    "valve_underlap_leakage": (Likeness("valve edges", "spool opening", _underlap),),
    "friction_asymmetry": (Likeness("force balance", "velocity", _uneven_friction),),
    "position_gain": (Likeness("reading of position_m", "position", _scale),),
    **{
        f"pressure_{i}_gain": (Likeness(f"reading of pressure_{i}_Pa", f"pressure {i}", _scale),)
        for i in (1, 2)
    },
}
"""Curves that are an effect, by its name."""
