"""The page of `rig gap`: where the model is wrong, what is missing, how sure, before and after."""

import shlex

import yaml

from estimator.gap import GapResult, Plant
from rig.report.templating import rendered
from rig.runner.outcomes import versions

from . import words as gap_words
from .figures import drawn_curves, figures_of


def gap_page(result: GapResult, plant: Plant, model: str, command: tuple[str, ...] = ()) -> str:
    """Return the HTML page of what was found.

    Args:
        result: of the workflow.
        plant: that was looked at.
        model: name of the model that was tested.
        command: the command line.
    """
    return rendered(
        "gap.html.j2",
        "gap.js",
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
    )
