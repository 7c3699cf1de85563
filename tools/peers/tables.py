"""The tables of the comparison in Markdown."""

from collections.abc import Sequence
from statistics import median

from tools.pages.marked_tables import markdown
from tools.peers.compare import METHODS, Compared, Outcome

_RIGHT = {True: "right", False: "wrong", None: ""}
SEEN = 0.05
"""Gaps of the model given from this on count in the shares of what is gone, in noise variances."""


def by_case(found: Sequence[Compared]) -> str:
    """Return a table with one row for each case: what each method leaves, names and takes."""
    rows = [
        (
            each.plan.name.replace("_", " "), each.hidden.replace("|", r"\|"), _number(each.before),
            *(_cell(each.outcomes.get(method)) for method in METHODS),
        )
        for each in found
    ]  # fmt: skip
    return markdown(("case", "hidden", "gap before", *METHODS), rows)


def summary(found: Sequence[Compared]) -> str:
    """Return a table with one row for each group of cases and method."""
    rows = []
    for group in dict.fromkeys(each.plan.group for each in found):
        of_group = [each for each in found if each.plan.group == group]
        for method in METHODS:
            known = [(e.before, e.outcomes[method]) for e in of_group if method in e.outcomes]
            if known:
                rows.append((f"{group}: {method}", *_row(known)))
    head = (
        "", "cases", "gap gone, median", "80 % and more gone", "worse than the model given",
        "no prediction", "right", "s, median",
    )  # fmt: skip
    return markdown(head, rows)


def _row(known: Sequence[tuple[float | None, Outcome]]) -> tuple[str, ...]:
    # A method without finite predictions has taken nothing away.
    gone = [
        0.0 if outcome.gap is None else 1.0 - outcome.gap / before
        for before, outcome in known
        if before is not None and before >= SEEN
    ]
    judged = [outcome.right for _, outcome in known if outcome.right is not None]
    return (
        str(len(known)),
        f"{median(gone):.0%}".replace("%", " %") if gone else "–",
        f"{sum(each >= 0.8 for each in gone)} of {len(gone)}",
        f"{sum(each < -0.01 for each in gone)} of {len(gone)}",
        str(sum(outcome.gap is None for _, outcome in known)),
        f"{sum(judged)} of {len(judged)}",
        f"{median(outcome.seconds for _, outcome in known):.0f}",
    )


def _cell(outcome: Outcome | None) -> str:
    if outcome is None:
        return ""
    parts = [_number(outcome.gap), _RIGHT[outcome.right], f"{outcome.seconds:.0f} s"]
    return ", ".join(part for part in parts if part)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"
