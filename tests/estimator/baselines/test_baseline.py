"""A baseline tells the detector what is normal for one rig."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.accounts.nuisances import NUISANCES
from estimator.baselines.baseline import Baseline, BaselineError, learn_baseline
from estimator.baselines.baseline_file import load_baseline, write_baseline
from estimator.leaks.replaying import replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from tools.simulated.recordings import recorded

TRUTH = Model(
    parameters=Model().parameters._replace(
        spool_null_bias=4e-6, discharge_coefficient=0.612, bulk_modulus=6.4e8
    )
)


def in_a_sine(seed: int, internal_leakage: float = 0.0, amplitude: float = 0.15) -> Recording:
    """Return 20 s of a rig in a 0.5 Hz sine, the leak (m^3/(s Pa^0.5)) there from the start."""
    time_s = np.arange(20000) * TICK
    faults = np.zeros((time_s.size, 8))
    faults[:, 2] = internal_leakage
    setpoint = 0.3 + amplitude * np.sin(np.pi * time_s)
    motion = Motion(setpoint, False, faults, 0.3, 1000)
    return replace(recorded(simulated_rig(TRUTH, seed), motion), source=f"seed {seed}")


def old_file(baseline: Baseline, folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Write a baseline as before there was a checksum, with a change; return the file."""
    path = folder / "rig.json"
    write_baseline(baseline, path)
    content: dict[str, Any] = json.loads(path.read_text())
    del content["content_sha256"]
    content["baseline_version"] = 1
    change(content)
    path.write_text(json.dumps(content))
    return path


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    return learn_baseline([in_a_sine(1), in_a_sine(2, amplitude=0.05)], Model())


def test_it_knows_the_null_bias_of_the_rig(baseline: Baseline) -> None:
    index = [nuisance.name for nuisance in NUISANCES].index("spool_null_bias")
    sigma = NUISANCES[index].sigma
    found = sigma * baseline.nuisances.mean[index]
    deviation = sigma * np.sqrt(baseline.nuisances.covariance[index, index])
    assert abs(found - 4e-6) < 2.0 * deviation
    assert deviation < 0.2 * sigma


def test_a_leak_that_was_always_there_is_found_with_it_only(baseline: Baseline) -> None:
    leaking = in_a_sine(3, internal_leakage=3e-9)
    assert replay(leaking, Model()).decision.verdict != "internal_leakage"
    detector = baseline.detector("product", Model(), 1.0)
    decision = replay(leaking, Model(), detector=detector).decision
    assert decision.verdict == "internal_leakage"
    assert decision.onset_s == pytest.approx(0.0, abs=0.01)
    assert decision.coefficient == pytest.approx(3e-9, rel=0.1)


def test_a_leak_that_was_always_there_is_not_taken_for_normal() -> None:
    leaking = [in_a_sine(seed, internal_leakage=6e-9) for seed in (1, 2)]
    assert replay(leaking[0], Model()).decision.verdict != "internal_leakage"
    with pytest.raises(BaselineError, match=r"internal_leakage is likely: find the leak"):
        learn_baseline(leaking, Model())


def test_the_rig_it_was_learnt_from_stays_healthy(baseline: Baseline) -> None:
    detector = baseline.detector("product", Model(), 1.0)
    assert replay(in_a_sine(4), Model(), detector=detector).decision.verdict == "healthy"


def test_the_thesis_filters_judge_by_its_healthy_levels(baseline: Baseline) -> None:
    detector = baseline.detector("thesis-6", Model(), 1.0)
    result = replay(in_a_sine(5), Model(), filter_name="thesis-6", detector=detector)
    assert result.decision.verdict == "healthy"
    assert result.history[0][1].verdict != "inconclusive"


def test_it_survives_a_file_bit_for_bit(baseline: Baseline, tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    write_baseline(baseline, path)
    loaded = load_baseline(path, Model())
    assert np.array_equal(loaded.nuisances.mean, baseline.nuisances.mean)
    assert np.array_equal(loaded.nuisances.covariance, baseline.nuisances.covariance)
    for name, level in baseline.levels.items():
        assert np.array_equal(loaded.levels[name].deviation, level.deviation)
    assert loaded.recordings == baseline.recordings
    assert [entry.name for entry in tmp_path.iterdir()] == ["rig.json"]


def test_it_says_how_far_the_model_may_be_off(baseline: Baseline, tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    write_baseline(replace(baseline, model_error=0.0), path)
    exact = load_baseline(path, Model())
    assert exact.model_error == 0.0
    decided = [
        replay(in_a_sine(4), Model(), detector=each.detector("product", Model(), 1.0)).decision
        for each in (baseline, exact)
    ]
    assert [decision.verdict for decision in decided] == ["healthy", "healthy"]
    usual, without = (each.details["smallest_internal_leakage_m3_per_s"] for each in decided)
    assert without < 0.3 * usual


def test_a_file_from_before_there_was_this_factor_means_one(
    baseline: Baseline, tmp_path: Path
) -> None:
    path = old_file(baseline, tmp_path, lambda content: content.pop("model_error"))
    assert load_baseline(path, Model()).model_error == 1.0


def test_a_file_from_before_there_were_hashes_and_noise_is_read(
    baseline: Baseline, tmp_path: Path
) -> None:
    def change(content: dict[str, Any]) -> None:
        for key in ("model_sha256", "noise", "commissioning", "accepted"):
            del content[key]

    loaded = load_baseline(old_file(baseline, tmp_path, change), Model())
    assert (loaded.model_hash, loaded.noise, loaded.accepted) == ("", None, ())
    assert np.array_equal(loaded.nuisances.mean, baseline.nuisances.mean)


def test_it_belongs_to_the_values_of_its_model_and_not_to_its_name(
    baseline: Baseline, tmp_path: Path
) -> None:
    path = tmp_path / "rig.json"
    write_baseline(baseline, path)
    with pytest.raises(BaselineError, match=r"model_sha256: .*another one.*rig baseline --model"):
        load_baseline(path, Model(parameters=TRUTH.parameters))


def test_noise_is_not_learnt_from_less_than_ten_minutes(baseline: Baseline) -> None:
    assert baseline.noise is None


def test_a_file_with_the_level_of_a_filter_that_is_no_more_is_read(
    baseline: Baseline, tmp_path: Path
) -> None:
    def change(content: dict[str, Any]) -> None:
        levels = content["innovation_levels_Pa"]
        levels["thesis-7-ud"] = levels["thesis-7"]

    loaded = load_baseline(old_file(baseline, tmp_path, change), Model())
    assert set(loaded.levels) == {"thesis-6", "thesis-7"}


def test_a_leaking_recording_is_no_baseline() -> None:
    leaking = in_a_sine(6)
    leaking.channels["spool_m"][10000:] += 8e-6
    with pytest.raises(BaselineError, match="seed 6: the recording is"):
        learn_baseline([in_a_sine(1), leaking], Model())


def test_a_ram_that_stood_still_says_nothing() -> None:
    with pytest.raises(BaselineError, match=r"inconclusive.*motion of centimetres"):
        learn_baseline([in_a_sine(7, amplitude=0.0)], Model())


def test_no_recording_is_no_baseline() -> None:
    with pytest.raises(BaselineError, match="no recording"):
        learn_baseline([], Model())


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda content: content.pop("tolerance_mean"), "tolerance_mean"),
        (lambda content: content.update(baseline_version=99), "version is 99"),
        (lambda content: content.update(tolerance_covariance=[[1.0]]), "23 rows of 23 numbers"),
        (lambda content: content["innovation_levels_Pa"].pop("thesis-6"), "thesis-6: there is no"),
        (lambda content: content.update(recordings=3), "recordings: 3 is no"),
        (lambda content: content.update(model_error=-1.0), "model_error: -1.0 is outside 0 to 10"),
        (lambda content: content["nuisances"].pop("bulk_modulus"), "bulk_modulus: there is no"),
        (
            lambda content: content.update(noise={"regimes": {"flying": {}}}),
            "noise: peaks: there is",
        ),
        (lambda content: content.update(model="thesis"), "beside the model thesis, not nominal"),
    ],
)
def test_a_damaged_file_is_named_with_its_remedy(
    baseline: Baseline, tmp_path: Path, damage: Callable[[dict[str, Any]], object], says: str
) -> None:
    path = old_file(baseline, tmp_path, damage)
    with pytest.raises(BaselineError, match=says) as caught:
        load_baseline(path, Model())
    assert str(caught.value).startswith(str(path))
    assert "make it anew with rig baseline" in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match=r"nothing\.json"):
        load_baseline(tmp_path / "nothing.json", Model())
