"""The record of one fault that a test found in the accounts or in the supply pressure."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One fault that was found, with its size and onset.

    Attributes:
        fault: index into `FAULTS`.
        onset: index of the first block that has the fault throughout, among all blocks that were
            tested (of a drop of the supply pressure: among those that have one).
        coefficient, deviation: the fault's coefficient and its standard error, in SI units; for a
            drop of the measured supply pressure, the drop in Pa.
        statistic: the flow (of a supply pressure: the drop) beyond the dead zone, divided by its
            standard error; for a sudden fault computed without the block that supports it most.
        likelihood: gain in twice the log likelihood.
        onset_s: time at which the fault began, s.
        lasting: factor by which noise that lasts from block to block has raised the variance.
        limit: value that the statistic has to exceed for the fault to be claimed.
        ended_s: time at which the fault ended, s; None while it may be present.
        grown: for a leak that grows, its latest coefficient, while `coefficient` is the mean since
            the leak exceeded the dead zone; None for a sudden fault.
    """

    fault: int
    onset: int
    coefficient: float
    deviation: float
    statistic: float
    likelihood: float
    onset_s: float
    lasting: float
    grown: float | None = None
    limit: float = 0.0
    ended_s: float | None = None


@dataclass(frozen=True)
class Growth:
    """How a leak grows, and how large it is now; flows are at its mean pressure drop.

    Attributes:
        now_m3_per_s, now_std_m3_per_s: flow at the last block, and its standard error.
        rate_m3_per_s2, rate_std_m3_per_s2: mean rate at which the flow grows, and its standard
            error, m^3/s in a second.
    """

    now_m3_per_s: float
    now_std_m3_per_s: float
    rate_m3_per_s2: float
    rate_std_m3_per_s2: float
