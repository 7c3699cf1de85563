"""Closes a gap on a rig: runs motions, finds what the model lacks, and checks the revised model.

Each round adds the recordings of new motions to those that the model is fitted to. The first round
runs the programme. A later one runs an experiment that distinguishes effects which the recordings
so far cannot distinguish, or, after a check that was not adequate, the programme again. For a check
new motions are run after the model was revised, and the revised model is tested on them. The rounds
end when a model is adequate, when nothing more can be found, or at the greatest number of rounds.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Concatenate, Final, ParamSpec, TypeVar

import numpy as np

from estimator.gap import (
    SURE,
    Check,
    GapResult,
    Plant,
    Predictor,
    Round,
    Separation,
    Wanted,
    channel_gaps,
    find_gap,
    growth,
    mean_gap,
    record_of,
    take_back,
    usable,
    why_worse,
)
from faults import Campaign
from rig.configuration import Rig
from rig.loop import StopRequestedError, TripError
from rig.plant import Model
from rig.recording import Recording, read_recording
from rig.runner.campaign import Bench, Pace, StopFlag, bench_of
from rig.runner.outcomes import EXIT_STOPPED, Observer

from .gap_additions import with_terms
from .gap_motions import EXPERIMENT_S
from .gap_plan import Programme, motions_campaign, room_of
from .gap_results import rig_plant
from .parts import ExperimentStoppedError, Parts
from .worker_process import Said, Worker, at_once

ROUNDS: Final = 4
"""Greatest number of rounds: the programme, two experiments, and one round after a check."""
CHANNELS: Final = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
"""Channels that a recording must have so that a gap can be searched in it."""
CLOSED: Final = 0.8
"""Share of the gap that must be gone in a check so that no further round is run, although the check
was not adequate; less is needed if only chance is left."""

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class Question:
    """The question which effects a model lacks, to be answered by recordings.

    Attributes:
        rig: the rig of the recordings.
        model: the model to be tested.
        among: names of the effects to look for; all of the catalogue if empty.
        experiment_s: duration of a motion that distinguishes effects, s.
        wanted: what the revised model may hold of what is discovered.
    """

    rig: Rig
    model: Model
    among: tuple[str, ...] = ()
    experiment_s: float = EXPERIMENT_S
    wanted: Wanted = field(default_factory=Wanted)

    def plant(self) -> Plant:
        """Return the rig with the model, and the effects to look for, as the workflow's `Plant`."""
        room = room_of(self.rig)
        plant = rig_plant(self.model, self.rig.sensors, room, self.experiment_s)
        if not self.among:
            return plant
        return replace(plant, effects={name: plant.effects[name] for name in self.among})


def answer_to(
    said: Said, question: Question, fitted: Sequence[Path], held: Sequence[Path]
) -> GapResult:
    """Return the result of the gap search for a model.

    A recording that cannot be read, or lacks one of `CHANNELS`, raises RecordingError.

    Args:
        said: is told in words what is being done.
        question: rig, model, and effects to look for.
        fitted: files of the recordings that the model is fitted to.
        held: files of the recordings that are held out.
    """
    plant = question.plant()
    return find_gap(_read(fitted), _read(held), plant, wanted=question.wanted, said=said)


def checked(
    said: Said,
    question: Question,
    found: GapResult,
    fresh: Sequence[Path],
    held: Sequence[Path],
) -> tuple[Check, GapResult]:
    """Return the check of a revised model on new recordings, and the result with its gap on them.

    The result is that of the search, but with the new recordings in place of the held-out ones and
    with the gap on them. If the revised model predicts the new recordings worse than the given one,
    the effects, what was discovered and the refit are taken back in it.

    Args:
        said: is told in words what is being done.
        question: rig, given model, and effects to look for.
        found: result of the gap search, from which the revised model follows; it is not changed.
        fresh: files of recordings that were made after the model was revised.
        held: files of the recordings that are held out.
    """
    plant, recordings = question.plant(), _read(fresh)
    revised = replace(question, model=revised_model(question.model, found))
    again = find_gap(recordings, _read(held), revised.plant(), wanted=question.wanted, said=said)
    records = usable([record_of(recording, plant) for recording in recordings], plant)
    predictor, given = Predictor(plant), plant.nominal
    found = replace(found, reasons=list(found.reasons))
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        gaps = channel_gaps(predictor, records, given, found.values, pool)
        before, after = mean_gap(gaps)
        grown = growth(predictor, records, given, found.values, pool)
        worse = why_worse(grown, (before, after), named=bool(found.effects))
        if worse is not None:
            named = " and ".join(effect.name for effect in found.effects)
            take_back(found, plant, f"{named or 'the refit'}, on the check", worse)
            written = channel_gaps(predictor, records, given, given, pool)
        else:
            written = gaps
    seconds = sum(map(len, records)) * plant.period
    names = tuple(effect.name for effect in again.effects)
    scatter = float(np.mean([gap.scatter for gap in gaps]))
    places = tuple(each.where for each in again.discovered)
    check = Check(again.verdict, names, before, after, scatter, places)
    return check, replace(
        found,
        channels=written,
        gap_before=mean_gap(written)[0],
        gap_after=mean_gap(written)[1],
        holdout=[(each.source, each.content_hash()) for each in recordings],
        seconds=(found.seconds[0], seconds),
    )


def revised_model(given: Model, found: GapResult) -> Model:
    """Return the given model with what was found, also what was discovered; its name stays."""
    parameters, others = with_terms(found.values, given.discovered)
    return replace(given, parameters=parameters, discovered=others)


def _read(files: Sequence[Path]) -> list[Recording]:
    return [read_recording(file, required=CHANNELS) for file in files]


def close_gap(
    rig: Rig,
    given: Model,
    directory: Path,
    *,
    programme: Programme | None = None,
    rounds: int = ROUNDS,
    among: tuple[str, ...] = (),
    wanted: Wanted | None = None,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
    worker: Worker = at_once,
    seed: int = 0,
) -> GapResult:
    """Run motions on a rig until its model is adequate, and return the result with what it lacked.

    The rounds also end when nothing more can be found, or after `rounds` of them. If the rig trips
    between two motions, while the model is being fitted, the result follows from the recordings so
    far, and its `ended_by` says why.

    Args:
        rig: a simulated rig, or one on hardware.
        given: the model to be tested.
        directory: an existing folder; each campaign gets a folder in it.
        programme: the motions to run; the default programme if not given.
        rounds: greatest number of rounds, at least 1.
        among: names of the effects to look for; all of the catalogue if empty.
        wanted: what the model may hold of what is discovered; None for all but suspected leaks.
        pace: "real" to run at the wall clock, "fast" to run as fast as possible; the pace of the
            rig's file if not given.
        observer: its methods are called as the experiment goes on.
        stop: once a stop is requested on it, the experiment ends after the present batch.
        worker: runs the computations; `apart` lets the rig be supervised meanwhile.
        seed: sets the motions' phases, and the noise of a simulated rig.

    Raises:
        ExperimentStoppedError: the rig tripped in a motion, the experiment was stopped, or a test
            crashed.
        DirectoryError, DriverError, TripError, OSError: as for `run_campaign`.
        ApartError: the worker's process gave no result.
    """
    stop, observer = stop or StopFlag(), observer or Observer()
    plan = programme or Programme()
    question = Question(rig, given, among, plan.experiment_s, wanted or Wanted())
    closing = _Closing(question, plan, directory, observer, stop, worker, seed)
    first = closing.campaign("held_out", plan.held, rounds)
    bench = bench_of(first, rig, directory, observer, stop)
    with bench:
        return closing.run(Parts(rig, directory, bench, pace, observer, stop), bench, first, rounds)


class _Closing:
    """Runs the rounds of closing a gap, on a bench whose context has been entered."""

    def __init__(
        self,
        question: Question,
        plan: Programme,
        directory: Path,
        observer: Observer,
        stop: StopFlag,
        worker: Worker,
        seed: int,
    ) -> None:
        self._question, self._plan, self._directory = question, plan, directory
        self._observer, self._stop, self._worker, self._seed = observer, stop, worker, seed
        self._parts: Parts
        self._bench: Bench
        self._held: list[Path] = []
        self._fitted: list[Path] = []
        self._rounds: list[Round] = []
        self._tried: set[str] = set()
        self._tripped = ""

    def run(self, parts: Parts, bench: Bench, first: Campaign, rounds: int) -> GapResult:
        """Run the rounds, and return the result with a record of each round.

        Args:
            parts: runs the campaigns.
            bench: the bench, which is checked while the worker computes.
            first: the campaign whose recordings are held out.
            rounds: greatest number of rounds.
        """
        self._parts, self._bench = parts, bench
        self._held = list(parts.record(first).values())
        why, motions = "to excite what the catalogue has", self._plan.fitted
        while True:
            number = len(self._rounds) + 1
            made = self._record(f"round_{number}", motions, number)
            found = self._compute(answer_to, self._question, self._fitted, self._held)
            names = tuple(name for name, _ in motions)
            self._note(why, names, made, found, None)
            if self._tripped or found.verdict in ("adequate", "inconclusive"):
                break
            experiment = self._experiment(found)
            if experiment is not None and number < rounds:
                effects = " from ".join(name.replace("_", " ") for name in experiment.effects)
                why = f"to tell {effects}"
                motions = ((_motion_of(experiment), self._plan.experiment_s),)
                continue
            check, found = self._check(found, number)
            self._rounds[-1] = replace(self._rounds[-1], check=check)
            self._say(f"checked on a run of its own: {check.verdict}")
            if self._tripped or check.verdict == "adequate" or number >= rounds:
                break
            if self._is_done(found, check):
                break
            why, motions = "since the check was not adequate", self._plan.fitted
        found.rounds, found.ended_by = self._rounds, self._tripped
        return found

    def campaign(self, name: str, motions: tuple[tuple[str, float], ...], number: int) -> Campaign:
        """Return a campaign of motions; each `number` gives the motions other phases."""
        asked = self._question
        return motions_campaign(name, motions, asked.rig, asked.model, 1000 * self._seed + number)

    def _record(
        self, name: str, motions: tuple[tuple[str, float], ...], number: int
    ) -> tuple[str, ...]:
        """Run motions, add their recordings to those fitted to, and return their relative paths."""
        files = list(self._parts.record(self.campaign(name, motions, number)).values())
        self._fitted += files
        return tuple(str(file.relative_to(self._directory)) for file in files)

    def _experiment(self, found: GapResult) -> Separation | None:
        """Return the first proposed experiment whose motion was not run yet; None if there is none.

        Its motion counts as run from then on.
        """
        for experiment in found.experiments:
            if experiment.campaign and _motion_of(experiment) not in self._tried:
                self._tried.add(_motion_of(experiment))
                return experiment
        return None

    def _check(self, found: GapResult, number: int) -> tuple[Check, GapResult]:
        """Run new motions, and check the revised model on them; see `checked` for the result.

        Afterwards their recordings are added to those that the model is fitted to.
        """
        campaign = self.campaign(f"check_{number}", self._plan.check, 500 + number)
        fresh = list(self._parts.record(campaign).values())
        check, found = self._compute(checked, self._question, found, fresh, self._held)
        self._fitted += fresh
        return check, found

    @staticmethod
    def _is_done(found: GapResult, check: Check) -> bool:
        """Return whether a further round of the programme would bring nothing new.

        That is so if the check found nothing but what is known, and either most of the gap is gone
        (see `CLOSED`), or the check found again only what is left out of the model on purpose, such
        as a suspected leak.
        """
        known = {effect.name for effect in found.effects}
        known |= {rival.effect for effect in found.effects for rival in effect.indistinguishable}
        if not set(check.effects) <= known:
            return False
        left_out = {each.where for each in found.discovered if not each.in_model}
        if not set(check.discovered) <= left_out:
            return False
        if check.discovered:
            return True
        left = max((1.0 - CLOSED) * check.gap_before, SURE * check.scatter)
        return check.gap_after <= left and check.verdict != "unknown_effect"

    def _compute(
        self, function: Callable[Concatenate[Said, P], T], *args: P.args, **kwargs: P.kwargs
    ) -> T:
        """Return the result of a function that the worker calls while the rig is supervised."""
        return self._worker(self._wait, self._say, function, *args, **kwargs)

    def _wait(self) -> None:
        if self._stop.requested:
            raise ExperimentStoppedError(f"stopped by {self._stop.reason}", EXIT_STOPPED)
        if self._tripped:
            return
        try:
            self._bench.idle()
        except StopRequestedError:
            raise
        except TripError as error:
            # The rig is safe and the recordings are complete, so that they are still evaluated.
            self._tripped = str(error)
            self._say(f"{error}; what was recorded is still looked at")

    def _note(
        self,
        why: str,
        motions: tuple[str, ...],
        made: tuple[str, ...],
        found: GapResult,
        check: Check | None,
    ) -> None:
        effects, discovered = tuple(found.effects), tuple(found.discovered)
        self._rounds.append(Round(why, motions, made, found.verdict, effects, check, discovered))
        named = (
            " or ".join([effect.name, *(rival.effect for rival in effect.indistinguishable)])
            for effect in found.effects
        )
        names = ", ".join([*named, *(f"{d.name} in {d.where}" for d in found.discovered)])
        self._say(f"round {len(self._rounds)}: {found.verdict}{': ' if names else ''}{names}")

    def _say(self, text: str) -> None:
        self._observer.rig_tells(text)


def _motion_of(experiment: Separation) -> str:
    """Return the name of an experiment's motion in the library."""
    return str(experiment.campaign["tests"][0]["name"])
