"""Collects the oil accounts of a test and the detector's evidence, half second by half second."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import BLOCK_S, AccountBlock
from estimator.leaks import Decision, Detector, Found, OilAccountDetector, found_in
from rig.plant import FAULTS, LEAKS

Array = NDArray[np.float64]

MOST_BLOCKS: Final = 7200
"""Greatest number of blocks (an hour) that are kept of a test while it runs, 2 kB each. A report of
a longer test collects its accounts from the recording."""


@dataclass(frozen=True)
class AccountHistory:
    """The oil accounts of a recording, and the detector's evidence from them.

    Attributes:
        start_s, end_s: begin and end of each complete block, s, float64 (n,); a block lasts half a
            second or longer.
        missing: missing flow of each chamber, less the model errors that the detector found, m^3/s,
            float64 (n, 2).
        explained: the part of it that the leaks which were found explain, m^3/s, float64 (n, 2).
        decided_s: times at which the detector decided, every half second, s, float64 (m,).
        statistic: test statistic of the likeliest fault at those times, float64 (m,); 0 if there is
            no evidence for any.
        threshold: the value that the statistic must exceed, float64 (m,); the detector finds a
            fault where it does.
        smallest: `details` of the detector's last decision before the first fault began, among
            them the smallest leaks that would have been found; empty if there was no such decision.
    """

    start_s: Array
    end_s: Array
    missing: Array
    explained: Array
    decided_s: Array
    statistic: Array
    threshold: Array
    smallest: Mapping[str, float]


class CollectedAccounts:
    """The accounts of one test, and the evidence from them, up to the detector's last decision.

    Args:
        detector: the detector; it must have decided nothing yet.
    """

    def __init__(self, detector: OilAccountDetector) -> None:
        self._detector = detector
        self._decided: list[tuple[float, Decision]] = []
        self._evidence: list[tuple[float, float]] = []
        self._blocks: list[tuple[int, AccountBlock]] = []
        self._errors: dict[int, tuple[bool, Array]] = {}

    @property
    def blocks(self) -> int:
        """Return how many complete blocks were collected."""
        return len(self._blocks)

    def take(self, time_s: float, decision: Decision) -> None:
        """Add what led to a decision, right after the detector has made it.

        Args:
            time_s: time of the last sample on which it rests, s.
            decision: the decision.
        """
        detector, errors = self._detector, self._errors
        self._decided.append((time_s, decision))
        self._evidence.append(detector.evidence())
        self._blocks += [(detector.begun, block) for block in detector.drawn_up if block.complete]
        # When a fault is no longer found, its flow counts as errors of the model.
        claimed = bool(detector.claimed)
        if claimed or not errors.get(detector.begun, (False,))[0]:
            errors[detector.begun] = claimed, detector.model_errors()

    def history(self) -> AccountHistory | None:
        """Return the accounts and the evidence so far; None without a complete block."""
        if not self._blocks:
            return None
        drawn_up = [block for _, block in self._blocks]
        known = [block.nuisances @ self._errors[begun][1] for begun, block in self._blocks]
        missing = np.array([block.missing for block in drawn_up]) - np.array(known)
        start_s, end_s = np.array([(block.start_s, block.end_s) for block in drawn_up]).T
        explained = _explained(drawn_up, found_in(self._decided))
        decided_s = np.array([time_s for time_s, _ in self._decided])
        evident = (decided_s, *np.array(self._evidence).T, _before_any_fault(self._decided))
        return AccountHistory(start_s, end_s, missing, explained, *evident)


class KeptAccounts:
    """The accounts of a campaign's tests as they ran, so that its report need not judge them again.

    They are lost with the process; of a test in a process before, the report collects them anew.
    """

    def __init__(self) -> None:
        self._histories: dict[str, AccountHistory] = {}
        self._present: tuple[str, CollectedAccounts] | None = None

    def begins(self, recording: str, detector: Detector) -> None:
        """Follow the detector of a test that begins; one that has no oil accounts is not followed.

        Args:
            recording: file name of the test's recording. What was kept of an earlier attempt at the
                same test is dropped.
            detector: the detector; it must have decided nothing yet.
        """
        self._end()
        self._histories.pop(recording, None)
        if isinstance(detector, OilAccountDetector):
            self._present = recording, CollectedAccounts(detector)

    def take(self, time_s: float, decision: Decision) -> None:
        """Add what led to a decision of the test that runs, as `CollectedAccounts.take` does."""
        if self._present is None:
            return
        _, collected = self._present
        collected.take(time_s, decision)
        if collected.blocks > MOST_BLOCKS:
            self._present = None

    def history(self, recording: str) -> AccountHistory | None:
        """Return what was kept of a test, by the file name of its recording; None if nothing."""
        self._end()
        return self._histories.get(recording)

    def _end(self) -> None:
        """Keep the history of the test that ran last, in place of all that it is made from."""
        if self._present is not None:
            recording, collected = self._present
            history = collected.history()
            if history is not None:
                self._histories[recording] = history
        self._present = None


def _explained(blocks: Sequence[AccountBlock], found: Sequence[Found]) -> Array:
    explained = np.zeros((len(blocks), 2))
    for each in found:
        if not each.stays:
            continue
        for leak, coefficient, onset_s, ended_s in _leaks_of(each):
            for row, block in zip(explained, blocks, strict=True):
                there_s = min(block.end_s, ended_s) - max(block.start_s, onset_s)
                part = min(max(there_s / (block.end_s - block.start_s), 0.0), 1.0)
                row += part * coefficient * block.faults[:, FAULTS.index(leak)]
    return explained


def _leaks_of(found: Found) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, coefficient, beginning and end in s of each leak in a fault that was found.

    A leak that comes and goes is yielded once for each opening; nothing is without an onset. The
    end of a leak that may be present is infinite.
    """
    decision = found.decision
    if decision.onset_s is None:
        return
    ended_s = np.inf if found.ended_s is None else found.ended_s
    if decision.returns is not None:
        for each in decision.returns.episodes:
            gone_s = np.inf if each.end_s is None else each.end_s
            yield decision.returns.leak, decision.returns.coefficient, each.start_s, gone_s
        return
    if decision.coefficient is not None and decision.verdict in LEAKS:
        yield decision.verdict, decision.coefficient, decision.onset_s, ended_s
    for leak in LEAKS:
        if (coefficient := decision.details.get(f"{leak}_coefficient")) is not None:
            yield leak, coefficient, decision.details[f"{leak}_onset_s"], ended_s


def _before_any_fault(history: Sequence[tuple[float, Decision]]) -> Mapping[str, float]:
    """Return the details of the last decision that names no fault before the first fault began.

    The first fault began at the earliest onset in any decision that names a fault; half a block is
    added, as an onset is known no better. If no decision names a fault, the details are those of
    the last one. Return {} if there is no such decision.
    """
    onsets = [d.onset_s for _, d in history if d.names_a_fault and d.onset_s is not None]
    # An onset is known to half a block.
    begun = min(onsets, default=np.inf) + 0.5 * BLOCK_S
    before = [d.details for time_s, d in history if not d.names_a_fault and time_s <= begun]
    return before[-1] if before else {}
