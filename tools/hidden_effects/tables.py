"""The results of trials of the gap workflow as tables in Markdown."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from statistics import median

from tools.hidden_effects.score import OUTCOMES, VISIBLE_GAP, Score
from tools.hidden_effects.trials import Trial
from tools.pages.marked_tables import markdown


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
    rows = [
        ("one effect: named, or in a set of at most three", *_of(kinds["single"], _covering)),
        ("the same, and nothing named beside it", *_of(kinds["single"], _right)),
        ("two effects: both", *_of(kinds["double"], _covering)),
        ("nothing hidden: an effect named", *_of(nothing, lambda score: bool(score.sets))),
        ("nothing hidden: called unknown", *_of(nothing, lambda s: s.outcome == "unknown")),
        ("off the menu: called unknown", *_of(kinds["off_menu"], _right)),
        ("motions that show nothing: a wrong name",
         *_of(kinds["unexcited"], lambda score: bool(score.false_names))),
        ("no plausible size shows: a wrong name",
         *_of(small, lambda score: bool(score.false_names))),
        ("95 % intervals that hold the true value",
         *_share(sum(bool(e.inside) for e in estimates), len(estimates))),
        (f"held-out gap gone, median (of gaps above {VISIBLE_GAP:g})", str(len(shrunk)),
         f"{100.0 * median(shrunk):.0f} %" if shrunk else "–"),
        ("no answer", *_of([t.score for t in trials], lambda s: s.outcome == "failed")),
    ]  # fmt: skip
    return markdown(("", "of", "share"), rows)


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


def _hidden(trial: Trial) -> tuple[str, ...]:
    return (*trial.envelope.effects, *trial.envelope.off_menu)


def _row(scores: Sequence[Score]) -> Iterable[str]:
    counts = Counter(score.outcome for score in scores)
    inside = [e.inside for score in scores for e in score.estimates if e.inside is not None]
    shrunk = [score.shrinkage for score in scores if score.shrinkage is not None]
    instead = Counter(name for score in scores for name in score.false_names)
    yield str(len(scores))
    yield from (str(counts[outcome] or "") for outcome in OUTCOMES)
    yield f"{sum(inside)} of {len(inside)}" if inside else ""
    yield f"{100.0 * median(shrunk):.0f} %" if shrunk else ""
    yield ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in instead.most_common(3))


def _covering(score: Score) -> bool:
    return score.outcome in ("right", "right and more")


def _right(score: Score) -> bool:
    return score.outcome == "right"


def _of(scores: Sequence[Score], holds: Callable[[Score], bool]) -> tuple[str, str]:
    return _share(sum(holds(score) for score in scores), len(scores))


def _share(count: int, total: int) -> tuple[str, str]:
    return str(total), f"{100.0 * count / total:.0f} % ({count})" if total else "–"
