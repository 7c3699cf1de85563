"""The friction experiment of section 3.1, run on a rig by itself.

First the ram slides: it slows down from fast strokes, and goes at constant speeds. A hold shows the
command at which it rests, around which slow ramps then make it break away at ten places. Ramps that
did not move it are repeated in closed loop. The rig is armed once for all of it.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimator.break_away import BreakAway, break_aways
from estimator.detection import Decision, Samples
from estimator.filters import FilterMemory, FilterRun
from estimator.friction import FrictionCurve, identify_recording
from estimator.friction_joint import JointFit, joint_fit
from estimator.friction_samples import Spring
from estimator.steady_strokes import SteadySpeed, steady_speeds
from estimator.stiction_level import StictionLevel, stiction_level
from faults.campaign import Campaign, CampaignTest
from faults.verdict import Verdict
from rig.configuration.rig import Rig
from rig.plant import Model
from rig.recording import Recording, read_recording

from .bench import Bench, Loop, Writer
from .campaign_run import bench_of, run_campaign
from .friction_plan import (
    NULL,
    PLACES,
    SLOWING_DOWN,
    SPEEDS,
    break_away_campaign,
    closed_loop_campaign,
    places_of,
    ramp_slope,
    sliding_campaign,
    strokes_of,
)
from .observer import Observer
from .outcome import EXIT_STOPPED, CampaignOutcome, Status
from .pacing import Pace
from .stopping import StopFlag

_NULL_FROM_S: Final = 2.0


class ExperimentStoppedError(Exception):
    """The experiment came to no end; its recordings so far are on disk.

    Attributes:
        exit_code: what the command exits with.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


@dataclass(frozen=True)
class FrictionExperiment:
    """What the experiment showed.

    Attributes:
        rig, assumed: what it was run on, and what was assumed of that.
        spring: the environment that was taken off.
        null_V: command at which the ram rests.
        sliding: identified from slowing down.
        speeds: strokes at constant speed, settled or not.
        places: break-aways of each ramp.
        level: what they have in common.
        fit: the law through all of it; None where sliding did not show all parameters.
        recordings: files, within the experiment's folder.
    """

    rig: str
    assumed: Model
    spring: Spring
    null_V: float  # noqa: N815
    sliding: FrictionCurve
    speeds: tuple[SteadySpeed, ...]
    places: tuple[tuple[BreakAway, ...], ...]
    level: StictionLevel
    fit: JointFit | None
    recordings: tuple[str, ...]


def run_friction_experiment(
    rig: Rig,
    assumed: Model,
    spring: Spring,
    directory: Path,
    *,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
    places: int = PLACES,
    speeds: tuple[float, ...] = SPEEDS,
    seed: int = 0,
) -> FrictionExperiment:
    """Run the experiment on a rig and return what it showed.

    Args:
        rig: simulated, or on hardware.
        assumed: the model; its friction is not used but for how far bristles bend.
        spring: the known environment.
        directory: an existing folder; each part of the experiment gets a folder in it.
        pace: "real" for the wall clock, "fast" for as fast as it can; the rig's own if not given.
        observer: is told how it goes on.
        stop: ends it after the present batch.
        places: along the stroke.
        speeds: shares of what the fully open valve delivers.
        seed: of a simulated rig's noise.

    Raises:
        ExperimentStoppedError: it tripped, was stopped, or a test crashed.
        DirectoryError, DriverError, TripError, OSError: as `run_campaign`.
    """
    stop, observer = stop or StopFlag(), observer or Observer()
    sliding = sliding_campaign(rig, assumed, speeds=speeds, seed=seed)
    bench = bench_of(sliding, rig, directory, observer, stop)
    parts = _Parts(rig, directory, _Kept(bench), pace, observer, stop)
    area = assumed.parameters.piston_area
    with bench:
        slid = parts.run(sliding)
        null_V = _null_command(slid[NULL])  # noqa: N806
        where = places_of(rig, null_V, places)
        broke = parts.run(break_away_campaign(rig, assumed, null_V, where, seed=seed))
        found = [break_aways(each, spring, area) for each in broke.values()]
        stuck = [place for place, each in zip(where, found, strict=True) if not _moved(each)]
        if stuck:
            again = closed_loop_campaign(rig, assumed, null_V, tuple(stuck), seed=seed)
            repeated = [break_aways(each, spring, area) for each in parts.run(again).values()]
            found = [each for each in found if _moved(each)] + repeated
    steady = [
        each
        for share, recording in zip(speeds, _after_first_two(slid), strict=True)
        for each in steady_speeds(
            recording, strokes_of(rig, assumed, share), spring, assumed.parameters
        )
    ]
    curve = identify_recording(slid[SLOWING_DOWN], assumed, spring, rig.sensors)
    level = stiction_level(found)
    return FrictionExperiment(
        rig=rig.name,
        assumed=assumed,
        spring=spring,
        null_V=null_V,
        sliding=curve,
        speeds=tuple(steady),
        places=tuple(found),
        level=level,
        fit=joint_fit(
            curve,
            level,
            steady,
            assumed.parameters,
            ramp_slope(rig, assumed, closed_loop=bool(stuck)),
        ),
        recordings=tuple(parts.recordings),
    )


def _moved(found: Sequence[BreakAway]) -> bool:
    return bool(found) and all(each.taken_off for each in found)


def _after_first_two(slid: Mapping[str, Recording]) -> list[Recording]:
    return [recording for name, recording in slid.items() if name not in (NULL, SLOWING_DOWN)]


def _null_command(recording: Recording) -> float:
    """Return the mean command of a hold, V: where a ram rests, or around which it hunts."""
    time_s = recording.time_s - recording.time_s[0]
    return float(np.nanmean(recording.channels["command_V"][time_s >= _NULL_FROM_S]))


class _Parts:
    """Runs the campaigns that the experiment consists of, one after the other."""

    def __init__(
        self,
        rig: Rig,
        directory: Path,
        bench: Bench,
        pace: Pace | None,
        observer: Observer,
        stop: StopFlag,
    ) -> None:
        self._rig, self._directory, self._bench = rig, directory, bench
        self._pace: Pace | None = pace
        self._observer, self._stop = observer, stop
        self.recordings: list[str] = []

    def run(self, campaign: Campaign) -> dict[str, Recording]:
        """Run a campaign to its end and return the recording of each test, by its name."""
        folder = self._directory / campaign.name
        outcome = run_campaign(
            campaign, self._rig, folder, pace=self._pace, observer=self._observer,
            stop=self._stop, detector=_Undecided, bench=self._bench,
        )  # fmt: skip
        _require_complete(outcome)
        found = {}
        for test in outcome.tests:
            file = folder / str(test.recording)
            self.recordings.append(str(file.relative_to(self._directory)))
            found[test.name] = read_recording(file)
            self._bench.idle()
        return found


def _require_complete(outcome: CampaignOutcome) -> None:
    for test in outcome.tests:
        if test.status in (Status.PASSED, Status.FAILED):
            continue
        message = f"{test.name}: {test.status}; {test.message or 'nothing was identified'}"
        crashed = test.status == Status.ERROR
        raise ExperimentStoppedError(message, 1 if crashed else EXIT_STOPPED)


class _Undecided:
    """A detector that holds nothing: the experiment looks for no leak."""

    def __init__(self, model: Model) -> None:
        self._decision = Decision(Verdict.INCONCLUSIVE)

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take no note."""

    def decide(self) -> Decision:
        """Return that nothing can be said."""
        return self._decision


class _Kept:
    """A bench that is entered and left by someone else, so that several campaigns share it."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.live = bench.live

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> Loop:
        return self._bench.loop(test, memory, assumed)

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> AbstractContextManager[Writer]:
        return self._bench.writer(path, channels, metadata)

    def reading(self, channel: str) -> float | None:
        return self._bench.reading(channel)

    def idle(self) -> None:
        self._bench.idle()

    def __enter__(self) -> "_Kept":
        return self

    def __exit__(self, *_: object) -> None:
        pass
