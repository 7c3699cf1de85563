"""Tables of the worked example in docs/gap.md, which compare the detector with two models."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from rig.plant import CATALOGUE
from rig.report.gap.words import in_words, with_unit
from tools.counted_shares import counted
from tools.pages.marked_tables import markdown

from .trials import ONSET_S, Case, Heard, Trial

MODELS: Final = ("nominal", "revised")
EDGES: Final = (0.0, 0.05, 0.1, 0.2, np.inf)
"""Edges of the rows of leaks of about one size, L/min."""


def judged(trials: Iterable[Trial], model: str) -> list[tuple[Trial, Heard]]:
    """Return each trial with the detector's judgement of it with `model`, one of `MODELS`."""
    return [(trial, getattr(trial, model)) for trial in trials]


def right(trial: Trial, judgement: Heard) -> bool:
    """Return whether the last verdict names the leak and there was no alarm before it opened.

    It is False for a healthy rig.
    """
    early = judgement.alarm_s is not None and judgement.alarm_s < ONSET_S
    return judgement.verdict == trial.leak and not early


def wrong(trial: Trial, judgement: Heard) -> bool:
    """Return whether there was an alarm and the judgement is not `right`.

    The alarm was then on a healthy rig, too early, or the last verdict is not the leak.
    """
    return judgement.alarm_s is not None and not right(trial, judgement)


def by_size(trials: Sequence[Trial]) -> str:
    """Return two tables of a case: alarms and names by size of leak, and figures of right ones.

    A row without trials has dashes.
    """
    head = ["recordings", *(f"{what}, {model}" for what in ("alarm, wrong", "named right")
                            for model in MODELS)]  # fmt: skip
    healthy = _row("healthy", [trial for trial in trials if trial.leak is None])
    # No leak can be named right on a healthy rig.
    rows = [[*healthy[: -len(MODELS)], *("" for _ in MODELS)]]
    leaks = [trial for trial in trials if trial.leak is not None]
    for low, high in pairwise(EDGES):
        which = [trial for trial in leaks if low <= trial.flow < high]
        name = f"{low:g} L/min and more" if np.isinf(high) else f"{low:g} to {high:g} L/min"
        rows.append(_row(name, which))
    rows.append(_row("all leaks", leaks))
    table = markdown(head, rows)
    return f"{table}\n\n{_quality(leaks)}"


def _row(name: str, trials: Sequence[Trial]) -> list[str]:
    wrongs = [counted(wrong(*each) for each in judged(trials, model)) for model in MODELS]
    rights = [counted(right(*each) for each in judged(trials, model)) for model in MODELS]
    return [name, *wrongs, *rights]


def _quality(leaks: Sequence[Trial]) -> str:
    """Return a table on the leaks named right: latency, error of size, coverage of intervals."""
    rows = []
    for model in MODELS:
        named = [
            (trial, judgement)
            for trial, judgement in judged(leaks, model)
            if right(trial, judgement)
        ]
        rows.append([f"{model} model", *_figures(named)])
    return markdown(["named right", "latency, median", "rms error", "true flow in 95 % interval"],
                    rows)  # fmt: skip


def _figures(named: Sequence[tuple[Trial, Heard]]) -> list[str]:
    if not named:
        return ["–"] * 3
    latency = np.median([(judgement.named_s or np.nan) - ONSET_S for _, judgement in named])
    errors = [(judgement.flow or np.nan) - trial.flow for trial, judgement in named]
    covered = [
        judgement.low is not None
        and judgement.high is not None
        and judgement.low <= trial.flow <= judgement.high
        for trial, judgement in named
    ]
    return [
        f"{latency:.1f} s",
        f"{1e3 * float(np.sqrt(np.mean(np.square(errors)))):.1f}e-3 L/min",
        f"{sum(covered)} of {len(covered)}",
    ]


def by_case(found: Mapping[Case, Sequence[Trial]]) -> str:
    """Return a table with a row for each case (hidden effect): wrong alarms, leaks named right."""
    head = ["hidden", "revised model", "wrong alarms, nominal", "revised",
            "leaks named right, nominal", "revised"]  # fmt: skip
    rows = []
    for case, trials in found.items():
        leaks = [trial for trial in trials if trial.leak is not None]
        cells = [
            counted(judge(*each) for each in judged(which, model))
            for judge, which in ((wrong, trials), (right, leaks))
            for model in MODELS
        ]
        unit = CATALOGUE[case.effect].parameters[0].unit
        size = with_unit(case.value, unit)
        named = f"{in_words(case.effect)}, {size}"
        rows.append([named, "of `rig gap`" if case.found else "the effect's own", *cells])
    return markdown(head, rows)
