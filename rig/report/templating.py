"""Fills the templates of the pages with styles, scripts, plotly, and numbers to draw."""

from collections.abc import Iterable
from importlib.resources import files
from math import isfinite
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

_TEMPLATES: Final = "templates"


def rendered(template: str, script: str = "", **values: Any) -> str:
    """Return a page that fetches nothing: its style, its script and plotly are in it.

    Args:
        template: file of `rig/report/templates`.
        script: file of the same folder, which draws the page's plots; empty for a page that has
            neither plots nor script.
        values: what the template names.
    """
    environment = Environment(
        loader=PackageLoader("rig.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    if script:
        # Plotly stands last in the page, so that all text is there before plotly is parsed.
        values |= {"script": _asset(script), "plotly": Markup(get_plotlyjs())}
    return environment.get_template(template).render(style=_asset("report.css"), **values)


def _asset(name: str) -> Markup:
    return Markup(files("rig.report").joinpath(_TEMPLATES, name).read_text(encoding="utf-8"))


def number(value: float, digits: int = 5) -> float | None:
    """Return a number to so many digits, for a page's script; None if the number is not finite."""
    return float(f"{value:.{digits}g}") if isfinite(value) else None


def numbers(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Return `number` of each value."""
    return [number(value, digits) for value in values]
