"""The page of `rig gap`: where the model is wrong, what is missing, how sure, before and after."""

import shlex
from importlib.resources import files
from typing import Final

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from estimator.gap.plant import Plant
from estimator.gap.results import GapResult
from rig.runner.provenance import versions

from . import gap_words
from .gap_figures import drawn_curves, figures_of

_TEMPLATES: Final = "templates"


def gap_page(result: GapResult, plant: Plant, model: str, command: tuple[str, ...] = ()) -> str:
    """Return the HTML page of what was found.

    Args:
        result: of the workflow.
        plant: that was looked at.
        model: name of the model that was tested.
        command: the command line.
    """
    environment = Environment(
        loader=PackageLoader("rig.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("gap.html.j2").render(
        result=result,
        plant=plant,
        model=model,
        command=shlex.join(command),
        rivals=[
            (effect, rival, possible)
            for effect in result.effects
            for rivals, possible in ((effect.indistinguishable, True), (effect.excluded, False))
            for rival in rivals
        ],
        unsettled=[effect for effect in result.effects if effect.indistinguishable],
        unseen=[(effect.name, effect.unseen) for effect in result.effects if effect.unseen],
        campaigns=[
            yaml.safe_dump(dict(each.campaign), sort_keys=False) for each in result.experiments
        ],
        versions=versions(),
        words=gap_words,
        curves=drawn_curves(result),
        figures=figures_of(result),
        style=_asset("report.css"),
        script=_asset("gap.js"),
        plotly=Markup(get_plotlyjs()),
    )


def _asset(name: str) -> Markup:
    return Markup(files("rig.report").joinpath(_TEMPLATES, name).read_text(encoding="utf-8"))
