"""Feeds a detector with the same blocks as a replay does, so that both decide exactly alike."""

from typing import Final

import numpy as np

from estimator.evidence import KeptAccounts
from estimator.filters import FilterMemory
from estimator.leaks import Decision, Detector, Found, Samples, first_held, found_in
from rig.loop import batch_ticks, estimates_in
from rig.runner.outcomes import Array

_SAMPLED: Final = (
    "time_s",
    "command_V",
    "position_m",
    "pressure_1_Pa",
    "pressure_2_Pa",
    "spool_m",
    "supply_pressure_Pa",
)
"""Channels in the order of `Samples`."""


class Judge:
    """Collects a test's rows into blocks of half a second, and lets the detector judge each block.

    The first block has one tick more.

    Args:
        detector: the detector, which is given every sample once, in order.
        memory: memory of the filter whose estimates are in the rows.
        channels: names of the rows' columns.
        kept: is told of each decision, for the report; None if nothing is kept.

    Attributes:
        ticks_due: number of ticks that the present block still lacks.
        history: the detector's decision after each block, with the time of its last row in s.
    """

    def __init__(
        self,
        detector: Detector,
        memory: FilterMemory,
        channels: tuple[str, ...],
        kept: KeptAccounts | None = None,
    ) -> None:
        self.history: list[tuple[float, Decision]] = []
        self._detector = detector
        self._memory = memory
        self._kept = kept
        self._channels = channels
        self._sampled = [channels.index(name) for name in _SAMPLED]
        self._rows: list[Array] = []
        self.ticks_due = batch_ticks(first=True)

    @property
    def decision(self) -> Decision | None:
        """The detector's latest decision; None before it has judged the first block."""
        return self.history[-1][1] if self.history else None

    @property
    def detected_at_s(self) -> float | None:
        """Time of the first decision that had the latest verdict, s.

        Other verdicts may have come in between. The time is None if the latest verdict names no
        fault, or if there is no decision yet.
        """
        return first_held(self.history) if self.history else None

    @property
    def found(self) -> tuple[Found, ...]:
        """All faults that the verdicts have named so far, also those that have ended since."""
        return found_in(self.history)

    def take(self, rows: Array) -> bool:
        """Add rows, and judge the block if they complete it; return whether they did.

        Args:
            rows: float64 (n, channels), with n at most `ticks_due`.
        """
        self._rows.append(rows)
        self.ticks_due -= len(rows)
        if self.ticks_due:
            return False
        self.finish()
        return True

    def finish(self) -> None:
        """Let the detector judge the rows since the last block, if any, and keep its decision.

        Raises:
            TypeError: the detector returned something else than a decision.
        """
        if self._rows:
            rows = self._rows[0] if len(self._rows) == 1 else np.concatenate(self._rows)
            samples = Samples(*(np.ascontiguousarray(rows[:, i]) for i in self._sampled))
            self._detector.update(samples, estimates_in(rows, self._channels, self._memory))
            decision = self._detector.decide()
            if not isinstance(decision, Decision):
                raise TypeError(
                    f"detector {type(self._detector).__name__}: decide() returned {decision!r}; "
                    "it must return an estimator.leaks.detection.Decision"
                )
            self.history.append((float(rows[-1, 0]), decision))
            if self._kept is not None:
                self._kept.take(*self.history[-1])
        self._rows = []
        self.ticks_due = batch_ticks(first=False)
