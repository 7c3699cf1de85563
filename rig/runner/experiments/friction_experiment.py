"""The friction experiment of section 3.1, run on a rig by itself.

First the ram slides: it slows down from fast strokes, and goes at constant speeds. A hold shows the
command at which it rests, around which slow ramps then make it break away at ten places. Ramps that
did not move it are repeated in closed loop. The rig is armed once for all of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from estimator.friction import (
    BreakAway,
    FrictionCurve,
    JointFit,
    Spring,
    SteadySpeed,
    StictionLevel,
    break_aways,
    identify_recording,
    joint_fit,
    steady_speeds,
    stiction_level,
)
from rig.configuration import Rig
from rig.plant import Model
from rig.recording import Recording
from rig.runner.campaign import Pace, StopFlag, bench_of
from rig.runner.outcomes import Observer

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
from .parts import Parts

_NULL_FROM_S: Final = 2.0


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
        observer: is called as the experiment goes on.
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
    parts = Parts(rig, directory, bench, pace, observer, stop)
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
