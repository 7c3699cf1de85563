"""The test for leaks that allows for what was learnt of one rig, in place of what any rig may need.

It is that of `leak_statistic` with the noise of each block by its regime, the dead zones and the
limit of `estimator.learnt`. The accounts are corrected by the spool's readings as far as was learnt
to help. Blocks in which the ram may touch a stroke end are left out. From the first block on whose
regime was not learnt, the default's careful limit and dead zones hold.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    BLOCK_S,
    FAULT_COUNT,
    RELATIVE_DEAD_ZONE,
    AccountBlock,
    NuisanceBelief,
    dead_zones,
    noise_limit,
)
from estimator.learnt import LearntNoise, regime_of
from rig.plant import Parameters

from .fault_scores import WITNESSES
from .leak_statistic import DIRECTIONS, LEFT_OUT, MINIMUM_BLOCKS, SHARES, LeakTest

Array = NDArray[np.float64]

LASTING_PART: Final = 0.9
"""Part of the stated rate that is left to this test; the test for leaks that come and go has the
rest (decision 31)."""


class LearntLeakTest(LeakTest):
    """Tests the blocks of a rig whose noise was learnt.

    Args:
        false_alarms_per_day: alarms that all tests together may raise on a healthy rig in a day.
        expected: mean and covariance of the nuisances before any block.
        noise: what was learnt of the rig.
        parameters: the parameters that are assumed, which tell the regime of a block.

    Raises:
        ValueError: the rate is not above 0 and at most 10000.
    """

    def __init__(
        self,
        false_alarms_per_day: float,
        expected: NuisanceBelief,
        noise: LearntNoise,
        parameters: Parameters,
    ) -> None:
        super().__init__(false_alarms_per_day, expected, noise.factor)
        self._noise, self._parameters = noise, parameters
        self.dead_zone = np.array(noise.dead_zone)
        # A second fault is sized beside a first one by the same leak law as on any rig.
        self.relative_dead_zone = RELATIVE_DEAD_ZONE
        # Noise below what was learnt is chance, as below the sensors' own in an exact model.
        self._least_variance = 1.0
        # A null that shifts is among what the peaks of the statistic came from. Allowed for once
        # more, it would hide internal leaks however long they last.
        self._null_shift = 0.0
        self._careful = False
        self._regime: str | None = None

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        """Return the value of the statistic that this rig exceeds at the stated rate while healthy.

        It is that of the learnt tail for the regime of the last block. The noise by which blocks
        are weighed is learnt with care, so that the statistic of a healthy rig goes less far than
        noise would: the limit may be below that for noise alone (`noise_limit`), and that hours of
        a rig differ brings it no higher. With a baseline of an earlier version (`Tail.regimes`) it
        is not below.

        Args:
            freedom: degrees of freedom of the estimated noise variance.
            part: part of the stated rate at which it may be exceeded.
        """
        if self._careful:
            return super().threshold(freedom, part)
        tail = self._noise.tail
        if not tail.regimes:
            return max(self._noise_limit(freedom, part), tail.limit(part * self._rate()))
        return tail.limit(part * self._rate(), self._regime, self._noise_limit(freedom, part))

    def limit_beside(self, freedom: float) -> float:
        """Return what the statistic of a second fault must exceed: what noise alone reaches.

        The limit was learnt from healthy hours, which say nothing of what is left beside a leak.
        """
        return max(self.threshold(freedom), self._noise_limit(freedom))

    def change_limit(self) -> float:
        """Return what the root of a change's gain must exceed: not less than noise alone reaches.

        A gain knows no dead zone, so that a limit of the statistic beyond it may be too low.
        """
        return max(self.limit(), self._noise_limit(self.candidates().regression.freedom))

    def sharpness(self) -> float:
        """Return the limit for noise alone as a multiple of the limit of this rig."""
        freedom = self.candidates().regression.freedom
        return self._noise_limit(freedom) / self.threshold(freedom)

    def _rate(self) -> float:
        """Return the alarms a day that are left to this test."""
        part = FAULT_COUNT / SHARES if self.sums.supply_measured else 1.0
        return LASTING_PART * part * self.false_alarms_per_day

    def _noise_limit(self, freedom: float, part: float = 1.0) -> float:
        most = max(self.blocks, MINIMUM_BLOCKS)
        per_block = part * self._rate() * BLOCK_S / 86400.0 / DIRECTIONS
        return noise_limit(per_block, WITNESSES, most, freedom) - LEFT_OUT

    def add(self, block: AccountBlock) -> None:
        """Add one block; an incomplete one, or one near a stroke end, is ignored."""
        if not self._noise.is_tested(block, self._parameters):
            return
        if block.complete and not self._careful and not self._noise.knows(block, self._parameters):
            self._careful = True
            self.model_error = self._null_shift = 1.0
            self.dead_zone = np.maximum(self.dead_zone, dead_zones(1.0))
        if block.complete:
            self._regime = regime_of(block, self._parameters)
        super().add(self._noise.corrected(block))

    def _whitening(self, block: AccountBlock) -> Array:
        return self._noise.whitening(block, self._parameters)
