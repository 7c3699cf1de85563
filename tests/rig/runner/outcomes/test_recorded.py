import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.setpoints import Sine
from estimator.accounts.nuisances import UNINFORMED, NuisanceBelief
from estimator.baselines.baseline import PATTERN_FILTERS, Baseline
from estimator.leaks.pattern import HealthyLevel
from estimator.leaks.replaying import ReplayResult, replay
from faults.campaign import Campaign, CampaignTest, SpringLoad
from faults.schedule import Fault
from faults.verdict import Verdict
from rig.configuration.rigs.rig import Rig
from rig.plant import Model
from rig.plant.sensors import DATA_SHEET
from rig.recording import Recording, export, read_recording
from rig.runner import TestOutcome, run_campaign
from rig.runner.campaign import simulated_bench
from rig.runner.outcomes.recorded import detector_of, sensors_of, with_estimates

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


@pytest.fixture
def undivided(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have runs record what their filter estimated in every sample, as it was then."""
    monkeypatch.setattr(simulated_bench, "division_of", lambda channels: None)


COARSE = DATA_SHEET._replace(position_resolution=1e-4, pressure_noise=5e4)


def replayed(recording: Recording, campaign: Campaign) -> ReplayResult:
    name, rate = campaign.filter_name, campaign.false_alarms_per_day
    return replay(
        recording,
        campaign.model,
        filter_name=name,
        false_alarms_per_day=rate,
        detector=detector_of(recording, campaign.model, name, rate),
        sensors=sensors_of(recording),
    )


def assert_same(recording: Recording, outcome: TestOutcome, campaign: Campaign) -> None:
    result = replayed(recording, campaign)
    for state in result.run.filter.states:
        np.testing.assert_array_equal(recording[f"est_{state}"], result.run.state(state))
    np.testing.assert_array_equal(
        recording["innovation_pressure_1_Pa"], result.run.innovation[:, 1]
    )
    assert result.decision == outcome.decision
    assert result.detected_at_s == outcome.detected_at_s


@pytest.mark.usefixtures("undivided")
@pytest.mark.parametrize(
    "filter_name",
    ["product", "thesis-6", pytest.param("thesis-7", marks=pytest.mark.long)],
)
def test_a_replay_comes_to_the_estimates_and_decisions_of_the_run_bit_for_bit(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    leaking: MakeTest,
    make_campaign: MakeCampaign,
    filter_name: str,
) -> None:
    spring = SpringLoad(2e4, 0.35)
    tests = (make_test(), leaking(), leaking(name="loaded", load=spring))
    campaign = make_campaign(*tests, filter_name=filter_name)
    outcome = run_campaign(campaign, replace(rig, sensors=COARSE), tmp_path)
    for test in outcome.tests:
        assert_same(read_recording(tmp_path / str(test.recording)), test, campaign)


@pytest.mark.usefixtures("undivided")
@pytest.mark.parametrize(
    "setpoint",
    [Sine(0.3, 0.2, 0.5, 0.1, "position"), Sine(0.0, 2.0, 0.5, 1.0, "command")],
)
def test_a_replay_does_so_where_the_rig_has_no_spool_sensor(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign, setpoint: Sine
) -> None:
    campaign = make_campaign(make_test(setpoint=setpoint, duration_s=6.0))
    blind = replace(rig, has_spool_sensor=False, has_supply_pressure_sensor=False)
    outcome = run_campaign(campaign, blind, tmp_path)
    assert_same(read_recording(tmp_path / "healthy.mcap"), outcome.tests[0], campaign)


@pytest.mark.usefixtures("undivided")
@pytest.mark.parametrize("ticks", [3000, 3217])
def test_a_replay_does_so_for_a_test_that_ends_between_two_blocks(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign, ticks: int
) -> None:
    campaign = make_campaign(make_test(duration_s=ticks * 1e-3))
    outcome = run_campaign(campaign, rig, tmp_path)
    recording = read_recording(tmp_path / "healthy.mcap")
    assert len(recording) == ticks
    assert_same(recording, outcome.tests[0], campaign)


@pytest.mark.usefixtures("undivided")
def test_a_recording_that_went_through_parquet_replays_the_same(
    tmp_path: Path, rig: Rig, make_test: MakeTest, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(make_test(), leaking(), filter_name="thesis-6")
    outcome = run_campaign(campaign, rig, tmp_path)
    export(read_recording(tmp_path / "external_leakage_1.mcap"), tmp_path / "leak.parquet")
    assert_same(read_recording(tmp_path / "leak.parquet"), outcome.tests[1], campaign)


@pytest.mark.usefixtures("undivided")
@pytest.mark.parametrize(
    "filter_name", ["product", pytest.param("thesis-6", marks=pytest.mark.long)]
)
def test_a_replay_does_so_where_the_campaign_had_a_baseline(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign, filter_name: str
) -> None:
    always = leaking(faults=(Fault(Verdict.EXTERNAL_LEAKAGE_1, 5e-9),))
    level = HealthyLevel(np.full(2, 3e4), np.full(2, 1e3), 10)
    well_known = NuisanceBelief(UNINFORMED.mean, 1e-3 * UNINFORMED.covariance)
    baseline = Baseline(well_known, dict.fromkeys(PATTERN_FILTERS, level), {}, "nominal")
    campaign = make_campaign(always, filter_name=filter_name)
    knowing = replace(campaign, baseline=baseline, baseline_file="rig.json")
    outcome = run_campaign(knowing, rig, tmp_path / "knowing").tests[0]
    assert outcome.thresholds_from == "baseline rig.json"
    assert_same(read_recording(tmp_path / "knowing" / "external_leakage_1.mcap"), outcome, knowing)
    if filter_name == "product":
        assert outcome.decision is not None
        assert outcome.decision.verdict == "external_leakage_1"
        without = run_campaign(campaign, rig, tmp_path / "without").tests[0]
        assert without.decision is not None
        assert without.decision.verdict != "external_leakage_1"


@pytest.fixture
def recording(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign
) -> Recording:
    campaign = make_campaign(leaking(load=SpringLoad(2e4, 0.35)))
    run_campaign(campaign, rig, tmp_path)
    return read_recording(tmp_path / "external_leakage_1.mcap")


def test_a_replay_makes_all_that_a_recording_leaves_out_again_bit_for_bit(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    campaign = make_campaign(make_test(duration_s=4.0))
    run_campaign(campaign, replace(rig, sensors=COARSE), tmp_path / "divided")
    monkeypatch.setattr(simulated_bench, "division_of", lambda channels: None)
    run_campaign(campaign, replace(rig, sensors=COARSE), tmp_path / "undivided")
    divided, undivided = (tmp_path / folder / "healthy.mcap" for folder in ("divided", "undivided"))
    assert divided.stat().st_size < 0.5 * undivided.stat().st_size
    recording, whole = read_recording(divided), read_recording(undivided)
    assert "est_pressure_1_Pa" not in recording
    assert "innovation_pressure_1_Pa" in recording.replayed
    assert with_estimates(recording).content_hash() == whole.content_hash()
    assert with_estimates(whole) is whole


def test_the_metadata_tells_the_whole_test_in_json(recording: Recording) -> None:
    metadata = recording.metadata
    assert json.loads(json.dumps(metadata)) == metadata
    assert metadata["seed"] == 7
    assert metadata["test"]["setpoint"]["amplitude"] == 0.2
    assert metadata["test"]["load"]["stiffness"] == 2e4
    assert metadata["faults"][0]["kind"] == "external_leakage_1"
    assert metadata["faults"][0]["until_s"] is None
    assert metadata["model"]["parameters"] == Model().parameters._asdict()
    assert metadata["rig"]["plant"]["parameters"]["piston_area"] == 6.33e-4
    assert metadata["detector"]["filter"] == "product"
    assert metadata["units"]["flow_1_m3_per_s"] == "m^3/s"
    assert set(metadata["units"]) == {*recording.channels, *recording.replayed}
    assert {"rig", "python", "numpy", "numba", "mcap"} <= set(metadata["provenance"]["versions"])


@pytest.mark.parametrize(
    "metadata",
    [
        {},
        {"sensors": None, "detector": None},
        {"sensors": {"pressure_noise": "loud"}, "detector": {"baseline_Pa": {"normal": [1]}}},
        {"sensors": [1], "detector": []},
        {"sensors": {"unheard_of": 1.0}, "detector": {"filter": "thesis-6"}},
    ],
)
def test_of_a_stranger_s_recording_the_usual_is_assumed(metadata: dict[str, object]) -> None:
    stranger = Recording({"time_s": np.zeros(1)}, metadata)
    assert sensors_of(stranger) == DATA_SHEET
    assert detector_of(stranger, Model(), "thesis-6", 1.0) is None


@pytest.mark.parametrize(
    ("model", "filter_name", "rate"),
    [
        (Model(), "thesis-7", 1.0),
        (Model(), "product", 1.0),
        (Model(), "thesis-6", 0.1),
        (Model(parameters=Model().parameters._replace(viscous=400.0)), "thesis-6", 1.0),
    ],
)
def test_thresholds_learnt_under_other_assumptions_are_not_used(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    leaking: MakeTest,
    make_campaign: MakeCampaign,
    model: Model,
    filter_name: str,
    rate: float,
) -> None:
    run_campaign(make_campaign(make_test(), leaking(), filter_name="thesis-6"), rig, tmp_path)
    recording = read_recording(tmp_path / "external_leakage_1.mcap")
    assert detector_of(recording, Model(), "thesis-6", 1.0) is not None
    assert detector_of(recording, model, filter_name, rate) is None
