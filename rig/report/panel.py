"""Defines one plot of the report, a panel, and the data from which a test's panels are drawn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.plant import Parameters
from rig.recording import Recording
from rig.runner.outcomes import TestOutcome

from .accounts import AccountHistory
from .traces import POINTS, Array, Trace, line


@dataclass(frozen=True)
class TestData:
    """The data of one test from which its panels are drawn.

    Attributes:
        outcome: the test's outcome.
        recording: the test's recording.
        filter_name: name of the campaign's filter.
        parameters: the parameters that the filter assumed; None if they are not recorded.
        accounts: the oil accounts; None if there are none for this filter or recording.
        points: greatest number of points of a trace.
    """

    __test__ = False  # not a pytest class, whatever its name

    outcome: TestOutcome
    recording: Recording
    filter_name: str
    parameters: Parameters | None = None
    accounts: AccountHistory | None = None
    points: int = POINTS

    def channel(self, name: str) -> Array | None:
        """Return a channel of the recording, (n,); None if it is absent or never finite."""
        if name not in self.recording or not np.isfinite(self.recording[name]).any():
            return None
        return self.recording[name]

    def line(self, name: str, role: str, values: Array, **style: Any) -> Trace:
        """Return a signal of the test, (n,), as a curve over its time; `style` as in `line`."""
        return line(name, role, self.recording.time_s, values, **{"points": self.points} | style)


@dataclass(frozen=True)
class Panel:
    """One plot of a test, with its traces, its texts and its axes.

    Attributes:
        key: distinguishes the panel from the other panels of the test.
        title: names the quantity that is drawn.
        caption: says what to look for.
        unit: unit of the vertical axis.
        traces: the curves, from back to front.
        limits: lowest and highest value that the vertical axis shows at first; None to fit all.
        across: quantity and unit of the horizontal axis; None for time in s.
    """

    key: str
    title: str
    caption: str
    unit: str
    traces: tuple[Trace, ...]
    limits: tuple[float, float] | None = None
    across: tuple[str, str] | None = None

    @property
    def figure(self) -> dict[str, Any]:
        """The data from which the page's script draws the panel, JSON-able."""
        traces = [trace.plotly for trace in self.traces]
        across = self.across and self.across[1]
        return {"traces": traces, "unit": self.unit, "limits": self.limits, "across": across}


def limits_of(shown: Sequence[Array], least: float = 0.0) -> tuple[float, float] | None:
    """Return the lowest and the highest value that an axis shows at first.

    The axis shows all values except extreme ones, so that a diverging filter does not flatten all
    other curves. It reaches beyond the middle 99 % of the values by their span at most, and a
    margin of 6 %. The result is None if no value is finite, or if all are equal and `least` is 0.

    Args:
        shown: the signals, float64 arrays; NaN and infinite values do not count.
        least: smallest span of the axis, in the signals' unit.
    """
    values = np.concatenate([array.ravel() for array in shown]) if shown else np.empty(0)
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    low, high = (float(q) for q in np.quantile(values, [0.005, 0.995]))
    reach = max(high - low, least)
    low = max(float(values.min()), low - reach)
    high = min(float(values.max()), high + reach)
    margin = 0.06 * max(high - low, least) + 0.5 * max(least - (high - low), 0.0)
    return (low - margin, high + margin) if margin > 0.0 else None
