"""The page that compares two runs: what moved beyond its tolerance first, then everything."""

from importlib.resources import files
from pathlib import Path
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rig.recording import replacing
from rig.runner.run_folder import Change, Compared, Comparison

_TEMPLATES: Final = "templates"


def number(value: float | str | None) -> str:
    """Return a value to five digits, a word as it is, nothing as a dash."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.5g}"


def write_comparison(comparison: Comparison, path: Path) -> None:
    """Write the page, in one step.

    Raises:
        OSError: it cannot be written.
    """
    with replacing(path) as partial:
        partial.write_text(comparison_page(comparison), encoding="utf-8")


def comparison_page(comparison: Comparison) -> str:
    """Return the HTML page of two runs; it fetches nothing and needs no script."""
    environment = Environment(
        loader=PackageLoader("rig.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    tests: dict[str, list[Compared]] = {}
    for each in comparison.figures:
        tests.setdefault(each.test, []).append(each)
    style = files("rig.report").joinpath(_TEMPLATES, "report.css").read_text(encoding="utf-8")
    return environment.get_template("comparison.html.j2").render(
        comparison=comparison,
        tests=tests,
        number=number,
        moved=Change.MOVED,
        style=Markup(style),
    )
