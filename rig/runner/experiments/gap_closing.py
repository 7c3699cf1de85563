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
from typing import Final

import numpy as np

from estimator.gap import (
    SURE,
    Check,
    Fitter,
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
from rig.runner.campaign import Pace, StopFlag
from rig.runner.outcomes import EXIT_STOPPED, Observer

from .gap_motions import CHECK, EXPERIMENT_S, FITTED, HELD, Motions, motions_campaign, room_of
from .gap_results import rig_plant, with_terms
from .parts import ExperimentStoppedError, Parts, connected_parts
from .worker_process import Said, Worker

ROUNDS: Final = 4
"""Greatest number of rounds: the programme, two experiments, and one round after a check."""
CHANNELS: Final = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
"""Channels that a recording must have so that a gap can be searched in it."""
CLOSED: Final = 0.8
"""Share of the gap that must be gone in a check so that no further round is run, although the check
was not adequate; less is needed if only chance is left."""


@dataclass(frozen=True)
class Question:
    """The question which effects a model lacks, to be answered by recordings.

    Attributes:
        rig: the rig of the recordings.
        model: the model to be tested.
        wanted: which discovered disturbances the revised model may hold.
    """

    rig: Rig
    model: Model
    wanted: Wanted = field(default_factory=Wanted)

    def plant(self) -> Plant:
        """Return the rig with the model as the workflow's `Plant`."""
        return rig_plant(self.model, self.rig.sensors, room_of(self.rig))


def answer_to(
    said: Said, question: Question, fitted: Sequence[Path], held: Sequence[Path]
) -> GapResult:
    """Search in recordings for what a model lacks, and return the result.

    Args:
        said: is called with a line of text on what is being done.
        question: rig and model, and what the revised model may hold.
        fitted: files of the recordings that the model is fitted to.
        held: files of the recordings that are held out.

    Raises:
        RecordingError: a recording cannot be read, or lacks one of `CHANNELS`.
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
    """Check a revised model on new recordings; return the check, and the result revised by it.

    The check is a further gap search: it says what the revised model still lacks. The second result
    is a copy of `found` whose gap is that on the new recordings, which stand in place of those held
    out. If the revised model predicts the new recordings worse than the given one, this copy has
    the values of the given model, and nothing discovered is in its model. If it is worse beyond
    chance, the copy also names no effects.

    Args:
        said: is called with a line of text on what is being done.
        question: rig and given model, and what a revised model may hold.
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
        grown = growth(Fitter(predictor, records, pool), given, found.values)
        written = gaps
        worse = why_worse(grown, (before, after), named=bool(found.effects))
        if worse is not None:
            named = " and ".join(effect.name for effect in found.effects)
            take_back(found, plant, f"{named or 'the refit'}, on the check", worse)
            written = channel_gaps(predictor, records, given, given, pool)
    seconds = sum(map(len, records)) * plant.period
    names = tuple(effect.name for effect in again.effects)
    scatter = float(np.mean([gap.scatter for gap in gaps]))
    places = tuple(each.where for each in again.discovered)
    check = Check(again.verdict, names, before, after, scatter, places)
    found.channels, (found.gap_before, found.gap_after) = written, mean_gap(written)
    found.holdout = [(each.source, each.content_hash()) for each in recordings]
    found.seconds = found.seconds[0], seconds
    return check, found


def revised_model(given: Model, found: GapResult) -> Model:
    """Return the given model with the parameters and the discovered disturbances of a result.

    The model's name and its list of effects stay.
    """
    parameters, others = with_terms(found.values, given.discovered)
    return replace(given, parameters=parameters, discovered=others)


def _read(files: Sequence[Path]) -> list[Recording]:
    return [read_recording(file, required=CHANNELS) for file in files]


def close_gap(
    rig: Rig,
    given: Model,
    directory: Path,
    *,
    worker: Worker,
    rounds: int = ROUNDS,
    wanted: Wanted | None = None,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
    seed: int = 0,
) -> GapResult:
    """Run motions on a rig until its model is adequate, and return what the given model lacked.

    The rounds also end when nothing more can be found, or after `rounds` of them. If the rig trips
    between two motions, while the model is being fitted, the result follows from the recordings so
    far, and its `ended_by` says why.

    Args:
        rig: a simulated rig, or one on hardware.
        given: the model to be tested.
        directory: an existing folder; each campaign gets a folder in it.
        worker: runs the computations; `apart` lets the rig be supervised meanwhile.
        rounds: greatest number of rounds, at least 1.
        wanted: which discovered disturbances the model may hold; None for all but suspected leaks.
        pace: "real" to run at the wall clock, "fast" to run as fast as possible; the pace of the
            rig's file if not given.
        observer: its methods are called as the experiment goes on.
        stop: once a stop is requested on it, the experiment ends after the present batch.
        seed: sets the motions' phases, and the noise of a simulated rig.

    Raises:
        ExperimentStoppedError: the rig tripped in a motion, the experiment was stopped, or a test
            crashed.
        DirectoryError: a folder of the experiment cannot be used.
        DriverError: a device of the rig is missing, or is not the configured one.
        TripError: the rig tripped before the first test, or just after a campaign.
        OSError: the results cannot be written.
        ApartError: the worker's process gave no result.
    """
    question = Question(rig, given, wanted or Wanted())

    def campaign(name: str, motions: Motions, number: int) -> Campaign:
        return motions_campaign(name, motions, rig, given, 1000 * seed + number)

    first = campaign("held_out", HELD, rounds)
    with connected_parts(first, rig, directory, pace, observer, stop) as parts:
        return _Closing(question, campaign, parts, worker).run(first, rounds)


@dataclass
class _Closing:
    """Runs the rounds of closing a gap, on a bench whose context has been entered.

    Attributes:
        question: rig and model.
        campaign: returns a campaign, given its name, its motions, and a number; with each number
            the motions have other phases.
        parts: runs the campaigns; its bench is checked while the worker computes.
        worker: runs the computations.
        held: files of the recordings that are held out.
        fitted: files of the recordings that the model is fitted to.
        rounds: the rounds so far.
        tried: names of the motions of experiments that were run.
        tripped: why the rig tripped; empty if it did not.
    """

    question: Question
    campaign: Callable[[str, Motions, int], Campaign]
    parts: Parts
    worker: Worker
    held: list[Path] = field(default_factory=list)
    fitted: list[Path] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    tried: set[str] = field(default_factory=set)
    tripped: str = ""

    def run(self, first: Campaign, rounds: int) -> GapResult:
        """Run the rounds, and return the last round's result with a record of each round.

        Args:
            first: the campaign whose recordings are held out.
            rounds: greatest number of rounds.
        """
        asked, say = self.question, self.parts.observer.rig_tells
        self.held = list(self.parts.record(first).values())
        why, motions = "to excite what the catalogue has", FITTED
        while True:
            number = len(self.rounds) + 1
            campaign = self.campaign(f"round_{number}", motions, number)
            made = list(self.parts.record(campaign).values())
            self.fitted += made
            found = self.worker(self._wait, say, answer_to, asked, self.fitted, self.held)
            self._note(why, motions, made, found)
            if self.tripped or found.verdict in ("adequate", "inconclusive"):
                break
            experiment = self._experiment(found)
            if experiment is not None and number < rounds:
                effects = " from ".join(name.replace("_", " ") for name in experiment.effects)
                why = f"to tell {effects}"
                motions = ((_motion_of(experiment), EXPERIMENT_S),)
                continue
            # New motions check the revised model, and are fitted to afterwards.
            campaign = self.campaign(f"check_{number}", CHECK, 500 + number)
            fresh = list(self.parts.record(campaign).values())
            check, found = self.worker(self._wait, say, checked, asked, found, fresh, self.held)
            self.fitted += fresh
            self.rounds[-1] = replace(self.rounds[-1], check=check)
            say(f"checked on a run of its own: {check.verdict}")
            if self.tripped or check.verdict == "adequate" or number >= rounds:
                break
            if self.is_done(found, check):
                break
            why, motions = "since the check was not adequate", FITTED
        found.rounds, found.ended_by = self.rounds, self.tripped
        return found

    def _experiment(self, found: GapResult) -> Separation | None:
        """Return the first proposed experiment whose motion was not run yet; None if there is none.

        Its motion counts as run from then on.
        """
        for experiment in found.experiments:
            if experiment.campaign and _motion_of(experiment) not in self.tried:
                self.tried.add(_motion_of(experiment))
                return experiment
        return None

    @staticmethod
    def is_done(found: GapResult, check: Check) -> bool:
        """Return whether a further round of the programme would bring nothing new.

        That is so if the check named no effects but those that the search had named, or rivals of
        them, and if one of two things holds. Either all that the check discovered is left out of
        the model on purpose, as a suspected leak is. Or it discovered nothing, its verdict is not
        `unknown_effect`, and what is left of the gap is at most the share 1 - `CLOSED` of it, or no
        more than chance.
        """
        known = {effect.name for effect in found.effects}
        known |= {rival.effect for effect in found.effects for rival in effect.indistinguishable}
        left_out = {each.where for each in found.discovered if not each.in_model}
        if not (set(check.effects) <= known and set(check.discovered) <= left_out):
            return False
        if check.discovered:
            return True
        left = max((1.0 - CLOSED) * check.gap_before, SURE * check.scatter)
        return check.gap_after <= left and check.verdict != "unknown_effect"

    def _wait(self) -> None:
        """Check the rig once; the worker calls this again and again while it computes.

        A trip is kept in `tripped`, and is not raised.

        Raises:
            ExperimentStoppedError, StopRequestedError: a stop was requested.
        """
        stop = self.parts.stop
        if stop.requested:
            raise ExperimentStoppedError(f"stopped by {stop.reason}", EXIT_STOPPED)
        if self.tripped:
            return
        try:
            self.parts.bench.idle()
        except StopRequestedError:
            raise
        except TripError as error:
            # The rig is safe and the recordings are complete, so that they are still evaluated.
            self.tripped = str(error)
            self.parts.observer.rig_tells(f"{error}; what was recorded is still looked at")

    def _note(self, why: str, motions: Motions, made: Sequence[Path], found: GapResult) -> None:
        """Add a round to `rounds`, and tell the operator what it has found."""
        names = tuple(name for name, _ in motions)
        files = tuple(str(file.relative_to(self.parts.directory)) for file in made)
        effects, discovered = tuple(found.effects), tuple(found.discovered)
        self.rounds.append(Round(why, names, files, found.verdict, effects, None, discovered))
        named = (
            " or ".join([effect.name, *(rival.effect for rival in effect.indistinguishable)])
            for effect in found.effects
        )
        told = ", ".join([*named, *(f"{d.name} in {d.where}" for d in found.discovered)])
        words = f"round {len(self.rounds)}: {found.verdict}{': ' if told else ''}{told}"
        self.parts.observer.rig_tells(words)


def _motion_of(experiment: Separation) -> str:
    """Return the name of an experiment's motion in the library."""
    return str(experiment.campaign["tests"][0]["name"])
