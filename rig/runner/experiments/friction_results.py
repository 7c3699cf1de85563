"""Converts the results of the friction experiment to JSON, and to a revised model."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from estimator.friction import PARAMETERS, BreakAway, FrictionEstimate, Trend, steady_among
from rig.plant import Model
from rig.runner.outcomes import friction_figures, model_sha256, versions

from .friction_experiment import FrictionExperiment

SCHEMA: Final = "rig-friction"
"""Value of the key `schema`, by which `friction.json` is recognized."""
INTERVAL: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""


def experiment_figures(experiment: FrictionExperiment) -> dict[str, Any]:
    """Return the experiment's results as JSON-able values in SI; other programs rely on the keys.

    A figure that is not known is None.
    """
    level, fit = experiment.level, experiment.fit
    counted = steady_among(experiment.speeds, experiment.sliding)
    return {
        "schema": SCHEMA,
        "rig": experiment.rig,
        "model": experiment.assumed.name,
        "identified": fit is not None,
        "parameters": None if fit is None else _estimates(fit.estimates),
        "stiction_measured_N": None if fit is None else _number(fit.measured_stiction),
        "stiction_measured_error_N": None if fit is None else _number(fit.measured_error),
        "presliding_deficit_N": None if fit is None else _number(fit.deficit),
        "disagreement_z": None if fit is None else _number(fit.disagreement),
        "misfit": None if fit is None else _number(fit.misfit),
        "break_away": {
            "places": level.places,
            "level_N": _number(level.level),
            "level_error_N": _number(level.level_error),
            "offset_N": _number(level.offset),
            "offset_error_N": _number(level.offset_error),
            "level_trend": _trend(level.level_trend),
            "offset_trend": _trend(level.offset_trend),
            "all": [_break_away(each) for found in experiment.places for each in found],
        },
        "constant_speed": [
            {
                "velocity_m_per_s": each.velocity,
                "force_N": each.force,
                "standard_error_N": each.standard_error,
                "settled": each.settled,
                "used": each in counted,
            }
            for each in experiment.speeds
        ],
        "slowing_down": friction_figures(experiment.sliding),
        "null_command_V": experiment.null_V,
        "spring_stiffness_N_per_m": experiment.spring.stiffness,
        "spring_contact_m": experiment.spring.contact,
        "recordings": list(experiment.recordings),
    }


def revised_model(experiment: FrictionExperiment, directory: Path, started: str) -> Model | None:
    """Return the assumed model with the identified friction; None if none was identified.

    The model is named RIG-friction and has the effect `friction_asymmetry`. Its provenance has the
    experiment, the intervals, and the hashes of the recordings, which are read for that.

    Args:
        experiment: the results of the experiment.
        directory: the experiment's folder, which holds the recordings.
        started: when the experiment began, UTC, as text.
    """
    fit, assumed = experiment.fit, experiment.assumed
    if fit is None:
        return None
    revised = replace(
        assumed,
        name=f"{experiment.rig}-friction",
        parameters=fit.parameters(assumed.parameters),
        provenance={},
    ).with_effect("friction_asymmetry", value=fit.values[PARAMETERS.index("friction_asymmetry")])
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
        "stiction_measured_N": _number(fit.measured_stiction),
        "break_away_places": experiment.level.places,
        "recordings": {
            name: hashlib.sha256((directory / name).read_bytes()).hexdigest()
            for name in experiment.recordings
        },
    }
    return replace(revised, provenance=provenance)


def _estimates(estimates: Mapping[str, FrictionEstimate]) -> dict[str, Any]:
    return {
        name: {key: getattr(each, key) for key in ("value", "standard_error", "unit")}
        for name, each in estimates.items()
    }


def _break_away(each: BreakAway) -> dict[str, Any]:
    return {
        "direction": each.direction,
        "position_m": each.position,
        "force_N": each.force,
        "standard_error_N": each.standard_error,
        "creep_m_per_s": each.velocity,
        "taken_off": each.taken_off,
    }


def _trend(trend: Trend) -> dict[str, Any]:
    return {
        "slope_N_per_m": _number(trend.slope),
        "standard_error_N_per_m": _number(trend.standard_error),
        "significant": bool(trend.significant),
    }


def _number(value: float) -> float | None:
    """Return a figure as a float; None if it is NaN or infinite, as JSON has neither."""
    return float(value) if abs(value) < float("inf") else None
