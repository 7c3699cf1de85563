"""Makes the page that compares two runs: first figures that moved beyond tolerance, then all."""

from rig.report.templating import rendered
from rig.runner.run_folder import Change, Compared, Comparison


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
