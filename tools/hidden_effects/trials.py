"""Plans trials of the gap workflow, runs them on several cores and keeps each in a file.

After an interruption, only the trials that are missing in the file are run.
"""

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
    AS_EVER,
    RECORDINGS,
    SECONDS,
    THE_SMALLER,
    Choice,
    Drawn,
    Envelope,
    drawn_trial,
    read_envelope,
    write_recordings,
)
from tools.hidden_effects.forms import CATALOGUE
from tools.hidden_effects.score import Discovery, Estimate, Score, failed, scored
from tools.hidden_effects.shown import smallest_shown
from tools.hidden_effects.workflow import Workflow, WorkflowFailedError, rig_gap
from tools.kept_trials import kept_trials, run_and_keep

MIXTURE: Final = (
    "single", "none", "single", "double", "single", "off_menu", "single", "none", "single",
    "single", "double", "single", "unexcited", "single", "off_menu", "single", "none", "single",
)  # fmt: skip
"""The kinds of successive trials if no single kind is asked for; they repeat from the start."""

_ROOT: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Plan:
    """The description of one trial, from which all of it follows.

    Attributes:
        kind, seed, number, seconds: arguments of `drawn_trial`.
        times: smallest size of a hidden effect, as a multiple of the smallest size that the trial's
            own motions would show; 0 means that sizes are drawn from `sizes.SIZES`. Only the kinds
            `single` and `double` heed it.
        forms, off_menu: those of `drawn_trials.Choice`.
    """

    kind: str
    seed: int
    number: int
    seconds: float = SECONDS
    times: float = 0.0
    forms: str = CATALOGUE
    off_menu: str = "first"

    @property
    def choice(self) -> Choice:
        """What may be hidden."""
        return Choice(self.forms, self.off_menu)

    @property
    def key(self) -> str:
        """A text that differs between any two plans."""
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class Trial:
    """The result of a trial.

    Attributes:
        plan: of the trial.
        envelope: what was hidden.
        score: how right the answer is.
        answer: as the workflow gave it; empty if it failed.
        took_s: how long the workflow took, s.
    """

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
    choice: Choice = AS_EVER,
) -> list[Plan]:
    """Return the plans of a number of trials.

    Args:
        trials: number of plans.
        seed: of all of them; see `drawn_trial`.
        kind: of all of them; None means the kinds of `MIXTURE` in turn.
        seconds: length of each recording.
        times: see `Plan`.
        choice: what may be hidden.
    """
    counted: dict[str, int] = {}
    found = []
    for place in range(trials):
        chosen = kind or MIXTURE[place % len(MIXTURE)]
        number = counted.setdefault(chosen, 0)
        counted[chosen] += 1
        found.append(Plan(chosen, seed, number, seconds, times, choice.forms, choice.off_menu))
    return found


def trial(plan: Plan, folder: Path, keep: bool = False, workflow: Workflow = rig_gap) -> Trial:
    """Draw and record a trial, run the workflow on its recordings, and score the answer.

    If the workflow refuses the recordings of an `unexcited` trial, the answer is `inconclusive`.

    Args:
        plan: of the trial.
        folder: for the trial's files; what was there before is deleted. The envelope is written
            to it only after the workflow has answered.
        keep: whether to leave the files; if not, they stay only if the workflow failed.
        workflow: the function to test.
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
    """Return the drawn trial of a plan, with sizes by the detection limits if `plan.times` is set.

    This is done for the kinds `single` and `double`. The limits are computed from recordings of the
    same rig with nothing hidden, which are written to `folder`; it is deleted afterwards. Their
    part on hidden effects is the envelope's `shown`.
    """
    drawn = drawn_trial(plan.kind, plan.seed, plan.number, seconds=plan.seconds, choice=plan.choice)
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
    drawn = drawn_trial(plan.kind, plan.seed, plan.number, limits, plan.seconds, plan.choice)
    of_hidden = {name: shown[name] for name in drawn.envelope.effects if name in shown}
    return replace(drawn, envelope=replace(drawn.envelope, shown=of_hidden))


def sources_digest() -> str:
    """Return 12 hex digits that change with the sources of product and `tools/hidden_effects`.

    Of the product, those sources count that may be compiled (`rig.compile_cache.source_key`).
    """
    digest = sha256(source_key(_ROOT).encode())
    for path in sorted((_ROOT / "tools/hidden_effects").glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def kept_file(out: Path) -> Path:
    """Return the file in `out` that keeps trials; its name changes with `sources_digest`."""
    return out / f"trials-{sources_digest()}.jsonl"


def run_trials(
    planned: Sequence[Plan],
    out: Path,
    jobs: int,
    keep: bool = False,
    workflow: Workflow = rig_gap,
) -> list[Trial]:
    """Return the trials of all plans, in their order; run those that are missing or had failed.

    Args:
        planned: plans, all different.
        out: folder for the file of kept trials and, while trials run, for their recordings.
        jobs: number of processes; with 1, the trials run in this process.
        keep: whether to leave the files of all trials; otherwise only failed trials leave theirs.
        workflow: the function to test; with several processes, each must be able to import it.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = kept_file(out)
    kept = read_trials(file)
    done = {key: found for key, found in kept.items() if found.score.outcome != "failed"}
    # Folders are numbered, because a folder's name must not show what is hidden.
    left = [
        (plan, out / f"trial-{place:04d}", keep, workflow)
        for place, plan in enumerate(planned)
        if plan.key not in done
    ]
    found = run_and_keep(file, "hidden effects", trial, left, jobs)
    done |= {each.plan.key: each for each in found}
    return [done[plan.key] for plan in planned]


def read_trials(file: Path) -> dict[str, Trial]:
    """Return the trials that `file` holds, by the key of their plan; {} if the file is missing.

    Of several trials of one plan, the last one in the file counts.
    """
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
            tuple(map(tuple, score["forms"])),
            tuple(Discovery(**entry) for entry in score["discovered"]),
        ),
        fields["answer"],
        fields["took_s"],
    )
