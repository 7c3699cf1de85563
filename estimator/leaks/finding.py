"""The record of one fault that a test found in the accounts or in the supply pressure."""

from dataclasses import dataclass

from estimator.accounts import Ramp


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
        ramp: for a leak that grew within the blocks so far, how it grew; `coefficient` is then the
            mean since it began. None for any other fault.
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
    ramp: Ramp | None = None


@dataclass(frozen=True)
class Growth:
    """How a leak grows or grew, and how large it is now; flows are at its mean pressure drop.

    Attributes:
        now_m3_per_s, now_std_m3_per_s: flow at the last block, and its standard error.
        rate_m3_per_s2, rate_std_m3_per_s2: mean rate at which the flow grows, or grew, and its
            standard error, m^3/s in a second.
        from_m3_per_s: flow before the growth, or when it was first sure.
        seconds: how long the leak has grown, or grew, from that flow to the one now, s.
        since_s: time at which the leak began to grow from nothing, s; None for one that grows over
            minutes, which has no onset.
        grows_on: whether the leak still grows at the last block.
    """

    now_m3_per_s: float
    now_std_m3_per_s: float
    rate_m3_per_s2: float
    rate_std_m3_per_s2: float
    from_m3_per_s: float
    seconds: float
    since_s: float | None = None
    grows_on: bool = True
