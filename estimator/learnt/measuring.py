"""Measures the noise of each regime from what the nuisances leave of a healthy rig's accounts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import BLOCK_S, MODEL_NOISE, AccountBlock, sensor_noise
from rig.plant import LITRE_PER_MINUTE

from .noise import LEAST_REGIME_S, LearntNoise, RegimeNoise
from .regimes import NEAR_STOP, REGIMES
from .tail import Tail

Array = NDArray[np.float64]

LEAST_FACTOR: Final = 0.06
"""Least factor of a regime: what drawn rigs within the default's tolerances were found to need
(decision 20). A rig that shows less in an hour may still show it later."""
_MOST_CHAMBERS: Final = 0.95
_MOST_LASTING: Final = 0.9


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


def measured_noise(recordings: Sequence[Residuals]) -> dict[str, RegimeNoise]:
    """Return the noise of each regime that lasts for `LEAST_REGIME_S` or more, all but near stops.

    Variances are those of the residuals less the sensors' own, in parts of the default's allowance.
    The correlation from block to block is that of the residuals, the sensors' noise included, with
    one standard error added.
    """
    found = {}
    for regime in REGIMES:
        if regime == NEAR_STOP:
            continue
        noise = _noise_of(regime, recordings)
        if noise is not None:
            found[regime] = noise
    return found


def _noise_of(regime: str, recordings: Sequence[Residuals]) -> RegimeNoise | None:
    squares: list[Array] = []
    products: list[float] = []
    lagged = power = 0.0
    seconds = 0.0
    for recording in recordings:
        before: Array | None = None
        for block, name, left in zip(
            recording.blocks, recording.regimes, recording.left, strict=True
        ):
            if name != regime:
                before = None
                continue
            scale = np.hypot(MODEL_NOISE * LITRE_PER_MINUTE, block.doubts)
            own = sensor_noise(block, recording.spool_correction)
            squares.append((left**2 - np.diag(own)) / scale**2)
            products.append(float((left[0] * left[1] - own[0, 1]) / (scale[0] * scale[1])))
            scaled = left / scale
            if before is not None:
                lagged += float(scaled @ before)
                power += 0.5 * float(scaled @ scaled + before @ before)
            before = scaled
            seconds += block.end_s - block.start_s
    if seconds < LEAST_REGIME_S:
        return None
    variance = max(float(np.mean(squares)), LEAST_FACTOR**2)
    shared = float(np.clip(np.mean(products) / variance, -_MOST_CHAMBERS, _MOST_CHAMBERS))
    lasting = lagged / power if power > 0.0 else 0.0
    lasting += float(1.0 / np.sqrt(2.0 * seconds / BLOCK_S))
    return RegimeNoise(
        seconds, float(np.sqrt(variance)), shared, float(np.clip(lasting, 0.0, _MOST_LASTING))
    )


def joined(earlier: LearntNoise, later: LearntNoise) -> LearntNoise:
    """Return the noise of two spans of time: each regime's by time, and the peaks of both.

    The peaks must be over the same limit. The dead zones and the spool's correction are those of
    `earlier`, by which the later accounts were corrected as well.
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
    )
    return LearntNoise(regimes, earlier.dead_zone, tail, earlier.spool_correction)


def _mean(old: RegimeNoise, new: RegimeNoise) -> RegimeNoise:
    seconds = old.seconds + new.seconds
    part = new.seconds / seconds
    return RegimeNoise(
        seconds,
        float(np.sqrt((1.0 - part) * old.factor**2 + part * new.factor**2)),
        (1.0 - part) * old.chambers + part * new.chambers,
        (1.0 - part) * old.lasting + part * new.lasting,
    )
