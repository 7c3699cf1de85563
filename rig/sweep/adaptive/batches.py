"""Decides from the results of earlier batches of cases between which sizes the next batch is drawn.

A batch is decided from all cases before it, and from nothing else. So the sweep comes out the same
by any number of processes, in whatever order they end, and after any interruption.
"""

from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rig.configuration import HEALTHY, Distribution, Sweep, SweptLeaks

from ..drawing import Span, Spans
from ..table import columns_of
from .monotone import Crossing, crossing

Array = NDArray[np.float64]

WIDENED: Final = 0.25
"""Part of the interval's width by which sizes are drawn beyond either end of it. Draws there
put an end right that chance has put too far in. Of a quarter, half and once the width, a quarter
was the least with which the intervals held the true size as often as they should (decision 51)."""


def positions(law: Distribution, sizes: Array) -> Array:
    """Return which part of a uniform or log-uniform distribution lies below each size, (n,)."""
    first, second = law.values
    if law.kind == "log_uniform":
        return np.log(sizes / first) / np.log(second / first)
    return (sizes - first) / (second - first)


def flows_of(leaks: SweptLeaks, faults: NDArray[np.str_], coefficients: Array) -> Array:
    """Return the flows that were drawn, m^3/s at the pressures of the file, (n,); NaN if healthy.

    Args:
        leaks: the leaks of the sweep, which are given by their flow.
        faults: injected fault of each case, (n,).
        coefficients: coefficient of each leak, m^3/(s Pa^0.5), (n,); NaN for a healthy case.
    """
    assert leaks.pressure is not None
    roots = {place: np.sqrt(drop) for place, drop in zip(leaks.places, leaks.pressure, strict=True)}
    return coefficients * np.array([roots.get(fault, np.nan) for fault in faults.tolist()])


def next_span(found: Crossing) -> Span:
    """Return the range to draw from next, for where the wanted size is known to lie.

    Args:
        found: where the wanted size lies, as parts of the distribution of sizes.
    """
    low, high = max(found.near_low, 0.0), min(found.near_high, 1.0)
    beyond = WIDENED * (high - low)
    return Span(max(low - beyond, 0.0), min(high + beyond, 1.0))


class AdaptiveDrawing:
    """The batches of an adaptive sweep, as far as the results that are known decide them.

    Args:
        sweep: the sweep, whose leaks are drawn adaptively.
    """

    def __init__(self, sweep: Sweep) -> None:
        assert sweep.leaks is not None
        assert sweep.leaks.adaptive is not None
        self._leaks, self._adaptive = sweep.leaks, sweep.leaks.adaptive
        self._known = np.zeros(sweep.cases, np.bool_)
        self._right = np.zeros(sweep.cases, np.bool_)
        self._place = np.full(sweep.cases, -1, np.int8)
        self._position = np.zeros(sweep.cases)
        whole = dict.fromkeys(self._leaks.places, Span(0.0, 1.0))
        self._spans: list[Spans] = [whole]

    def add(self, rows: pa.Table) -> None:
        """Take the results of some cases.

        Args:
            rows: their rows of the sweep's table.
        """
        column = columns_of(rows.select(["case", "fault", "coefficient", "right"]))
        at, faults = column["case"].astype(np.intp), column["fault"]
        flows = flows_of(self._leaks, faults, column["coefficient"])
        self._known[at], self._right[at] = True, column["right"].astype(np.bool_)
        self._position[at] = np.nan_to_num(positions(self._leaks.size, flows))
        order = {place: index for index, place in enumerate(self._leaks.places)} | {HEALTHY: -1}
        self._place[at] = [order[fault] for fault in faults.tolist()]

    def spans(self, first: int) -> Spans | None:
        """Return the ranges of sizes of a batch; None while results of cases before it are missing.

        There are no ranges if all places are done before this batch.

        Args:
            first: number of the first case of the batch.
        """
        batch = first // self._adaptive.batch
        while len(self._spans) <= batch:
            before = len(self._spans) * self._adaptive.batch
            if not self._known[:before].all():
                return None
            self._spans.append(self._decided(before, self._spans[-1]))
        return self._spans[batch]

    def _decided(self, before: int, last: Spans) -> Spans:
        """Return the ranges of the batch after the first `before` cases.

        Args:
            before: number of cases before the batch.
            last: ranges of the batch before; places that are not in it are done.
        """
        spans: dict[str, Span] = {}
        for index, place in enumerate(self._leaks.places):
            if place not in last:
                continue
            at = self._place[:before] == index
            found = crossing(
                self._position[:before][at], self._right[:before][at], self._adaptive.found
            )
            if not self._is_done(found):
                spans[place] = next_span(found)
        return spans

    def _is_done(self, found: Crossing) -> bool:
        """Return whether the interval of a place's size is as narrow as was asked.

        An interval that ends at the range of sizes counts from that end.
        """
        ends = np.array([max(found.low, 0.0), min(found.high, 1.0)])
        low, high = self._leaks.size.at(ends).tolist()
        return bool(high / low - 1.0 <= self._adaptive.interval)
