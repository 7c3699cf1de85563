"""The confirmation of leaks: which leaks are present now, though findings come and go by block."""

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Final

from rig.plant import FAULTS, LEAKS

from .finding import Finding

CONFIRMED_AFTER_S: Final = 5.0
"""Seconds for which a fault must have been found until it is confirmed.

Pauses of up to the same length do not interrupt this. A fault that was not confirmed is withdrawn
after a longer pause."""
_LIKELIER_THAN_NOT: Final = 0.5


class Hold:
    """Measures for how long a fault has been found; short pauses do not interrupt it.

    A pause is short if it lasts up to `CONFIRMED_AFTER_S`.
    """

    def __init__(self) -> None:
        self._found_s = self._since_s = -inf

    def found(self, time_s: float) -> bool:
        """Note that the fault is found at `time_s` (s); return whether that confirms it.

        It is confirmed once `CONFIRMED_AFTER_S` or more lie between its first finding and this one.
        After a pause of more than `CONFIRMED_AFTER_S` this finding counts as the first again.
        """
        if time_s - self._found_s > CONFIRMED_AFTER_S:
            self._since_s = time_s
        self._found_s = time_s
        return time_s - self._since_s >= CONFIRMED_AFTER_S

    def lapsed(self, time_s: float) -> bool:
        """Return whether the fault was last found more than `CONFIRMED_AFTER_S` before `time_s`.

        It is True if the fault was never found.
        """
        return time_s - self._found_s > CONFIRMED_AFTER_S


class PresentLeaks:
    """Keeps the leaks that are confirmed to be present now.

    A leak that is no longer found may still be present: a chamber that runs dry has no account, and
    a single unusual block can hide a leak for seconds. A confirmed leak therefore stays until the
    accounts show its end, or fit a healthy rig or another fault better.

    Args:
        left: returns the coefficient that a leak has now, 0 if it has ended
            (`leak_verdicts.present_coefficient` of the test that makes all findings).
    """

    def __init__(self, left: Callable[[Finding], float]) -> None:
        self._left = left
        self._holds = [Hold() for _ in LEAKS]
        self._confirmed: dict[int, Finding] = {}
        self._ended: set[int] = set()
        self._ended_s = inf

    def update(
        self, time_s: float, findings: Sequence[Finding], probabilities: Mapping[str, float]
    ) -> tuple[float, float, float]:
        """Take the newest findings; return the coefficients of the leaks that are there.

        A leak is there from its confirmation until it has ended.

        Args:
            time_s: time of the newest sample, s.
            findings: what the newest search over all blocks finds, which replaces what earlier ones
                found; faults that are no leaks do not count.
            probabilities: of `healthy`, of each fault alone and of `multiple`, by these names, as
                in `estimator.leaks.detection.Decision`; may be empty.

        Returns:
            A coefficient for each leak in the order of `LEAKS`, m^3/(s Pa^0.5); 0 for one that is
            not confirmed yet, or has ended.
        """
        found = {finding.fault: finding for finding in findings if finding.fault < len(LEAKS)}
        for leak, finding in found.items():
            # A finding that seems to begin before other leaks ended may be those leaks again.
            other = self._ended and leak not in self._ended and finding.onset_s < self._ended_s
            if self._holds[leak].found(time_s) and not other:
                self._confirmed[leak] = finding
        healthy = probabilities.get("healthy", 0.0) > _LIKELIER_THAN_NOT
        present = [0.0, 0.0, 0.0]
        for leak, finding in list(self._confirmed.items()):
            likely = probabilities.get(FAULTS[leak], 0.0) + probabilities.get("multiple", 0.0)
            supported = leak in found or likely > _LIKELIER_THAN_NOT
            present[leak] = self._left(finding) if supported else 0.0
            if present[leak] == 0.0:
                del self._confirmed[leak]
                if supported or healthy:
                    self._ended.add(leak)
        if any(present):
            self._ended.clear()
            self._ended_s = inf
        elif self._ended:
            self._ended_s = min(self._ended_s, time_s)
        return present[0], present[1], present[2]

    def ended(self, time_s: float) -> bool:
        """Return whether all confirmed leaks have been gone for `CONFIRMED_AFTER_S` at `time_s`.

        The time counts from the `update` that first left none of them. It is False if no confirmed
        leak has ended, or if one is still present.
        """
        return time_s - self._ended_s >= CONFIRMED_AFTER_S
