"""The decision of a detector: verdict, size and onset of the fault, and how sure it is."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from estimator.encoder import EncoderDrift
from estimator.intermittent import Intermittent

from .finding import Growth

SILENT: Final = ("healthy", "inconclusive")
"""Names of the verdicts that are no fault."""
ENCODER_DRIFT: Final = "encoder_drift"
"""Name of the verdict that the encoder drifts."""


@dataclass(frozen=True)
class Decision:
    """What a detector concludes from all samples that it has taken so far.

    Attributes:
        verdict: one of the names in `faults.verdict`.
        onset_s: estimated start of the fault, s; None when healthy or inconclusive.
        leak_m3_per_s: mean absolute leak flow from 2 s after the onset, all leaks added up; None
            if no leak was sized.
        leak_std_m3_per_s: standard error of that flow, errors of the model included.
        coefficient: leak coefficient, m^3/(s Pa^0.5); None if there is no leak or several faults.
        statistic, threshold: the test statistic, and the value that it exceeds on a healthy rig at
            the stated rate of false alarms.
        details: further figures by name, for reports.
        probabilities: of `healthy`, of each of `FAULTS` alone and of `multiple`, adding up to 1;
            empty while there are too few blocks, and from the thesis's detector.
        present_leaks: coefficients of the leaks that are confirmed to be present now, in the order
            of `LEAKS`, m^3/(s Pa^0.5); 0 for a leak that is not, or no longer, present.
        ended_s: when the fault ended, s, to half a second or so; None while it may be present.
        returns: the openings of a leak that comes and goes, with duty and what they go with; None
            if the verdict is of a fault that stays, or of none. The verdict's flow and coefficient
            are those while the leak is open.
        drift: a drift of the encoder that may be or, if the verdict says so, is the cause; None
            where the accounts show none.
        growth: how a single leak grows, with its flow now; None if it does not, or not provably.
    """

    verdict: str
    onset_s: float | None = None
    leak_m3_per_s: float | None = None
    leak_std_m3_per_s: float | None = None
    coefficient: float | None = None
    statistic: float = 0.0
    threshold: float = float("inf")
    details: Mapping[str, float] = field(default_factory=dict)
    probabilities: Mapping[str, float] = field(default_factory=dict)
    present_leaks: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ended_s: float | None = None
    returns: Intermittent | None = None
    drift: EncoderDrift | None = None
    growth: Growth | None = None

    @property
    def names_a_fault(self) -> bool:
        """Return whether the verdict is a fault: neither `healthy` nor `inconclusive`."""
        return self.verdict not in SILENT

    @property
    def could_also_be(self) -> tuple[str, ...]:
        """Return the causes beside the verdict that the accounts do not tell from it.

        They are names of `rig.plant.FAULTS`, `encoder_drift` and `null_shift`, a shift of the
        spool's null. If the verdict is inconclusive, it is one of these.
        """
        if self.drift is None or self.verdict == ENCODER_DRIFT:
            return ()
        causes = (ENCODER_DRIFT, *self.drift.could_also_be)
        return tuple(cause for cause in causes if cause != self.verdict)

    @property
    def suspected(self) -> str | None:
        """Return the likeliest fault (or `multiple`) if inconclusive; None if no fault is probable.

        A fault is probable if the probability of health is below one half. The verdict does not
        claim it, as that would raise more false alarms than stated. It is None for other verdicts,
        and where `could_also_be` says what it may be.
        """
        if (
            self.drift is not None
            or self.verdict != "inconclusive"
            or self.probabilities.get("healthy", 1.0) >= 0.5
        ):
            return None
        faults = {name: share for name, share in self.probabilities.items() if name != "healthy"}
        return max(faults, key=lambda name: faults[name])

    @property
    def interval_m3_per_s(self) -> tuple[float, float] | None:
        """Return the 95 % interval of the flow, from 0 up, m^3/s; None if no leak was sized."""
        if self.leak_m3_per_s is None or self.leak_std_m3_per_s is None:
            return None
        half = 1.96 * self.leak_std_m3_per_s
        return max(self.leak_m3_per_s - half, 0.0), self.leak_m3_per_s + half


def is_of(decision: Decision, earlier: Decision) -> bool:
    """Return whether a decision names the same fault as an earlier one, and not a return of it.

    The verdicts must be equal, and the fault must begin before the end that `earlier` gives.
    """
    if decision.verdict != earlier.verdict:
        return False
    began, ended = decision.onset_s, earlier.ended_s
    return began is None or ended is None or began < ended
