"""Makes the metadata of a test's recording, and reads from it what a replay needs.

The metadata holds all that a replay, or a reader in ten years, needs to know, as plain values in
SI. A replay takes transducers, spring, baseline and learnt thresholds from it, so that it comes to
the same decisions as the run.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np

from estimator.baselines import baseline_of, content_of
from estimator.filters import DEFAULT_FILTER, FILTERS, OUTPUTS
from estimator.friction import Spring
from estimator.leaks import (
    Detector,
    OilAccountDetector,
    PatternBaseline,
    PatternDetector,
    filter_recording,
)
from faults import Campaign, CampaignTest
from rig.configuration import Rig, plain
from rig.loop import VERDICT_CODES
from rig.plant import DATA_SHEET, Model, Parameters, SensorParameters, model_sha256
from rig.recording import REPLAY_CHANNELS, Recording, unit_of

from .calibrations import calibrations_applied
from .thresholds import Learning

METADATA_VERSION: Final = 1
_BASELINE: Final = ("normal", "thresholds")
_UNREADABLE: Final = (KeyError, TypeError, ValueError, AttributeError, np.linalg.LinAlgError)
"""Errors by which metadata that cannot be read is recognized."""


def metadata_of(
    campaign: Campaign,
    rig: Rig,
    test: CampaignTest,
    learning: Learning,
    channels: tuple[str, ...],
    provenance: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the metadata of the recording of one test, as plain values.

    Args:
        campaign: the campaign as configured.
        rig: the rig as configured; for a simulated rig this includes its true model.
        test: the test as configured.
        learning: what the detector was given about the healthy rig.
        channels: names of the recording's channels.
        provenance: result of `rig.runner.outcomes.software_state.provenance` for the campaign.
    """
    return {
        "metadata_version": METADATA_VERSION,
        "campaign": {"name": campaign.name, "description": campaign.description},
        "test": plain(test),
        "faults": plain(test.faults),
        "expect": str(test.expect),
        "seed": test.seed,
        "rig": plain(rig),
        "sensors": plain(rig.sensors),
        "model": plain(campaign.model),
        "detector": {
            "filter": campaign.filter_name,
            "false_alarms_per_day": campaign.false_alarms_per_day,
            "baseline_Pa": None
            if learning.baseline is None
            else {key: getattr(learning.baseline, key).tolist() for key in _BASELINE},
            "baseline_from": learning.source,
            "baseline": None if campaign.baseline is None else content_of(campaign.baseline),
        },
        "verdict_codes": [str(verdict) for verdict in VERDICT_CODES],
        "units": {channel: unit_of(channel) for channel in channels},
        "provenance": plain(provenance),
        **calibrations_applied(rig),
    }


def assumed_parameters(metadata: Mapping[str, Any]) -> Parameters | None:
    """Return the parameters that the filter assumed, from the key `model` of the metadata.

    A parameter of an effect that is newer than the recording gets the value at which the effect is
    absent. The result is None if no parameters can be read.
    """
    try:
        recorded = dict(metadata["model"]["parameters"])
        known = {name: float(recorded[name]) for name in Parameters._fields if name in recorded}
    except (KeyError, TypeError, ValueError):
        return None
    return Parameters(**known) if "piston_area" in known else None


def with_estimates(recording: Recording) -> Recording:
    """Return a recording with the channels that its file leaves out, as the test's loop had them.

    They are what the filter estimated; it runs over the recording again, and comes to the same bits
    if the recording begins where the test did. A recording from which nothing was left out, or
    whose metadata do not name filter and model, is returned as it is.

    Args:
        recording: a recording as it was read, of a campaign's test.
    """
    parameters = assumed_parameters(recording.metadata)
    saved = recording.metadata.get("detector")
    chosen = FILTERS.get(str(saved.get("filter"))) if isinstance(saved, Mapping) else None
    lacking = [name for name in REPLAY_CHANNELS if name not in recording]
    if not recording.replayed or parameters is None or chosen is None or lacking:
        return recording
    model = Model(parameters=parameters)
    run = filter_recording(recording, model, chosen.name, sensors_of(recording))
    states = {f"est_{name}": run.state(name) for name in chosen.states}
    made = states | dict(zip(OUTPUTS, run.outputs.T, strict=True))
    again = {name: np.ascontiguousarray(made[name]) for name in recording.replayed if name in made}
    left = tuple(name for name in recording.replayed if name not in made)
    return replace(recording, channels=recording.channels | again, replayed=left)


def sensors_of(recording: Recording) -> SensorParameters:
    """Return the data sheet of the transducers in a recording's metadata.

    If the metadata has none that can be read, that of the thesis's rig is returned.
    """
    saved = recording.metadata.get("sensors")
    with suppress(TypeError, ValueError):
        return SensorParameters(**{name: float(value) for name, value in dict(saved or {}).items()})
    return DATA_SHEET


def spring_of(recording: Recording) -> Spring | None:
    """Return the spring load of a recorded test; None if the metadata names no readable one."""
    with suppress(KeyError, TypeError, ValueError):
        load = recording.metadata["test"]["load"]
        return Spring(float(load["stiffness"]), float(load["contact"]))
    return None


def account_detector_of(
    recording: Recording, model: Model, false_alarms_per_day: float
) -> OilAccountDetector | None:
    """Return a new detector of oil accounts with the baseline that was used for a recorded test.

    The detector has no baseline if the test used none. The result is None if the test used one that
    cannot be read from the metadata.

    Args:
        recording: the recording of a campaign's test.
        model: the model that was assumed, according to the recording.
        false_alarms_per_day: the rate that the campaign allowed.
    """
    saved = recording.metadata.get("detector")
    baseline = saved.get("baseline") if isinstance(saved, Mapping) else None
    if baseline is None:
        return OilAccountDetector(model, false_alarms_per_day)
    try:
        known = baseline_of(baseline)
    except _UNREADABLE:
        return None
    return known.account_detector(model, false_alarms_per_day)


def detector_of(
    recording: Recording, model: Model, filter_name: str, false_alarms_per_day: float
) -> Detector | None:
    """Return a new detector with the baseline or the learnt thresholds of a recorded test.

    The result is None if the metadata holds neither, or if the test assumed another model. Learnt
    thresholds are used only if filter and rate of false alarms are those of the test, and the
    filter is not the default one; else the result is None, too.

    Args:
        recording: the recording of a campaign's test.
        model: the model that the new detector assumes.
        filter_name: name of the filter whose estimates the new detector judges.
        false_alarms_per_day: rate of false alarms to allow.
    """
    metadata = recording.metadata
    with suppress(*_UNREADABLE):
        saved = metadata["detector"]
        if metadata["provenance"]["model_sha256"] != model_sha256(model):
            return None
        if saved.get("baseline") is not None:
            known = baseline_of(saved["baseline"])
            return known.detector(filter_name, model, false_alarms_per_day)
        normal, thresholds = (np.array(saved["baseline_Pa"][key], dtype=float) for key in _BASELINE)
        if (
            filter_name != DEFAULT_FILTER
            and saved["filter"] == filter_name
            and saved["false_alarms_per_day"] == false_alarms_per_day
            and normal.shape == thresholds.shape == (2,)
        ):
            return PatternDetector(false_alarms_per_day, PatternBaseline(normal, thresholds))
    return None
