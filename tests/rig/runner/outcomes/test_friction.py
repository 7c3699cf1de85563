"""A campaign's friction: in its outcome and its results, as `rig identify friction` finds it."""

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control import Constant
from estimator.friction.curve import FrictionCurve, identify_recording
from estimator.friction.fit import PARAMETERS
from estimator.friction.samples import Spring
from estimator.leaks import PatternDetector
from faults.campaign import Campaign
from rig.configuration import load_campaign
from rig.plant import DATA_SHEET, Model
from rig.recording import Recording, read_recording
from rig.runner.campaign.bench import plain_test
from rig.runner.campaign.campaign_run import run_campaign
from rig.runner.outcomes import friction
from rig.runner.outcomes.friction import (
    FrictionWatch,
    change_figures,
    friction_figures,
    model_spring,
)
from rig.runner.outcomes.outcome import CampaignOutcome
from rig.runner.outcomes.recorded import sensors_of, spring_of
from rig.runner.run_folder.results import results


def test_the_session_hears_of_its_runner_while_friction_is_identified(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard = threading.Event()
    monkeypatch.setattr(friction, "_ALIVE_S", 0.001)
    monkeypatch.setattr(friction, "identify_friction", lambda *_: heard.wait(60.0))
    test = plain_test("a", Constant(0.3), 5.0, 0.3, 1.0)
    watch = FrictionWatch(PatternDetector(1.0), test, Model(), DATA_SHEET, heard.set)
    watch._watching = True
    assert watch.curve


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("friction") / "run"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """The first test of the shipped experiment."""
    shipped, _ = load_campaign("friction_3_1")
    return replace(shipped, tests=shipped.tests[:1])


@pytest.fixture(scope="module")
def outcome(campaign: Campaign, directory: Path) -> CampaignOutcome:
    _, rig = load_campaign("friction_3_1")
    return run_campaign(campaign, rig, directory)


@pytest.fixture
def curve(outcome: CampaignOutcome) -> FrictionCurve:
    found = outcome.tests[0].friction
    assert found is not None
    return found


def test_the_shipped_experiment_recovers_the_friction_of_the_simulated_rig(
    curve: FrictionCurve,
) -> None:
    _, rig = load_campaign("friction_3_1")
    for name in PARAMETERS:
        estimate = curve.estimates[name]
        assert estimate.value is not None
        assert estimate.standard_error is not None
        error = estimate.value - float(getattr(rig.plant.parameters, name))
        assert abs(error) < 3.0 * estimate.standard_error, name


def test_a_recording_tells_the_friction_that_the_run_told(
    curve: FrictionCurve, outcome: CampaignOutcome, campaign: Campaign, directory: Path
) -> None:
    recording = read_recording(directory / str(outcome.tests[0].recording))
    spring = spring_of(recording) or model_spring(campaign.model)
    again = identify_recording(recording, campaign.model, spring, sensors_of(recording))
    for name in PARAMETERS:
        assert again.estimates[name].value == pytest.approx(curve.estimates[name].value, rel=1e-6)


def test_results_hold_each_parameter_with_error_and_unit(outcome: CampaignOutcome) -> None:
    written = results(outcome)["tests"][0]["friction"]
    assert written["coulomb"]["unit"] == "N"
    assert written["viscous"]["unit"] == "N s/m"
    assert 0.0 < written["stiction"]["standard_error"] < written["stiction"]["value"]
    assert {each["velocity_m_per_s"] > 0.0 for each in written["bins"]} == {True, False}


def test_a_curve_has_not_changed_from_itself(curve: FrictionCurve) -> None:
    changes = change_figures(curve, curve)
    assert set(changes) == set(PARAMETERS)
    assert not any(change["significant"] for change in changes.values())
    assert friction_figures(curve)["strokes"] == curve.strokes


@pytest.mark.parametrize(
    ("metadata", "spring"),
    [
        ({}, None),
        ({"test": {"load": None}}, None),
        ({"test": {"load": {"stiffness": 2e4, "contact": 0.22}}}, Spring(2e4, 0.22)),
        ({"test": {"load": {"stiffness": "soft"}}}, None),
    ],
)
def test_the_spring_is_what_the_recording_tells(
    metadata: dict[str, object], spring: Spring | None
) -> None:
    assert spring_of(Recording({"time_s": np.arange(2.0)}, metadata)) == spring
