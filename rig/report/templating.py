"""Fills the templates of the pages with values, style, scripts and plotly."""

from collections.abc import Iterable
from importlib.resources import files
from math import isfinite
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

_TEMPLATES: Final = "templates"


def rendered(template: str, script: str = "", **values: Any) -> str:
    """Return an HTML page that has its style, its script and plotly in it, and fetches nothing.

    Args:
        template: name of a file in `rig/report/templates`.
        script: name of a file in the same folder, which draws the page's plots; empty for a page
            without plots and script.
        values: the values of the names that the template uses.
    """
    environment = Environment(
        loader=PackageLoader("rig.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    if script:
        # Plotly comes last in the page, so that the browser shows all text before it parses plotly.
        values |= {"script": _asset(script), "plotly": Markup(get_plotlyjs())}
    return environment.get_template(template).render(style=_asset("report.css"), **values)


def _asset(name: str) -> Markup:
    return Markup(files("rig.report").joinpath(_TEMPLATES, name).read_text(encoding="utf-8"))


def number(value: float, digits: int = 5) -> float | None:
    """Return a number rounded to `digits` significant digits; None if it is not finite."""
    return float(f"{value:.{digits}g}") if isfinite(value) else None


def numbers(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Return each value rounded as `number` does, None where it is not finite."""
    return [number(value, digits) for value in values]
