"""Reports the faults injected in a test: their events, and the leak flows that really resulted.

A simulated rig records its true leak flows. On a real rig they are the readings of its flow meters,
less each meter's mean reading while all bypasses were shut, which is its zero offset.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from estimator.leaks import SETTLED_AFTER_S
from faults import Fault, Verdict, size_shown
from rig.runner.outcomes import Array, InjectedFault

LEAK_CHANNELS: Final = {
    str(Verdict.EXTERNAL_LEAKAGE_1): ("true_leak_1_m3_per_s", "flow_1_m3_per_s"),
    str(Verdict.EXTERNAL_LEAKAGE_2): ("true_leak_2_m3_per_s", "flow_2_m3_per_s"),
    str(Verdict.INTERNAL_LEAKAGE): ("true_leak_internal_m3_per_s", "flow_internal_m3_per_s"),
}
"""For each leak, the channel of its true flow and the channel of its flow meter."""
# A sample at a limit of a time span counts, however its time was rounded.
_INSTANT_S: Final = 1e-6
SHUT_S: Final = 1.0
"""How long a bypass must be shut at the begin of a test so that its meter's zero is known, s."""


@dataclass
class _MeanFlow:
    """The mean of a flow's absolute value over a time span, less the zero offset of its channel.

    The mean is at least 0, and None while there is no reading in the span.

    Attributes:
        column: index of the channel's column.
        from_s, until_s: the span, from the first to just before the second, s of the test.
        shut_s: time until which nothing can flow, so that the channel shows its zero offset, s of
            the test; 0 if no offset is subtracted.
    """

    column: int
    from_s: float
    until_s: float
    shut_s: float
    total: float = 0.0
    count: int = 0
    zero_total: float = 0.0
    zero_count: int = 0

    def add(self, rows: Array) -> None:
        time_s = rows[:, 0]
        there = (time_s >= self.from_s - _INSTANT_S) & (time_s < self.until_s - _INSTANT_S)
        flow = np.abs(rows[there, self.column])
        flow = flow[np.isfinite(flow)]
        self.total += float(flow.sum())
        self.count += flow.size
        zero = rows[time_s < self.shut_s - _INSTANT_S, self.column]
        zero = zero[np.isfinite(zero)]
        self.zero_total += float(zero.sum())
        self.zero_count += zero.size

    @property
    def mean(self) -> float | None:
        if not self.count:
            return None
        mean = self.total / self.count
        return max(mean - self.zero_total / self.zero_count, 0.0) if self.zero_count else mean


class Injection:
    """Follows the rows of one test, and reports its faults as they begin and end.

    Args:
        faults: the test's faults, in the order in which they begin.
        channels: names of the rows' columns; the first is `time_s`.
    """

    def __init__(self, faults: tuple[Fault, ...], channels: tuple[str, ...]) -> None:
        self._faults = faults
        self._channels = channels
        self._flows = [self._flow_of(fault) for fault in faults]
        self._time_s = -inf
        begins = [(each.at_s, "fault_on", _shown(each)) for each in faults]
        # Where another fault goes on at the same place, its begin says so.
        ends = [(each.until_s, "fault_off", str(each.kind)) for each in faults if not each.goes_on]
        events = (event for event in begins + ends if event[0] != inf)
        self._coming = sorted(events, key=lambda event: event[0])

    def _flow_of(self, fault: Fault) -> _MeanFlow | None:
        if fault.kind not in LEAK_CHANNELS:
            return None
        truth, meter = LEAK_CHANNELS[fault.kind]
        is_true = truth in self._channels
        column = self._channels.index(truth if is_true else meter)
        shut_s = min(each.at_s for each in self._faults if each.kind == fault.kind)
        known = not is_true and shut_s >= SHUT_S
        return _MeanFlow(
            column, fault.at_s + SETTLED_AFTER_S, fault.until_s, shut_s if known else 0.0
        )

    def take(self, rows: Array) -> list[tuple[float, str, str]]:
        """Process the next rows, and return the events in them as (time in s, kind, text).

        An event is the begin of a fault (kind `fault_on`) or its end (`fault_off`), at the time for
        which the fault is scheduled. At least one row must be given.
        """
        self._time_s = float(rows[-1, 0])
        for flow in self._flows:
            if flow is not None:
                flow.add(rows)
        happened = [e for e in self._coming if e[0] <= self._time_s + _INSTANT_S]
        self._coming = self._coming[len(happened) :]
        return happened

    @property
    def injected(self) -> tuple[InjectedFault, ...]:
        """The faults that have begun so far, with their mean flows so far.

        The mean is over the rows so far from 2 s after the fault's begin to its end. It is None for
        a fault that is no leak from a chamber, and while there is no such row.
        """
        return tuple(
            InjectedFault(
                kind=str(fault.kind),
                at_s=fault.at_s,
                until_s=None if fault.until_s == inf else fault.until_s,
                coefficient=fault.coefficient,
                linear=fault.linear,
                mean_flow_m3_per_s=None if flow is None else flow.mean,
            )
            for fault, flow in zip(self._faults, self._flows, strict=True)
            if fault.at_s <= self._time_s + _INSTANT_S
        )


def _shown(fault: Fault) -> str:
    return f"{fault.kind}: {size_shown(fault.kind, fault.coefficient, linear=fault.linear)}"
