"""The noise that was learnt of one rig, by regime, with dead zones and the limit of the test."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import MODEL_NOISE, AccountBlock, sensor_noise, spool_flow
from rig.plant import LITRE_PER_MINUTE, Parameters

from .regimes import NEAR_STOP, regime_of
from .tail import Tail

Array = NDArray[np.float64]

LEAST_REGIME_S: Final = 30.0
"""Least time in a regime, s, from which its noise is learnt: 60 blocks, whose 120 values tell a
standard deviation to 7 % if they are independent, and to some 15 % if they are correlated."""
MOST_LASTING: Final = 0.99
"""Greatest correlation from block to block. A mean then has 199 times the variance that independent
blocks would give it: more than if one error stayed for a standstill of a minute and a half."""
FULL: Final = 1.0
"""Factor on the default's allowance in a regime that was not learnt: all of it."""


@dataclass(frozen=True)
class RegimeNoise:
    """Noise of the accounts in one regime beyond that of the sensors.

    Attributes:
        seconds: time in the regime that it was learnt from.
        factor: standard deviation of a block's error, as a part of what the default allows for
            errors of the model (0.01 L/min and the block's own doubts).
        chambers: correlation of the errors of both chambers, -1 to 1.
        lasting: correlation from block to block, 0 to `MOST_LASTING`, of noise whose means are as
            uncertain as those of this regime's.
    """

    seconds: float
    factor: float
    chambers: float
    lasting: float


@dataclass(frozen=True)
class LearntNoise:
    """What healthy hours of one rig tell the test for leaks.

    Attributes:
        regimes: noise by regime, for regimes that lasted for `LEAST_REGIME_S` or more.
        dead_zone: flow in L/min that each of `FAULTS` must exceed to be claimed, (5,).
        tail: how often, and how far, the statistic of the test exceeded a low limit.
        spool_correction: part of the mean departure of the spool's readings from the filter's
            estimates by which the accounts are corrected, 0 to 1. The filter's estimate follows the
            command in part; a spool that does not follow it quite, such as one with play, is where
            its readings say.
    """

    regimes: Mapping[str, RegimeNoise]
    dead_zone: tuple[float, ...]
    tail: Tail
    spool_correction: float = 0.0

    @property
    def factor(self) -> float:
        """Return the mean factor of the regimes by time (root of the mean square), at most 1."""
        total = sum(noise.seconds for noise in self.regimes.values())
        if not total:
            return FULL
        square = sum(noise.seconds * noise.factor**2 for noise in self.regimes.values())
        return float(min(np.sqrt(square / total), FULL))

    def is_tested(self, block: AccountBlock, parameters: Parameters) -> bool:
        """Return whether a block may be tested: not if the ram may touch a stroke end.

        A valve that presses the ram on its stop is wide open at no pressure drop, where the model
        knows nothing of its flow.
        """
        return regime_of(block, parameters) != NEAR_STOP

    def knows(self, block: AccountBlock, parameters: Parameters) -> bool:
        """Return whether noise like that of a block was learnt: its regime, with a spool reading.

        Where accounts are corrected by the spool's readings, nothing is known of one without.
        """
        if self.spool_correction > 0.0 and np.isnan(block.spool_departure):
            return False
        return regime_of(block, parameters) in self.regimes

    def corrected(self, block: AccountBlock) -> AccountBlock:
        """Return a block with its missing flow corrected by the spool's readings."""
        if self.spool_correction == 0.0:
            return block
        return replace(block, missing=block.missing - self.spool_correction * spool_flow(block))

    def whitening(self, block: AccountBlock, parameters: Parameters) -> Array:
        """Return the matrix that scales a block's expected noise to independent unit variances.

        Noise that lasts counts with the variance of its long means, (1 + r) / (1 - r) times that of
        a block (Priestley 1981, section 5.3.2).

        Returns:
            float64 (2, 2), s/m^3, to be multiplied from the left with missing flows and signatures.
        """
        noise = self.regimes.get(regime_of(block, parameters))
        covariance = sensor_noise(block, self.spool_correction) + model_noise(block, noise)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def model_noise(block: AccountBlock, noise: RegimeNoise | None) -> Array:
    """Return the covariance (2, 2), (m^3/s)^2, that errors of the model are expected to make.

    Without noise of its regime, it is that of the default.
    """
    scale = np.hypot(MODEL_NOISE * LITRE_PER_MINUTE, block.doubts)
    if noise is None:
        return np.diag((FULL * scale) ** 2)
    square = noise.factor**2 * (1.0 + noise.lasting) / (1.0 - noise.lasting)
    shared = np.array([[1.0, noise.chambers], [noise.chambers, 1.0]])
    return np.asarray(square * shared * np.outer(scale, scale))
