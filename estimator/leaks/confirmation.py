"""Which leaks are confirmed to be there now, as findings come and go from block to block."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Final

from rig.plant import FAULTS, LEAKS

from .finding import Finding
from .leak_verdicts import LeakVerdicts

CONFIRMED_AFTER_S: Final = 5.0
"""What is found is confirmed once it was held for that long; it is withdrawn if it passes before
that, and does not come back for as long."""
_LIKELIER_THAN_NOT: Final = 0.5


class Hold:
    """How long something has been found, pauses of up to `CONFIRMED_AFTER_S` aside."""

    def __init__(self) -> None:
        self._found_s = self._since_s = -inf

    def found(self, time_s: float) -> bool:
        """Note that it is found now; return whether that confirms it."""
        if time_s - self._found_s > CONFIRMED_AFTER_S:
            self._since_s = time_s
        self._found_s = time_s
        return time_s - self._since_s >= CONFIRMED_AFTER_S

    def lapsed(self, time_s: float) -> bool:
        """Return whether it was not found for so long that it counts as withdrawn."""
        return time_s - self._found_s > CONFIRMED_AFTER_S


class PresentLeaks:
    """The leaks confirmed to be there now.

    A leak that is not found any more has not gone for that. A chamber that runs dry has no account,
    and a single block that stands out can hide a leak for seconds. It has gone when the accounts
    show its end, or when they are likelier to be those of a healthy rig or of another fault.

    Args:
        verdicts: of the test that makes all findings.
    """

    def __init__(self, verdicts: LeakVerdicts) -> None:
        self._verdicts = verdicts
        self._holds = [Hold() for _ in LEAKS]
        self._confirmed: dict[int, Finding] = {}
        self._ended: set[int] = set()
        self._ended_s = inf

    def update(
        self, time_s: float, findings: Sequence[Finding], probabilities: Mapping[str, float]
    ) -> tuple[float, float, float]:
        """Return the coefficients of the leaks that are there, in the order of `FAULTS`, SI.

        Args:
            time_s: of the newest sample.
            findings: what is found now.
            probabilities: as of `estimator.leaks.detection.Decision`.
        """
        found = {finding.fault: finding for finding in findings if finding.fault < len(LEAKS)}
        for leak, finding in found.items():
            # What seems to have begun before leaks ended would explain those anew.
            other = self._ended and leak not in self._ended and finding.onset_s < self._ended_s
            if self._holds[leak].found(time_s) and not other:
                self._confirmed[leak] = finding
        healthy = probabilities.get("healthy", 0.0) > _LIKELIER_THAN_NOT
        present = [0.0, 0.0, 0.0]
        for leak, finding in list(self._confirmed.items()):
            likely = probabilities.get(FAULTS[leak], 0.0) + probabilities.get("multiple", 0.0)
            told = leak in found or likely > _LIKELIER_THAN_NOT
            present[leak] = self._verdicts.present(finding) if told else 0.0
            if present[leak] == 0.0:
                del self._confirmed[leak]
                if told or healthy:
                    self._ended.add(leak)
        if any(present):
            self._ended.clear()
            self._ended_s = inf
        elif self._ended:
            self._ended_s = min(self._ended_s, time_s)
        return present[0], present[1], present[2]

    def ended(self, time_s: float) -> bool:
        """Return whether leaks that were confirmed have ended, and that for as long again."""
        return time_s - self._ended_s >= CONFIRMED_AFTER_S
