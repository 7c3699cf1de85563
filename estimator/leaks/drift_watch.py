"""What a drift of the encoder makes of a decision: it is named, or named beside other faults."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import AccountBlock
from estimator.encoder import DriftTest

from .confirmation import Hold
from .decision import ENCODER_DRIFT, Decision
from .fault_scores import RIVAL_GAIN
from .finding import Finding


class DriftWatch:
    """Looks for a drift of the encoder, and brings it into the decision on other faults.

    Args:
        new_test: makes a test for a drift, without any block yet.
    """

    def __init__(self, new_test: Callable[[], DriftTest]) -> None:
        self._new_test = new_test
        self._test = new_test()
        self._hold = Hold()
        self._alarm: Decision | None = None

    def begin_anew(self) -> None:
        """Drop all blocks so far; a confirmed drift stays on record."""
        self._test = self._new_test()

    def see(self, position: NDArray[np.float64]) -> None:
        """Take the newest readings of the encoder, m; NaN where there is none."""
        self._test.see(position)

    def add(self, block: AccountBlock) -> None:
        """Take a block of the oil account."""
        self._test.add(block)

    @property
    def stands_out(self) -> bool:
        """Return whether a drift stands out from the accounts, or was confirmed before."""
        return self._alarm is not None or self._test.search() is not None

    def beside(self, decision: Decision, time_s: float, claimed: Sequence[Finding]) -> Decision:
        """Return the decision on all faults, the drift among them.

        A drift is named if nothing else explains the accounts as well. While something else does,
        the verdict on the other fault stands, or is `inconclusive` if there is none, and the drift
        stands beside it (`Decision.could_also_be`). A drift that was named for 5 s is confirmed
        and stays the verdict, unless a fault with a greater statistic is found later.

        Args:
            decision: the decision on all other faults.
            time_s: time of the newest sample, s.
            claimed: the faults that stay which that decision rests on; may be empty.
        """
        found = self._test.search()
        if found is not None and decision.returns is None:
            others = sum(finding.likelihood for finding in claimed)
            if found.is_sure and found.gain > others + RIVAL_GAIN:
                named = Decision(
                    ENCODER_DRIFT,
                    found.onset_s,
                    statistic=found.statistic,
                    threshold=found.limit,
                    details=decision.details,
                    drift=found,
                )
                if self._hold.found(time_s):
                    self._alarm = named
                return named
            if decision.verdict in found.could_also_be:
                decision = replace(decision, drift=found)
            elif not decision.names_a_fault and not found.is_sure:
                decision = replace(decision, verdict="inconclusive", drift=found)
        alarm = self._alarm
        if alarm is None or (decision.names_a_fault and decision.statistic > alarm.statistic):
            return decision
        return alarm
