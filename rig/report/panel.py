"""What one plot of the report consists of, and what it is drawn from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.plant import Parameters
from rig.recording import Recording
from rig.runner.outcomes import TestOutcome

from .accounts import AccountHistory
from .traces import POINTS, Array, Trace


@dataclass(frozen=True)
class TestData:
    """What is known of one test when its panels are drawn.

    Attributes:
        parameters: what the filter assumed; None if that is not recorded.
        accounts: None where the filter keeps none.
        points: most points of a trace.
    """

    __test__ = False  # not a pytest class, whatever its name

    outcome: TestOutcome
    recording: Recording
    filter_name: str
    parameters: Parameters | None = None
    accounts: AccountHistory | None = None
    points: int = POINTS

    def channel(self, name: str) -> Array | None:
        """Return a channel of the recording, (n,); None if it is absent or has no sample."""
        if name not in self.recording or not np.isfinite(self.recording[name]).any():
            return None
        return self.recording[name]


@dataclass(frozen=True)
class Panel:
    """One plot: its traces over time in s, or another quantity, and how its axes read.

    Attributes:
        key: distinguishes the panel from the test's others.
        title: what is drawn.
        caption: what to look for.
        unit: of the vertical axis.
        traces: from back to front.
        limits: what the vertical axis shows at first; None to fit all.
        across: quantity and unit of the horizontal axis where that is not time.
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
        """What the page's script needs to draw the panel."""
        traces = [trace.plotly for trace in self.traces]
        across = self.across and self.across[1]
        return {"traces": traces, "unit": self.unit, "limits": self.limits, "across": across}


def limits_of(shown: Sequence[Array], least: float = 0.0) -> tuple[float, float] | None:
    """Return what an axis shows at first: all of the signals, short of wild excursions.

    A value farther out than the span of the middle 99 % is left to zooming out, so that a filter
    that diverges does not flatten everything else.

    Args:
        shown: float64 arrays; NaN and infinite values do not count.
        least: span that an axis has at least.
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
