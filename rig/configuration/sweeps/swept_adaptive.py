"""The key `adaptive` of a sweep's leaks is read here: which size the draws are to come near to."""

from typing import Annotated, Final

from pydantic import Field as SchemaField

from rig.configuration.reading import Located, Physical, Schema, read_mapping
from rig.lanes import LANES

from .distributions import Distribution
from .sweep_plan import AdaptiveSizes

_LEAST_FOUND: Final = 0.5
_MOST_FOUND: Final = 0.99
_USUAL_FOUND: Final = 0.95
_USUAL_BATCH: Final = 96
LEAST_LEAKS: Final = 10
"""Smallest number of leaks of a place in a batch for which coverage was tried
(`python -m tools.studies.adaptive_drawing`)."""
_HINTS: Final = {
    "share": "the share that is named right at the wanted size is `found`",
    "cases": "the greatest number of cases is the `cases` of the sweep",
}


class AdaptiveFile(Schema):
    """Keys of `adaptive`: which size is looked for, how well, and how often draws move."""

    found: Annotated[float, Physical("", _LEAST_FOUND, _MOST_FOUND, _USUAL_FOUND)] = _USUAL_FOUND
    interval: Annotated[float | None, Physical("", 0.01, 10.0, 0.2)] = None
    batch: Annotated[int, SchemaField(ge=LANES, le=100_000)] = _USUAL_BATCH


def read_adaptive(
    item: Located | None, size: Distribution | None, healthy: float, cases: int | None
) -> AdaptiveSizes | None:
    """Return how the sizes of leaks are drawn; None if the file does not ask for it or is wrong.

    Problems are recorded.

    Args:
        item: the mapping under `adaptive`; None if there is none.
        size: distribution of the flow, within which sizes are drawn; None if the leaks have no
            flow, or more than one, or if that is wrong.
        healthy: fraction of all cases that have no leak.
        cases: number of cases of the sweep; None if it is not known.
    """
    if item is None:
        return None
    file = read_mapping(AdaptiveFile, item, _HINTS)
    if size is None:
        limit = "needs leaks with one flow each, of which the draws choose"
        item.refuse(limit, "give `flow: {log_uniform: [from, to]}`, no coefficient or profile", "")
        return None
    if size.kind not in ("uniform", "log_uniform") or not size.is_drawn:
        limit = "needs a range of flows, within which the draws move"
        item.refuse(limit, "give `flow: {log_uniform: [from, to]}`", "")
    if healthy == 1.0:
        item.refuse("looks for the size of leaks, and all cases are healthy", "lower `healthy`", "")
    if file is None:
        return None
    if file.batch % LANES:
        limit = f"is no multiple of {LANES}, the number of cases that run side by side"
        item.refuse(limit, f"give {file.batch // LANES * LANES + LANES}", file.batch, "batch")
    if cases is not None and file.batch >= cases:
        limit = f"leaves none of the {cases} cases to draw by what was found"
        item.refuse(limit, "lower it, or raise `cases`", file.batch, "batch")
    return AdaptiveSizes(file.found, file.interval or 0.0, file.batch)
