"""A fault that the accounts, or the supply pressure, tell of."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One fault in the accounts.

    Attributes:
        fault: index into `FAULTS`.
        onset: index of the first complete block with the fault.
        onset_fraction: part of the block before that already had it, 0 to 1.
        coefficient, deviation: its coefficient and standard error, SI.
        statistic: what its flow exceeds the dead zone by, over its standard error, without the
            block that speaks most for it.
        likelihood: gain in twice the log likelihood, in units of the noise.
        onset_s: time at which it began.
        lasting: by how much noise that lasts from block to block has raised its variance.
        limit: what the statistic has to exceed where the fault is claimed.
        ended_s: time at which it was gone again; None while it may be there.
        grown: of a leak that grows, its coefficient at last, `coefficient` being the mean since it
            exceeded the dead zone; else None.
    """

    fault: int
    onset: int
    onset_fraction: float
    coefficient: float
    deviation: float
    statistic: float
    likelihood: float
    onset_s: float
    lasting: float
    grown: float | None = None
    limit: float = 0.0
    ended_s: float | None = None
