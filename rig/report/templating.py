"""Templates of the pages, and what is put into them: styles, scripts, plotly."""

from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

_TEMPLATES: Final = "templates"


def rendered(template: str, script: str, **values: Any) -> str:
    """Return a page that fetches nothing: with its style, its script and plotly in it.

    Args:
        template: file of `rig/report/templates`.
        script: likewise; draws the page's plots.
        values: what the template names.
    """
    environment = Environment(
        loader=PackageLoader("rig.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        style=_asset("report.css"),
        script=_asset(script),
        # Last in the page, so that all text is there before it is parsed.
        plotly=Markup(get_plotlyjs()),
        **values,
    )


def _asset(name: str) -> Markup:
    return Markup(files("rig.report").joinpath(_TEMPLATES, name).read_text(encoding="utf-8"))
