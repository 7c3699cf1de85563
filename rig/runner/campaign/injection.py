"""What was injected: the events of a test's faults, and the leak flows that they really gave.

A simulated rig records its true flows; a real one what its flow meters read, of which is taken off
what they read while nothing was open: a meter's zero is no leak.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import SETTLED_AFTER_S
from faults import Fault, Verdict
from rig.runner.outcomes import InjectedFault

Array = NDArray[np.float64]

LEAK_CHANNELS: Final = {
    str(Verdict.EXTERNAL_LEAKAGE_1): ("true_leak_1_m3_per_s", "flow_1_m3_per_s"),
    str(Verdict.EXTERNAL_LEAKAGE_2): ("true_leak_2_m3_per_s", "flow_2_m3_per_s"),
    str(Verdict.INTERNAL_LEAKAGE): ("true_leak_internal_m3_per_s", "flow_internal_m3_per_s"),
}
"""The flow of each leak: the channel of its truth, and that of its meter."""
# A sample at the very moment counts, whatever the rounding of its time.
_INSTANT_S: Final = 1e-6
SHUT_S: Final = 1.0
"""How long a bypass must have been shut for its meter's zero to be known, ten of its lags."""


@dataclass
class _MeanFlow:
    """Running mean of a channel's absolute value from one time to another, less its zero.

    Attributes:
        column: of the channel.
        from_s, until_s: when the leak flows.
        shut_s: until when nothing can flow and the channel shows its zero; 0 if it has none.
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
    """The faults of one test as they come, with the leak flows recorded.

    Args:
        faults: in the order they begin.
        channels: names of the rows' columns, the first `time_s`.
    """

    def __init__(self, faults: tuple[Fault, ...], channels: tuple[str, ...]) -> None:
        self._faults = faults
        self._channels = channels
        self._flows = {
            index: self._flow_of(fault)
            for index, fault in enumerate(faults)
            if fault.kind in LEAK_CHANNELS
        }
        self._time_s = -inf
        self._coming = sorted(_events(faults), key=lambda event: event[0])

    def _flow_of(self, fault: Fault) -> _MeanFlow:
        truth, meter = LEAK_CHANNELS[fault.kind]
        is_true = truth in self._channels
        column = self._channels.index(truth if is_true else meter)
        shut_s = min(each.at_s for each in self._faults if each.kind == fault.kind)
        known = not is_true and shut_s >= SHUT_S
        return _MeanFlow(
            column, fault.at_s + SETTLED_AFTER_S, fault.until_s, shut_s if known else 0.0
        )

    def take(self, rows: Array) -> list[tuple[float, str, str]]:
        """Take the next rows; return what happened in them as (time in s, kind of event, text)."""
        self._time_s = float(rows[-1, 0])
        for flow in self._flows.values():
            flow.add(rows)
        happened = [e for e in self._coming if e[0] <= self._time_s + _INSTANT_S]
        self._coming = self._coming[len(happened) :]
        return happened

    @property
    def injected(self) -> tuple[InjectedFault, ...]:
        """The faults that have begun so far."""
        return tuple(
            InjectedFault(
                kind=str(fault.kind),
                at_s=fault.at_s,
                until_s=None if fault.until_s == inf else fault.until_s,
                coefficient=fault.coefficient,
                linear=fault.linear,
                mean_flow_m3_per_s=self._flows[index].mean if index in self._flows else None,
            )
            for index, fault in enumerate(self._faults)
            if fault.at_s <= self._time_s + _INSTANT_S
        )


def _events(faults: tuple[Fault, ...]) -> list[tuple[float, str, str]]:
    begins = [
        (fault.at_s, "fault_on", f"{fault.kind}: {fault.coefficient:.4g} (SI)") for fault in faults
    ]
    ends = [
        (fault.until_s, "fault_off", str(fault.kind)) for fault in faults if fault.until_s != inf
    ]
    return begins + ends
