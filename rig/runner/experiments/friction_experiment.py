"""Runs the friction experiment of the thesis, section 3.1, automatically on a rig.

First the ram slides: it slows down from fast strokes, and moves at constant speeds. A hold shows
the command at which the ram rests. Slow ramps around that command then make it break away at ten
positions. Where a ramp did not move the ram, it is repeated in closed loop. The rig is armed once
for the whole experiment. The results can be converted to JSON, and to a revised model.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimator.friction import (
    PARAMETERS,
    BreakAway,
    FrictionCurve,
    JointFit,
    Spring,
    SteadySpeed,
    StictionLevel,
    Trend,
    break_aways,
    identify_recording,
    joint_fit,
    steady_among,
    steady_speeds,
    stiction_level,
)
from rig.configuration import Rig
from rig.plant import Model, model_sha256
from rig.recording import Recording
from rig.runner.campaign import Pace, StopFlag
from rig.runner.outcomes import Observer, friction_figures, jsonable, named, versions

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
from .parts import connected_parts

SCHEMA: Final = "rig-friction"
"""Value of the key `schema`, by which `friction.json` is recognized."""
INTERVAL: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""
_NULL_FROM_S: Final = 2.0


@dataclass(frozen=True)
class FrictionExperiment:
    """The results of the friction experiment.

    Attributes:
        rig: name of the rig.
        assumed: the model that was assumed.
        spring: the spring load, whose force was subtracted.
        null_V: command at which the ram rests, V.
        sliding: friction curve identified while the ram slows down.
        speeds: results of all strokes at constant speed, settled or not.
        places: break-aways of each ramp, one tuple for each position; those of the ramps that were
            repeated in closed loop come last.
        level: stiction level that all break-aways have in common.
        fit: the friction law fitted to all results; None if the sliding part did not show all
            parameters.
        recordings: paths of the recordings, relative to the experiment's folder.
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
    """Run the friction experiment on a rig and return its results.

    Args:
        rig: a simulated rig, or one on hardware.
        assumed: the assumed model; of its friction only the bristles' deflection is used.
        spring: the known spring load.
        directory: an existing folder; each part of the experiment gets a folder in it.
        pace: "real" to run at the wall clock, "fast" to run as fast as possible; the pace of the
            rig's file if not given.
        observer: its methods are called as the experiment goes on.
        stop: once a stop is requested on it, the experiment ends after the present batch.
        places: number of positions along the stroke at which break-aways are measured.
        speeds: constant speeds, as shares of the ram's speed with the valve fully open.
        seed: sets the noise of a simulated rig.

    Raises:
        ExperimentStoppedError: the rig tripped in a test, the experiment was stopped, or a test
            crashed.
        DirectoryError: a folder of the experiment cannot be used.
        DriverError: a device of the rig is missing, or is not the configured one.
        TripError: the rig tripped before or between the tests.
        OSError: the results cannot be written.
    """
    sliding = sliding_campaign(rig, assumed, speeds=speeds, seed=seed)
    area = assumed.parameters.piston_area
    with connected_parts(sliding, rig, directory, pace, observer, stop) as parts:
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
    constant = [slid[name] for name in slid if name not in (NULL, SLOWING_DOWN)]
    steady = [
        each
        for share, recording in zip(speeds, constant, strict=True)
        for each in steady_speeds(
            recording, strokes_of(rig, assumed, share), spring, assumed.parameters
        )
    ]
    curve = identify_recording(slid[SLOWING_DOWN], assumed, spring, rig.sensors)
    level = stiction_level(found)
    slope = ramp_slope(rig, assumed, closed_loop=bool(stuck))
    return FrictionExperiment(
        rig=rig.name,
        assumed=assumed,
        spring=spring,
        null_V=null_V,
        sliding=curve,
        speeds=tuple(steady),
        places=tuple(found),
        level=level,
        fit=joint_fit(curve, level, steady, assumed.parameters, slope),
        recordings=tuple(parts.recordings),
    )


def _moved(found: Sequence[BreakAway]) -> bool:
    return bool(found) and all(each.taken_off for each in found)


def _null_command(recording: Recording) -> float:
    """Return the mean command of a hold, V, without the first 2 s.

    At this command the ram rests, or the command oscillates about it.
    """
    time_s = recording.time_s - recording.time_s[0]
    return float(np.nanmean(recording.channels["command_V"][time_s >= _NULL_FROM_S]))


def experiment_figures(experiment: FrictionExperiment) -> dict[str, Any]:
    """Return the experiment's results as JSON-able values in SI; other programs rely on the keys.

    A figure that is not known is None.
    """
    level, fit, spring = experiment.level, experiment.fit, experiment.spring
    counted = steady_among(experiment.speeds, experiment.sliding)
    content = {
        "schema": SCHEMA,
        "rig": experiment.rig,
        "model": experiment.assumed.name,
        "identified": fit is not None,
        "parameters": fit
        and {
            name: named(estimate, "value", "standard_error", "unit")
            for name, estimate in fit.estimates.items()
        },
        **named(fit, stiction_measured_N="measured_stiction"),
        **named(fit, stiction_measured_error_N="measured_error", presliding_deficit_N="deficit"),
        **named(fit, disagreement_z="disagreement", misfit="misfit"),
        "break_away": {
            **named(level, "places", level_N="level", level_error_N="level_error"),
            **named(level, offset_N="offset", offset_error_N="offset_error"),
            "level_trend": _trend(level.level_trend),
            "offset_trend": _trend(level.offset_trend),
            "all": [
                named(each, "direction", position_m="position", force_N="force")
                | named(each, standard_error_N="standard_error", creep_m_per_s="velocity")
                | {"taken_off": each.taken_off}
                for found in experiment.places
                for each in found
            ],
        },
        "constant_speed": [
            named(each, velocity_m_per_s="velocity", force_N="force")
            | named(each, standard_error_N="standard_error", settled="settled")
            | {"used": each in counted}
            for each in experiment.speeds
        ],
        "slowing_down": friction_figures(experiment.sliding),
        "null_command_V": experiment.null_V,
        **named(spring, spring_stiffness_N_per_m="stiffness", spring_contact_m="contact"),
        "recordings": experiment.recordings,
    }
    return dict(jsonable(content))


def revised_model(experiment: FrictionExperiment, directory: Path, started: str) -> Model | None:
    """Return the assumed model with the identified friction; None if none was identified.

    The model is named RIG-friction and has the effect `friction_asymmetry`. Its provenance names
    the rig, the time and the assumed model, and has the parameters' 95 % intervals and the hashes
    of the recordings, which are read for that.

    Args:
        experiment: the results of the experiment.
        directory: the experiment's folder, which holds the recordings.
        started: when the experiment began, UTC, as text.
    """
    fit, assumed = experiment.fit, experiment.assumed
    if fit is None:
        return None
    provenance = {
        "made_by": "rig identify friction --rig",
        "rig": experiment.rig,
        "started": started,
        "parent": assumed.name,
        "parent_sha256": model_sha256(assumed),
        "versions": versions(),
        "intervals_95": {
            name: [value - INTERVAL * error, value + INTERVAL * error]
            for name, estimate in fit.estimates.items()
            for value, error in [(estimate.value or 0.0, estimate.standard_error or 0.0)]
        },
        "stiction_measured_N": jsonable(fit.measured_stiction),
        "break_away_places": experiment.level.places,
        "recordings": {
            name: hashlib.sha256((directory / name).read_bytes()).hexdigest()
            for name in experiment.recordings
        },
    }
    asymmetry = fit.values[PARAMETERS.index("friction_asymmetry")]
    return replace(
        assumed,
        name=f"{experiment.rig}-friction",
        parameters=fit.parameters(assumed.parameters),
        provenance=provenance,
    ).with_effect("friction_asymmetry", value=asymmetry)


def _trend(trend: Trend) -> dict[str, Any]:
    return named(trend, slope_N_per_m="slope", standard_error_N_per_m="standard_error") | {
        "significant": bool(trend.significant)
    }
