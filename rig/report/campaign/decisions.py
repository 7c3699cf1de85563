"""Draws the panels of the detector's decisions during a test, and of the loop's compensation."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.loop import PROBABILITIES, PROBABLE
from rig.plant import LITRE_PER_MINUTE
from rig.report.panel import Panel, TestData
from rig.report.traces import Array, Trace, line, ribbon
from rig.report.wording import label

_PERCENT: Final = 100.0
_WORTH_SHOWING: Final = 0.02
"""Probability that a fault must have exceeded at some time to be drawn."""
_ROLES: Final = ("reference", "chamber_1", "chamber_2", "internal", "accent", "bad", "found")
"""Colours of health and of the faults, in the order of `PROBABILITIES`."""


def probability(data: TestData) -> Panel | None:
    """Return the panel of the probabilities of health and of each fault, as decided over time.

    A fault whose probability never exceeded 2 % is left out. The panel is None if no probabilities
    are recorded.
    """
    traces = []
    for name, channel, role in zip(PROBABLE, PROBABILITIES, _ROLES, strict=True):
        values = data.channel(channel)
        if values is None or (name != "healthy" and not np.nanmax(values) > _WORTH_SHOWING):
            continue
        traces.append(data.line(label(name), role, values * _PERCENT, width=2.2))
    if not traces:
        return None
    caption = "What the detector held while the test ran, decided anew every half second."
    return Panel("probability", "Probability", caption, "%", tuple(traces), (-4.0, 104.0))


def compensation(data: TestData) -> Panel | None:
    """Return the panel of the command's part that compensates for a leak; None if always zero.

    It is None, too, if the compensation or the command is not recorded.
    """
    added, sent = data.channel("compensation_V"), data.channel("command_V")
    if added is None or sent is None or not np.nanmax(np.abs(added)) > 0.0:
        return None
    traces = (
        data.line("valve command", "ink", sent, width=1.2),
        data.line("of it for the leak", "accent", added, width=2.2),
    )
    caption = (
        "What the loop sent to the valve, and what it added to the proportional command to make up "
        "for the leak."
    )
    return Panel("compensation", "Command and compensation", caption, "V", traces)


def flow_as_decided(data: TestData) -> Iterator[Trace]:
    """Yield the band of the leak flow's 95 % interval as decided over time, then its mean, L/min.

    Nothing is yielded if no flow is recorded.
    """
    names = ("decided_leak_low_m3_per_s", "decided_leak_high_m3_per_s", "decided_leak_m3_per_s")
    channels = [data.channel(name) for name in names]
    low, high, mean = (None if each is None else each / LITRE_PER_MINUTE for each in channels)
    if mean is None:
        return
    # A decision is the same in several rows, of which the first and the last are drawn.
    time_s = data.recording.time_s
    ends = _ends_of_stretches(data.recording["decided_at_s"])
    if low is not None and high is not None:
        yield ribbon("95 % interval", "found", time_s[ends], low[ends], high[ends])
    yield line("mean flow found", "found", time_s[ends], mean[ends], width=2.2, dash="dash")


def _ends_of_stretches(values: Array) -> NDArray[np.int64]:
    """Return the indices of the first and the last value of each run of equal values, sorted."""
    known = np.nan_to_num(values, nan=-1.0)
    starts = np.flatnonzero(np.diff(known, prepend=np.inf))
    return np.union1d(starts, np.append(starts[1:] - 1, values.size - 1))
