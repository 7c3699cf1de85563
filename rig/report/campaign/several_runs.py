"""Makes the pages on several runs: one of trends, and one that compares two runs.

Each shows first what changed, then all figures.
"""

from collections.abc import Sequence
from typing import Any, Final

from rig.report.templating import rendered
from rig.runner.run_folder import Change, Compared, Comparison, Trend

_INTERVAL: Final = 1.96
TREND: Final = "trend.html"
"""File name of the page in a schedule's folder."""


def trend_page(trends: Sequence[Trend], title: str) -> str:
    """Return the HTML page of trends, with a title as its heading; the page fetches nothing."""
    tests: dict[tuple[str, str], list[tuple[int, Trend]]] = {}
    for index, trend in enumerate(trends):
        tests.setdefault((trend.campaign, trend.test), []).append((index, trend))
    return rendered(
        "trend.html.j2",
        "trend.js",
        title=title,
        changing=[trend for trend in trends if trend.changes],
        fitted=any(trend.slope is not None for trend in trends),
        tests=tests,
        runs=len({point.run for trend in trends for point in trend.points}),
        figures=[_figure(trend) for trend in trends],
    )


def _figure(trend: Trend) -> dict[str, Any]:
    errors = [point.standard_error for point in trend.points]
    return {
        "unit": trend.unit,
        "at": [point.at.strftime("%Y-%m-%d %H:%M:%S") for point in trend.points],
        "values": [point.value for point in trend.points],
        "halves": [None if error is None else _INTERVAL * error for error in errors],
        "runs": [point.run for point in trend.points],
        "line": _line(trend),
    }


def _line(trend: Trend) -> list[float] | None:
    """Return the fitted line's values at the first and the last run; None if no line was fitted."""
    if trend.slope is None:
        return None
    first, last = trend.points[0].at, trend.points[-1].at
    days = [(point.at - first).total_seconds() / 86400.0 for point in trend.points]
    mean = sum(point.value for point in trend.points) / len(days)
    start = mean - trend.slope * sum(days) / len(days)
    return [start, start + trend.slope * (last - first).total_seconds() / 86400.0]


def number(value: float | str | None) -> str:
    """Return a value as text: a number to five digits, a text unchanged, and a dash for None."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.5g}"


def comparison_page(comparison: Comparison) -> str:
    """Return the HTML page of a comparison; the page fetches nothing and needs no script."""
    tests: dict[str, list[Compared]] = {}
    for each in comparison.figures:
        tests.setdefault(each.test, []).append(each)
    return rendered(
        "comparison.html.j2",
        comparison=comparison,
        tests=tests,
        number=number,
        moved=Change.MOVED,
    )
