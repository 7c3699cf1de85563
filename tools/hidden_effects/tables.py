"""The results of trials of the gap workflow as tables in Markdown."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from statistics import median
from typing import Final

from tools.counted_shares import counted, interval
from tools.hidden_effects.off_menu import IDEAS
from tools.hidden_effects.score import OUTCOMES, VISIBLE_GAP, Score
from tools.hidden_effects.trials import Trial
from tools.pages.marked_tables import markdown

GONE: Final = 0.8
"""Share of the held-out gap that counts as most of it."""


def summary(trials: Sequence[Trial]) -> str:
    """Return a table with one row for each promise of the workflow: how often it was kept.

    Trials in which no plausible size was as large as `Plan.times` asks count only in two rows: that
    on such sizes, and that on workflows without an answer.
    """
    small = [trial.score for trial in trials if not trial.envelope.shows(trial.plan.times)]
    kinds = {
        kind: [
            trial.score
            for trial in trials
            if trial.plan.kind == kind and trial.envelope.shows(trial.plan.times)
        ]
        for kind in ("single", "double", "none", "off_menu", "unexcited")
    }
    nothing = kinds["none"]
    hidden = [*kinds["single"], *kinds["double"]]
    estimates = [e for score in hidden for e in score.estimates if e.inside is not None]
    shrunk = [score.shrinkage for score in hidden if score.shrinkage is not None]
    off_menu = kinds["off_menu"]
    rows = [
        ("one effect: named, or in a set of at most three", *_of(kinds["single"], _covering)),
        ("the same, and nothing named beside it", *_of(kinds["single"], _right)),
        ("two effects: both", *_of(kinds["double"], _covering)),
        ("nothing hidden: an effect named", *_of(nothing, lambda score: bool(score.sets))),
        ("nothing hidden: called unknown", *_of(nothing, lambda s: s.outcome == "unknown")),
        ("nothing hidden: something discovered",
         *_of(nothing, lambda score: bool(score.discovered))),
        ("off the menu: called unknown", *_of(off_menu, _right)),
        ("off the menu: equation and quantity right", *_of(off_menu, lambda s: s.placed)),
        ("the same, of kinds that were thought up apart",
         *_of([trial.score for trial in trials if set(IDEAS) & set(trial.envelope.off_menu)],
              lambda score: score.placed)),
        ("the same as two rows above, or in what it could also be",
         *_of(off_menu, lambda score: any(each.among for each in score.discovered))),
        ("off the menu: equation, quantity and shape's name right",
         *_of(off_menu, lambda score: score.shaped)),
        ("off the menu: something discovered where nothing enters",
         *_of(off_menu, lambda s: any(not each.placed for each in s.discovered))),
        ("off the menu: an effect of the catalogue claimed",
         *_of(off_menu, lambda score: bool(score.sets))),
        (f"off the menu: {100.0 * GONE:.0f} % of the held-out gap gone", *_gone(off_menu)),
        ("motions that show nothing: a wrong name",
         *_of(kinds["unexcited"], lambda score: bool(score.false_names))),
        ("no plausible size shows: a wrong name",
         *_of(small, lambda score: bool(score.false_names))),
        ("95 % intervals that hold the true value",
         *_share(sum(bool(e.inside) for e in estimates), len(estimates))),
        (f"one or two effects: {100.0 * GONE:.0f} % of the held-out gap gone", *_gone(hidden)),
        (f"held-out gap gone, median (of gaps above {VISIBLE_GAP:g})", str(len(shrunk)),
         f"{100.0 * median(shrunk):.0f} %" if shrunk else "–", ""),
        ("no answer", *_of([t.score for t in trials], lambda s: s.outcome == "failed")),
    ]  # fmt: skip
    return markdown(("", "of", "share", "95 % interval"), rows)


def by_effect(trials: Sequence[Trial]) -> str:
    """Return a table with one row for each effect, over the trials in which it alone was hidden.

    These are the trials of the kinds `single` and `off_menu`; effects without any have no row.
    """
    rows = []
    for kind in ("single", "off_menu"):
        of_kind = [trial for trial in trials if trial.plan.kind == kind]
        for name in sorted({name for trial in of_kind for name in _hidden(trial)}):
            scores = [trial.score for trial in of_kind if name in _hidden(trial)]
            rows.append((name.replace("_", " "), *_row(scores)))
    return markdown(
        ("hidden", "trials", *OUTCOMES, "inside 95 %", "gap gone", "named instead"), rows
    )


def by_form(trials: Sequence[Trial]) -> str:
    """Return a table with one row for each effect and form, over the trials of one hidden effect.

    Trials in which it is hidden in the form of the catalogue have no row.
    """
    scores: dict[tuple[str, str], list[Score]] = {}
    for trial in trials:
        if trial.plan.kind == "single":
            for hidden in trial.envelope.forms.items():
                scores.setdefault(hidden, []).append(trial.score)
    rows = []
    for (name, form), found in sorted(scores.items()):
        told = Counter(said for score in found for effect, said in score.forms if effect == name)
        rows.append(
            (name.replace("_", " "), form, counted(map(_covering, found)),
             ", ".join(f"{said or 'none'} {count}" for said, count in told.most_common()),
             _shrunk(found), _instead(found))
        )  # fmt: skip
    return markdown(
        ("hidden", "form", "named (95 %)", "form told", "gap gone", "named instead"), rows
    )


def by_place(trials: Sequence[Trial]) -> str:
    """Return a table with one row for each kind off the menu: what was discovered of it."""
    scores: dict[str, list[Score]] = {}
    for trial in trials:
        for name in trial.envelope.off_menu:
            scores.setdefault(name, []).append(trial.score)
    rows = []
    for name, found in sorted(scores.items()):
        said = Counter(each.said for score in found for each in score.discovered)
        rows.append(
            (name.replace("_", " "), counted(score.placed for score in found),
             counted(score.shaped for score in found), _shrunk(found), _instead(found),
             ", ".join(f"{text} {count}" for text, count in said.most_common(3)))
        )  # fmt: skip
    return markdown(
        ("hidden", "placed (95 %)", "shape too (95 %)", "gap gone", "of the catalogue",
         "discovered"), rows,
    )  # fmt: skip


def _hidden(trial: Trial) -> tuple[str, ...]:
    return (*trial.envelope.effects, *trial.envelope.off_menu)


def _row(scores: Sequence[Score]) -> Iterable[str]:
    counts = Counter(score.outcome for score in scores)
    inside = [e.inside for score in scores for e in score.estimates if e.inside is not None]
    yield str(len(scores))
    yield from (str(counts[outcome] or "") for outcome in OUTCOMES)
    yield f"{sum(inside)} of {len(inside)}" if inside else ""
    yield _shrunk(scores)
    yield _instead(scores)


def _shrunk(scores: Sequence[Score]) -> str:
    shrunk = [score.shrinkage for score in scores if score.shrinkage is not None]
    return f"{100.0 * median(shrunk):.0f} %" if shrunk else ""


def _instead(scores: Sequence[Score]) -> str:
    instead = Counter(name for score in scores for name in score.false_names)
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in instead.most_common(3))


def _covering(score: Score) -> bool:
    return score.outcome in ("right", "right and more")


def _right(score: Score) -> bool:
    return score.outcome == "right"


def _of(scores: Sequence[Score], holds: Callable[[Score], bool]) -> tuple[str, str, str]:
    return _share(sum(holds(score) for score in scores), len(scores))


def _gone(scores: Sequence[Score]) -> tuple[str, str, str]:
    shrunk = [score.shrinkage for score in scores if score.shrinkage is not None]
    return _share(sum(share >= GONE for share in shrunk), len(shrunk))


def _share(count: int, total: int) -> tuple[str, str, str]:
    if not total:
        return "0", "–", ""
    low, high = interval(count, total)
    return (
        str(total),
        f"{100.0 * count / total:.0f} % ({count})",
        f"{100.0 * low:.0f} to {100.0 * high:.0f} %",
    )
