"""What a leak that comes and goes goes with: position, direction, pressures, or time.

Whether it goes with the motion is a permutation test: the openings are given other times, and the
greatest association with any of the candidates is compared with that of the true times. The other
times keep what the leak does by itself: how long its openings and its pauses last. They are drawn
from those, with another beginning and another pace, so that a leak with a period of its own is not
taken for one that goes with a periodic motion unless it keeps step with it.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from .records import Company, Episode

Array = NDArray[np.float64]

CHANCE: Final = 0.01
"""Share of leaks that open independently of the motion for which something of it is named; and of
those that open at random times which are said to be regular."""
LEAST_OPENINGS: Final = 6
"""Fewest openings by which anything is named: with fewer, whole openings moved about rarely differ
from the true ones by enough for one in a hundred."""
STRONG: Final = 0.8
"""Least association that is named: the leak is open nearly always beyond a value, and nearly never
on its other side. A leak pulls at the pressures while it is open, which makes 0.3 to 0.7. Regular
intervals differ from their mean by a fifth of it at most (one standard deviation)."""
_DRAWS: Final = 499
_PACE: Final = 0.25
"""Greatest change of the logarithm of the pace of openings that are moved about."""
_NEARLY: Final = 0.85
"""Part of the greatest association from which on another candidate cannot be ruled out."""
_LATEST: Final = 1200
"""Number of latest blocks that are looked at: ten minutes."""


def company(
    episodes: tuple[Episode, ...], start_s: Array, end_s: Array, open_: Array,
    motion: dict[str, Array],
) -> Company | None:  # fmt: skip
    """Return what the openings go with; None if nothing is beyond chance.

    Args:
        episodes: the openings, oldest first.
        start_s: when each block starts, float64 (n,), s.
        end_s: when each block ends, float64 (n,), s.
        open_: part of each block in which the leak was open, float64 (n,).
        motion: candidates by name, float64 (n,) each.
    """
    ended = [each for each in episodes if each.end_s is not None]
    if len(ended) < LEAST_OPENINGS:
        return None
    rng = np.random.default_rng(0)
    stays = np.array([each.end_s - each.start_s for each in ended if each.end_s is not None])
    begins = np.array([each.start_s for each in ended])
    since = max(int(np.searchsorted(end_s, begins[0])), end_s.size - _LATEST)
    part = slice(since, None)
    with_motion = _with_motion(
        stays, np.diff(begins) - stays[:-1], start_s[part], end_s[part], open_[part],
        {name: values[part] for name, values in motion.items()}, rng,
    )  # fmt: skip
    return with_motion or _with_time(begins, stays, rng)


def _associations(open_: Array, ranks: Array) -> Array:
    """Return mean rank where open less that where shut, from -1 to 1: (draws, candidates).

    Args:
        open_: part of each block in which the leak is open, float64 (draws, n).
        ranks: ranks of the candidates from 0 to 1, float64 (n, candidates).
    """
    total = open_.sum(axis=1, keepdims=True)
    count = open_.shape[1]
    there = open_ @ ranks / np.maximum(total, 1e-9)
    away = (1.0 - open_) @ ranks / np.maximum(count - total, 1e-9)
    return np.asarray(2.0 * (there - away))


def _with_motion(
    stays: Array, pauses: Array, start_s: Array, end_s: Array, open_: Array,
    motion: dict[str, Array], rng: np.random.Generator,
) -> Company | None:  # fmt: skip
    names = tuple(motion)
    order = np.column_stack([np.argsort(np.argsort(values)) for values in motion.values()])
    ranks = order.astype(np.float64) / max(open_.size - 1, 1)
    found = _associations(open_[None, :], ranks)[0]
    middle = 0.5 * (start_s + end_s)
    moved = np.stack([_moved(stays, pauses, middle, rng) for _ in range(_DRAWS)])
    by_chance = np.abs(_associations(moved, ranks)).max(axis=1)
    best = int(np.argmax(np.abs(found)))
    strength = float(abs(found[best]))
    chance = float((1 + (by_chance >= strength).sum()) / (1 + _DRAWS))
    if chance > CHANCE or strength < STRONG:
        return None
    others = tuple(
        name
        for name, each in zip(names, found, strict=True)
        if name != names[best] and abs(each) >= _NEARLY * strength
    )
    sense = 1 if found[best] > 0.0 else -1
    beyond = None
    if names[best] != "direction":
        beyond = _dividing(motion[names[best]], open_, sense)
    return Company(names[best], sense, strength, chance, beyond, others)


def _dividing(values: Array, open_: Array, sense: int) -> float:
    """Return the value that divides the blocks best into open and shut ones.

    Args:
        values: of one candidate, float64 (n,).
        open_: part of each block in which the leak was open, float64 (n,).
        sense: 1 if the leak is open where the value is greater, -1 where it is less.
    """
    order = np.argsort(sense * values)
    wrong = np.cumsum(open_[order]) - np.cumsum(1.0 - open_[order])
    at = int(np.argmin(wrong))
    following = min(at + 1, order.size - 1)
    return float(0.5 * (values[order[at]] + values[order[following]]))


def _moved(stays: Array, pauses: Array, middle: Array, rng: np.random.Generator) -> Array:
    """Return whether a leak with the same stays and pauses at other times is open, (n,) 0 or 1."""
    pace = float(np.exp(rng.uniform(-_PACE, _PACE)))
    cycle = float(stays.mean() + pauses.mean()) * pace
    count = int(2.0 * (middle[-1] - middle[0]) / cycle) + 4
    on = pace * rng.choice(stays, count)
    off = pace * rng.choice(pauses, count)
    edges = np.cumsum(np.column_stack([on, off]).ravel())
    edges += middle[0] - rng.uniform(0.0, 1.0) * (on[0] + off[0])
    return np.asarray(np.searchsorted(edges, middle) % 2 == 0, dtype=np.float64)


def _with_time(begins: Array, stays: Array, rng: np.random.Generator) -> Company | None:
    """Return that the leak opens at regular intervals; None if random times would be as regular.

    Random times are those of a leak whose pauses are exponential, with the stays that were found.
    """
    intervals = np.diff(begins)
    pause = max(float((intervals - stays[:-1]).mean()), 1e-3)
    drawn = rng.exponential(pause, (_DRAWS, intervals.size))
    drawn += rng.choice(stays, (_DRAWS, intervals.size))
    uneven = float(intervals.std() / intervals.mean())
    by_chance = drawn.std(axis=1) / drawn.mean(axis=1)
    chance = float((1 + (by_chance <= uneven).sum()) / (1 + _DRAWS))
    if chance > CHANCE or 1.0 - uneven < STRONG:
        return None
    return Company("time", 0, max(1.0 - uneven, 0.0), chance, period_s=float(intervals.mean()))
