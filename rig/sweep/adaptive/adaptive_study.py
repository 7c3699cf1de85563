"""Tells for each place of an adaptive sweep the size of which the wanted share is found."""

from typing import Final

import numpy as np
import pyarrow as pa

from rig.configuration import Sweep

from ..study import PowerCurve, power_bins
from ..table import columns_of
from .batches import flows_of
from .monotone import crossing, steps

_BINS_PER_DECADE: Final = 20


def power_curves(sweep: Sweep, table: pa.Table) -> dict[str, PowerCurve]:
    """Return the power curve of each place of an adaptive sweep, over the flows that were drawn.

    Unlike the mean flow of a case, the flow that is drawn depends on nothing else that is drawn, so
    that a curve over it is the same however the draws are spread. There is none for all places
    together, since the draws decide how many leaks of which size a place has.

    Args:
        sweep: the sweep, whose leaks are drawn adaptively.
        table: its table, a row for each case.
    """
    leaks, adaptive = sweep.leaks, sweep.adaptive
    assert leaks is not None
    assert adaptive is not None
    column = columns_of(table.select(["fault", "coefficient", "right"]))
    faults, right = column["fault"], column["right"].astype(np.bool_)
    flows = flows_of(leaks, faults, column["coefficient"])
    curves = {}
    for place in leaks.places:
        flow, named = flows[faults == place], right[faults == place]
        if not flow.size:
            continue
        found = crossing(np.log(flow), named, adaptive.found)
        low, high, middle = (
            float(np.exp(end)) if np.isfinite(end) else None
            for end in (found.low, found.high, found.middle)
        )
        is_known = low is not None and high is not None
        sizes, shares = steps(flow, named)
        curves[place] = PowerCurve(
            power_bins(flow, named, _BINS_PER_DECADE),
            share=adaptive.found,
            limit_m3_per_s=middle if is_known else None,
            interval_m3_per_s=(low, high) if low is not None and high is not None else None,
            at_least_m3_per_s=None if is_known else low,
            at_most_m3_per_s=None if is_known else high,
            missed_m3_per_s=None if named.all() else float(flow[~named].max()),
            named_m3_per_s=float(flow[named].min()) if named.any() else None,
            steps=tuple(zip(sizes.tolist(), shares.tolist(), strict=True)),
        )
    return curves
