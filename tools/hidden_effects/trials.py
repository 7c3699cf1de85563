"""Trials of the gap workflow: planned, run on all cores, kept, gone on with after a kill."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from time import monotonic
from typing import Any, Final

from rig.compile_cache import source_key
from tools.hidden_effects.drawn_trials import (
    RECORDINGS,
    SECONDS,
    THE_SMALLER,
    Drawn,
    Envelope,
    drawn_trial,
    read_envelope,
    write_recordings,
)
from tools.hidden_effects.score import Estimate, Score, failed, scored
from tools.hidden_effects.shown import smallest_shown
from tools.hidden_effects.workflow import Workflow, WorkflowFailedError, rig_gap
from tools.kept_trials import kept_trials, run_and_keep

MIXTURE: Final = (
    "single", "none", "single", "double", "single", "off_menu", "single", "none", "single",
    "single", "double", "single", "unexcited", "single", "off_menu", "single", "none", "single",
)  # fmt: skip
"""Kinds of trials in turn, where none is asked for."""

_ROOT: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Plan:
    """One trial.

    Attributes:
        kind, seed, number, seconds: see `drawn_trial`.
        times: smallest size of what is hidden, in what the trial's own motions would show of it;
            0: sizes are those of `sizes.SIZES`.
    """

    kind: str
    seed: int
    number: int
    seconds: float = SECONDS
    times: float = 0.0

    @property
    def key(self) -> str:
        """What tells this plan from others."""
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class Trial:
    """A plan, what was hidden and what came of it; the answer as the workflow gave it."""

    plan: Plan
    envelope: Envelope
    score: Score
    answer: Mapping[str, Any]
    took_s: float


def plans(
    trials: int,
    seed: int,
    kind: str | None = None,
    seconds: float = SECONDS,
    times: float = 0.0,
) -> list[Plan]:
    """Return so many plans of one kind, or of all kinds in turn."""
    counted: dict[str, int] = {}
    found = []
    for place in range(trials):
        chosen = kind or MIXTURE[place % len(MIXTURE)]
        number = counted.setdefault(chosen, 0)
        counted[chosen] += 1
        found.append(Plan(chosen, seed, number, seconds, times))
    return found


def trial(plan: Plan, folder: Path, keep: bool = False, workflow: Workflow = rig_gap) -> Trial:
    """Draw and record a plan, let the workflow judge it blind, and open the envelope.

    Args:
        plan: of the trial.
        folder: for its files; what it hides is written there once the workflow has answered.
        keep: leave the recordings and what the workflow wrote; otherwise only where it failed.
        workflow: to try.
    """
    rmtree(folder, ignore_errors=True)
    drawn = drawn_for(plan, folder / "shown")
    files = write_recordings(drawn, folder / "recordings")
    begun = monotonic()
    answer: Mapping[str, Any] = {}
    try:
        identify = [file for name, file in files.items() if name != "holdout"]
        answer = workflow(identify, files["holdout"], folder / "out")
        score = scored(drawn.envelope, answer)
    except WorkflowFailedError as error:
        score = failed(str(error))
        if error.refused and plan.kind == "unexcited":
            answer = {"verdict": "inconclusive", "why": str(error)}
            score = scored(drawn.envelope, answer)
    took = monotonic() - begun
    if keep or score.outcome == "failed":
        drawn.envelope.write(folder / "envelope.json")
    else:
        rmtree(folder)
    return Trial(plan, drawn.envelope, score, answer, round(took, 2))


def drawn_for(plan: Plan, folder: Path) -> Drawn:
    """Return what a plan hides, of a size that shows if the plan says so."""
    drawn = drawn_trial(plan.kind, plan.seed, plan.number, seconds=plan.seconds)
    if plan.times == 0.0 or plan.kind not in ("single", "double"):
        return drawn
    healthy = replace(drawn, envelope=drawn.envelope.without_effects())
    files = write_recordings(healthy, folder)
    nuisances = drawn.envelope.nuisances
    shown = smallest_shown([files[name] for name in RECORDINGS if name != "holdout"], nuisances)
    rmtree(folder)
    limits = {
        name: limit / plan.times if name in THE_SMALLER else limit * plan.times
        for name, limit in shown.items()
    }
    drawn = drawn_trial(plan.kind, plan.seed, plan.number, limits, plan.seconds)
    of_hidden = {name: shown[name] for name in drawn.envelope.effects if name in shown}
    return replace(drawn, envelope=replace(drawn.envelope, shown=of_hidden))


def kept_file(out: Path) -> Path:
    """Return where trials with the present sources are kept: other states have other files."""
    digest = sha256(source_key(_ROOT).encode())
    for path in sorted((_ROOT / "tools/hidden_effects").glob("*.py")):
        digest.update(path.read_bytes())
    return out / f"trials-{digest.hexdigest()[:12]}.jsonl"


def run_trials(
    planned: Sequence[Plan],
    out: Path,
    jobs: int,
    keep: bool = False,
    workflow: Workflow = rig_gap,
) -> list[Trial]:
    """Return the trials of all plans, running those that are not kept from before or failed.

    Args:
        planned: no two alike.
        out: folder for what was found and, while they run, for the recordings.
        jobs: processes; 1 runs them here.
        keep: leave the recordings.
        workflow: to try; with more than one process, one that another can import.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = kept_file(out)
    kept = read_trials(file)
    done = {key: found for key, found in kept.items() if found.score.outcome != "failed"}
    # Named by their place in the plan: a folder's name must not tell what is hidden.
    left = [
        (plan, out / f"trial-{place:04d}", keep, workflow)
        for place, plan in enumerate(planned)
        if plan.key not in done
    ]
    found = run_and_keep(file, "hidden effects", trial, left, jobs)
    done |= {each.plan.key: each for each in found}
    return [done[plan.key] for plan in planned]


def read_trials(file: Path) -> dict[str, Trial]:
    """Return the trials kept in a file, by their plan's key."""
    return {found.plan.key: found for found in map(_trial_of, kept_trials(file))}


def _trial_of(fields: Mapping[str, Any]) -> Trial:
    score = fields["score"]
    estimates = tuple(
        Estimate(**{**entry, "interval": entry["interval"] and tuple(entry["interval"])})
        for entry in score["estimates"]
    )
    return Trial(
        Plan(**fields["plan"]),
        read_envelope(fields["envelope"]),
        Score(
            score["outcome"],
            score["verdict"],
            tuple(map(tuple, score["sets"])),
            tuple(score["false_names"]),
            estimates,
            score["gap"] and tuple(score["gap"]),
            score["why"],
        ),
        fields["answer"],
        fields["took_s"],
    )
