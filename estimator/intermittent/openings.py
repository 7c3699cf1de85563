"""When a leak was open: each block's state by all blocks, and the episodes that follow.

The states of a block follow from the blocks before and after it (forward-backward recursion,
Rabiner 1989, Proc. IEEE 77), nuisances and the leak's coefficient from a regression in which each
block has the leak for the part of its time that the states say. The two take turns.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import NOISE_WEIGHT, NUISANCE_COUNT, lasting_noise, student_quantile
from rig.jit import njit

from .explanations import CHANGING, OPEN, SHUT, TURNS
from .kept_blocks import KeptBlocks
from .records import Episode

Array = NDArray[np.float64]

SURE: Final = 0.99
"""Probability with which an opening counts, and with which the leak must be shut before the next.

A claim needs three openings; with this, two of them would be mistaken in one of 5000."""
_ROUNDS: Final = 3
"""Turns of states and regression; what a further one changes is far below the errors."""
_EDGE_S: Final = 0.15
"""Standard deviation of the time of an opening or shutting, s: a block of 0.5 s is divided at any
place by chance (0.14 s)."""


@dataclass(frozen=True)
class Openings:
    """The openings of a leak in the kept blocks.

    Attributes:
        episodes: the openings that are sure, oldest first.
        open: part of each block in which the leak was open, float64 (n,).
        coefficient, deviation: of the leak while open, SI; the deviation is by noise alone.
        size: mean flow per unit coefficient while open, SI.
    """

    episodes: tuple[Episode, ...]
    open: Array
    coefficient: float
    deviation: float
    size: float


@njit(cache=True, error_model="numpy")
def smoothed(likelihoods, turns):
    """Return the probabilities of the states of each block, given all blocks, (n, 3).

    Args:
        likelihoods: of each block in each state, float64 (n, 3), in any unit that may differ from
            block to block.
        turns: chances of the next state (column) after a state (row), float64 (3, 3). The leak is
            shut before the first block.
    """
    n = likelihoods.shape[0]
    ahead = np.empty((n, 3))
    for i in range(n):
        total = 0.0
        for s in range(3):
            come = turns[0, s]
            if i:
                come = 0.0
                for u in range(3):
                    come += ahead[i - 1, u] * turns[u, s]
            ahead[i, s] = come * likelihoods[i, s]
            total += ahead[i, s]
        for s in range(3):
            ahead[i, s] /= total
    behind = np.ones(3)
    for i in range(n - 2, -1, -1):
        before = np.zeros(3)
        total = 0.0
        for u in range(3):
            for s in range(3):
                before[u] += turns[u, s] * likelihoods[i + 1, s] * behind[s]
            total += before[u]
        for u in range(3):
            behind[u] = before[u] / total
        total = 0.0
        for s in range(3):
            ahead[i, s] *= behind[s]
            total += ahead[i, s]
        for s in range(3):
            ahead[i, s] /= total
    return ahead


def compile_openings() -> None:
    """Compile what tells when a leak was open, which would else be compiled at the first claim."""
    smoothed(np.ones((1, 3)), TURNS)


def openings_in(
    blocks: KeptBlocks, leak: int, coefficient: float, mean: Array, least: float, allowed: float
) -> Openings:
    """Return when a leak was open.

    Args:
        blocks: at least one block.
        leak: index into `LEAKS`.
        coefficient: the leak's coefficient to begin with, SI, above 0.
        mean: the nuisances to begin with, float64 (n,), in the units of the blocks' columns.
        least: least noise variance, in units of the expected noise.
        allowed: factor on what is allowed for errors of the model, for noise that lasts.
    """
    shape = blocks.leak(leak)
    variance, spread = 1.0, 0.05 * coefficient
    parts = np.zeros(blocks.count)
    states = np.zeros((blocks.count, 3))
    for _ in range(_ROUNDS):
        residual = blocks.missing - blocks.nuisances @ mean
        likelihoods = _likelihoods(residual, shape, coefficient, spread, variance)
        states = smoothed(likelihoods, TURNS)
        parts = states[:, OPEN] + states[:, CHANGING] * _part(residual, shape, coefficient)
        mean, fitted, error = _regression(blocks, shape, parts, variance, least)
        left = blocks.missing - blocks.nuisances @ mean - (parts * fitted)[:, None] * shape
        count = left.size - NUISANCE_COUNT
        total = NOISE_WEIGHT + float((left**2).sum())
        variance = max(total / (NOISE_WEIGHT + max(count, 0)), least)
        coefficient = max(fitted, 0.3 * coefficient)
        spread = 0.05 * coefficient
    lasting = lasting_noise(left, allowed)
    sizes = blocks.sizes(leak)
    present = float(parts.sum())
    size = float((parts * sizes).sum()) / present if present > 0.0 else float(sizes.mean())
    residual = blocks.missing - blocks.nuisances @ mean
    episodes = _episodes(blocks, states, parts, residual, shape, sizes)
    return Openings(episodes, parts, coefficient, sqrt(error * variance * lasting), size)


def _likelihoods(
    residual: Array, shape: Array, coefficient: float, spread: float, variance: float
) -> Array:
    """Return the likelihood of each block in each state, (n, 3), the greatest of a block being 1.

    Residuals have Student's distribution with 8 degrees of freedom, so that no single block that
    neither state explains decides by itself.
    """
    logs = np.empty((residual.shape[0], 3))
    for state, part, wide in (
        (SHUT, 0.0, 0.0),
        (CHANGING, 0.5, coefficient**2 / 12.0 + 0.25 * spread**2),
        (OPEN, 1.0, spread**2),
    ):
        left = residual - part * coefficient * shape
        stretched = variance + wide * (shape**2).sum(axis=1)
        along = (left * shape).sum(axis=1)
        # (v + w s s')^-1 by the matrix inversion lemma.
        squares = (left**2).sum(axis=1) - wide / stretched * along**2
        determinant = variance * stretched
        logs[:, state] = -0.5 * np.log(determinant) - 0.5 * (NOISE_WEIGHT + 2.0) * np.log1p(
            squares / variance / NOISE_WEIGHT
        )
    return np.asarray(np.exp(np.maximum(logs - logs.max(axis=1, keepdims=True), -200.0)))


def _part(residual: Array, shape: Array, coefficient: float) -> Array:
    """Return for what part of each block the leak was there, if it changed in it: (n,), 0 to 1."""
    whole = coefficient * (shape**2).sum(axis=1)
    along = (residual * shape).sum(axis=1)
    return np.clip(along / np.where(whole > 0.0, whole, np.inf), 0.0, 1.0)


def _regression(
    blocks: KeptBlocks, shape: Array, parts: Array, variance: float, least: float
) -> tuple[Array, float, float]:
    """Return the nuisances (n,), the coefficient, and its variance in units of the noise's."""
    n = NUISANCE_COUNT
    scale = 1.0 / max(float(np.abs(shape).max()), 1e-300)
    columns = np.concatenate([blocks.nuisances, (parts[:, None] * shape * scale)[:, :, None]], 2)
    columns = columns.reshape(-1, n + 1)
    normal = columns.T @ columns
    normal[np.arange(n), np.arange(n)] += least
    normal[n, n] += 1e-9
    inverse = np.linalg.inv(normal)
    fitted = inverse @ (columns.T @ blocks.missing.ravel())
    return fitted[:n], float(fitted[n]) * scale, float(inverse[n, n]) * scale**2


def _episodes(
    blocks: KeptBlocks, states: Array, parts: Array, residual: Array, shape: Array, sizes: Array
) -> tuple[Episode, ...]:
    """Return the openings that are sure, with a shut spell that is sure between any two."""
    shut = states[:, SHUT]
    found: list[tuple[int, int]] = []
    first: int | None = None
    for at in range(blocks.count + 1):
        is_open = at < blocks.count and shut[at] < 0.5
        if is_open and first is None:
            first = at
        if not is_open and first is not None:
            if 1.0 - shut[first:at].min() >= SURE:
                if found and shut[found[-1][1] : first].max() < SURE:
                    found[-1] = (found[-1][0], at)
                else:
                    found.append((first, at))
            first = None
    return tuple(
        _episode(blocks, slice(*each), states, parts, residual, shape, sizes) for each in found
    )


def _episode(
    blocks: KeptBlocks, at: slice, states: Array, parts: Array, residual: Array, shape: Array,
    sizes: Array,
) -> Episode:  # fmt: skip
    start_s, end_s = blocks.start_s[at], blocks.end_s[at]
    part, shape, length = parts[at], shape[at], end_s - start_s
    begun_s = float(end_s[0] - part[0] * length[0])
    gone_s: float | None = float(start_s[-1] + part[-1] * length[-1])
    if part.size == 1:
        begun_s, gone_s = float(start_s[0]), float(start_s[0] + part[0] * length[0])
    if at.stop == blocks.count and states[-1, OPEN] >= 0.5:
        gone_s = None
    power = float((part[:, None] ** 2 * shape**2).sum())
    along = float((part[:, None] * shape * residual[at]).sum())
    size = float((part * sizes[at]).sum() / max(float(part.sum()), 1e-12))
    return Episode(begun_s, gone_s, max(along / power, 0.0) * size if power > 0.0 else 0.0)


def duty_of(
    episodes: tuple[Episode, ...], watched_s: float, open_s: float, now_s: float
) -> tuple[float, tuple[float, float]]:
    """Return the share of time open, and its 95 % interval from how the cycles scatter.

    A cycle is from one opening to the next. Where cycles are independent, the share's variance is
    that of a ratio of sums (Cochran 1977, Sampling Techniques, section 6.4); the quantile is
    Student's with the cycles less one degrees of freedom. Each edge adds `_EDGE_S`.

    Args:
        episodes: two or more openings.
        watched_s: time from the first opening up to now that blocks cover, s, above 0.
        open_s: time of it in which the leak was open, s.
        now_s: the present time, s.
    """
    duty = min(open_s / watched_s, 1.0)
    starts = np.array([each.start_s for each in episodes])
    lasted = np.array([(now_s if e.end_s is None else e.end_s) - e.start_s for e in episodes])
    cycles = np.diff(starts)
    n = cycles.size
    if n < 2:
        return duty, (0.0, 1.0)
    scatter = lasted[:-1] - lasted[:-1].sum() / cycles.sum() * cycles
    of_cycles = sqrt(n / (n - 1) * float((scatter**2).sum())) / float(cycles.sum())
    of_edges = sqrt(2.0 * len(episodes)) * _EDGE_S / watched_s
    half = student_quantile(0.025, n - 1) * sqrt(of_cycles**2 + of_edges**2)
    return duty, (max(duty - half, 0.0), min(duty + half, 1.0))
