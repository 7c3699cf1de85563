"""Measures the noise of each regime from what the nuisances leave of a healthy rig's accounts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import BLOCK_S, MODEL_NOISE, AccountBlock, sensor_noise
from rig.plant import LITRE_PER_MINUTE

from .noise import LEAST_REGIME_S, MOST_LASTING, LearntNoise, RegimeNoise
from .regimes import NEAR_STOP, REGIMES, STANDSTILL
from .tail import RegimePeaks, Tail

Array = NDArray[np.float64]

LEAST_FACTOR: Final = 0.06
"""Least factor of a regime: what drawn rigs within the default's tolerances were found to need
(decision 20). A rig that shows less in an hour may still show it later."""
CAREFUL_WEIGHT: Final = 1.0
"""Number of independent blocks that the default's allowance counts as: the least that leaves a rig
of which next to nothing was seen with the default."""
LAP_CHAMBERS: Final = -0.9
"""Correlation of the chambers' errors that is expected at a standstill. What a lapped edge lets
into one chamber too much, the opposite one lets out of the other. On rigs of another maker whose
difference of both errors was large, their sum was a tenth to a quarter of it, and a quarter makes
-(1 - 1/16) / (1 + 1/16) = -0.9."""
_MOST_CHAMBERS: Final = 0.95
_MOST_FADING: Final = 0.9
"""Greatest correlation from one block to the next that counts as noise that fades. What fades more
slowly stays for a stretch."""


@dataclass(frozen=True)
class Residuals:
    """Accounts of one recording with what the nuisances leave of them.

    Attributes:
        blocks: complete blocks in order.
        regimes: regime of each of them.
        left: float64 (blocks, 2), missing flow that the nuisances do not explain, m^3/s.
        spool_correction: by which the accounts were corrected (`LearntNoise`).
    """

    blocks: Sequence[AccountBlock]
    regimes: Sequence[str]
    left: Array
    spool_correction: float = 0.0


def measured_noise(recordings: Sequence[Residuals], counted: float = 1.0) -> dict[str, RegimeNoise]:
    """Return the noise of each regime that lasts for `LEAST_REGIME_S` or more, all but near stops.

    Variances are those of the residuals less the sensors' own, in parts of the default's allowance,
    drawn towards that allowance as far as the stretches of the regime are few (`careful`). The
    correlation from block to block is the larger of two: that of the residuals, the sensors' noise
    included, with one standard error added; and what makes the mean of a stretch as uncertain as an
    error that stays for a whole stretch does (`_Stretches`).

    Args:
        recordings: what the nuisances leave of each recording.
        counted: part of the blocks that count where few blocks are reason for care.
    """
    found = {}
    for regime in REGIMES:
        if regime == NEAR_STOP:
            continue
        noise = _noise_of(regime, recordings, counted)
        if noise is not None:
            found[regime] = noise
    return found


class _Stretches:
    """Sums over stretches, in each of which a rig stays in one regime for some blocks.

    An error may stay for a whole stretch, as where a held ram leaves the spool within a lap. With
    x_a the errors of the m blocks of a stretch, in parts of the default's allowance, what two
    blocks of one stretch share has the variance

        s = sum over stretches ((sum x_a)^2 - sum x_a^2) / sum over stretches m (m - 1)

    which is that between groups in a random-effects model (Searle, Casella and McCulloch 1992,
    Variance Components, ch. 3), without a bias for their number.
    """

    def __init__(self) -> None:
        self._lengths: list[int] = []
        self._shared = self._power = 0.0
        self._total = np.zeros(2)
        self._squares = 0.0
        self._length = 0

    def add(self, scaled: Array) -> None:
        """Add the residuals (2,) of a block to the stretch that runs."""
        self._total += scaled
        self._squares += float(scaled @ scaled)
        self._length += 1

    def end(self) -> None:
        """End the stretch that runs, if there is one."""
        if self._length:
            self._lengths.append(self._length)
            self._shared += float(self._total @ self._total) - self._squares
            self._power += self._squares
            self._total, self._squares, self._length = np.zeros(2), 0.0, 0

    def shared(self) -> float:
        """Return the variance that the blocks of a stretch share, 0 or more, for one chamber."""
        pairs = sum(m * (m - 1) for m in self._lengths)
        return max(0.5 * self._shared / pairs, 0.0) if pairs else 0.0

    def total(self) -> float:
        """Return the variance of all blocks, the sensors' noise included, for one chamber."""
        return 0.5 * self._power / max(sum(self._lengths), 1)

    def length(self) -> float:
        """Return the number of blocks of the stretch in which a block is on average."""
        return sum(m * m for m in self._lengths) / max(sum(self._lengths), 1)

    def independent(self, part: float) -> float:
        """Return how many independent blocks the variance was found from.

        Args:
            part: part of the variance that the blocks of a stretch share, 0 to 1.
        """
        return sum(m / (1.0 + (m - 1) * part) for m in self._lengths)


def _noise_of(regime: str, recordings: Sequence[Residuals], counted: float) -> RegimeNoise | None:
    squares: list[Array] = []
    products: list[float] = []
    stretches = _Stretches()
    lagged = power = 0.0
    seconds = 0.0
    for recording in recordings:
        before: Array | None = None
        stretches.end()
        for block, name, left in zip(
            recording.blocks, recording.regimes, recording.left, strict=True
        ):
            if name != regime:
                before = None
                stretches.end()
                continue
            scale = np.hypot(MODEL_NOISE * LITRE_PER_MINUTE, block.doubts)
            own = sensor_noise(block, recording.spool_correction)
            squares.append((left**2 - np.diag(own)) / scale**2)
            products.append(float((left[0] * left[1] - own[0, 1]) / (scale[0] * scale[1])))
            scaled = left / scale
            stretches.add(scaled)
            if before is not None:
                lagged += float(scaled @ before)
                power += 0.5 * float(scaled @ scaled + before @ before)
            before = scaled
            seconds += block.end_s - block.start_s
    stretches.end()
    if seconds < LEAST_REGIME_S:
        return None
    variance = max(float(np.mean(squares)), LEAST_FACTOR**2)
    shared = min(stretches.shared(), variance)
    part, expected = shared / max(variance, stretches.total()), 0.0
    if regime == STANDSTILL:
        # Nothing changes while a ram stands: its stretch is one value, also if none stood out yet.
        part, expected = 1.0, LAP_CHAMBERS
    independent = counted * stretches.independent(part)
    expected_variance = careful(variance, independent)
    if regime == STANDSTILL:
        shared = careful(shared, independent)
    lasting = lagged / power if power > 0.0 else 0.0
    lasting = min(lasting + float(1.0 / np.sqrt(2.0 * counted * seconds / BLOCK_S)), _MOST_FADING)
    lasting = max(
        lasting, _as_lasting(1.0 + (stretches.length() - 1.0) * shared / expected_variance)
    )
    weighed = independent * float(np.mean(products)) + CAREFUL_WEIGHT * expected
    chambers = weighed / (independent + CAREFUL_WEIGHT) / expected_variance
    return RegimeNoise(
        seconds,
        float(np.sqrt(expected_variance)),
        float(np.clip(chambers, -_MOST_CHAMBERS, _MOST_CHAMBERS)),
        float(np.clip(lasting, 0.0, MOST_LASTING)),
    )


def careful(variance: float, independent: float) -> float:
    """Return a variance in parts of the default's, given how many independent blocks it is from.

    It is the mean of its posterior with a conjugate prior, whose mean is the default's allowance
    (1) and whose weight is `CAREFUL_WEIGHT` blocks: two stretches at rest, each with an error of
    its own, tell little of the next one's.
    """
    return (independent * variance + CAREFUL_WEIGHT) / (independent + CAREFUL_WEIGHT)


def _as_lasting(factor: float) -> float:
    """Return the correlation r from block to block by which (1 + r) / (1 - r) is a factor."""
    return (factor - 1.0) / (factor + 1.0)


def joined(earlier: LearntNoise, later: LearntNoise) -> LearntNoise:
    """Return the noise of two spans of time: each regime's by time, and the peaks of both.

    The peaks must be over the same limit. They stay apart by regime if they are so in both. The
    dead zones and the spool's correction are those of `earlier`, by which the later accounts were
    corrected as well.
    """
    regimes = dict(earlier.regimes)
    for name, new in later.regimes.items():
        old = regimes.get(name)
        regimes[name] = new if old is None else _mean(old, new)
    tail = Tail(
        earlier.tail.base,
        earlier.tail.hours + later.tail.hours,
        earlier.tail.peaks + later.tail.peaks,
        earlier.tail.excess + later.tail.excess,
        _joined_peaks(earlier.tail, later.tail),
    )
    return LearntNoise(regimes, earlier.dead_zone, tail, earlier.spool_correction)


def _joined_peaks(earlier: Tail, later: Tail) -> tuple[RegimePeaks, ...]:
    if not earlier.regimes or not later.regimes:
        return ()
    found = {each.regime: each for each in earlier.regimes}
    for new in later.regimes:
        old = found.get(new.regime, RegimePeaks(new.regime, 0.0, 0))
        found[new.regime] = RegimePeaks(new.regime, old.hours + new.hours, old.peaks + new.peaks)
    return tuple(found.values())


def _mean(old: RegimeNoise, new: RegimeNoise) -> RegimeNoise:
    seconds = old.seconds + new.seconds
    part = new.seconds / seconds
    return RegimeNoise(
        seconds,
        float(np.sqrt((1.0 - part) * old.factor**2 + part * new.factor**2)),
        (1.0 - part) * old.chambers + part * new.chambers,
        (1.0 - part) * old.lasting + part * new.lasting,
    )
