"""A baseline is learnt on from later recordings by explicit acceptance, up to a cap."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.accounts.nuisances import NUISANCE_COUNT, NUISANCES, UNINFORMED, nuisance_index
from estimator.baselines import accepting
from estimator.baselines.accepting import accepted_onto, hidden_flows
from estimator.baselines.baseline import Baseline, BaselineError
from estimator.baselines.baseline_file import load_baseline, write_baseline
from estimator.leaks.pattern import HealthyLevel
from estimator.learnt.noise import RegimeNoise
from estimator.learnt.tail import Tail
from rig.plant import LITRE_PER_MINUTE, NOMINAL, Model, model_sha256
from rig.recording import Recording
from tests.estimator.baselines.test_baseline import in_a_sine
from tests.estimator.learnt.made_up import moving_blocks, noise

LEVELS = {name: HealthyLevel(np.zeros(2), np.ones(2), 40) for name in ("thesis-6", "thesis-7")}


@pytest.fixture(scope="module")
def later() -> Recording:
    return in_a_sine(21)


@pytest.fixture
def baseline() -> Baseline:
    regimes = {name: RegimeNoise(600.0, 0.3, 0.0, 0.0) for name in ("moving", "fast", "loaded")}
    belief = replace(UNINFORMED, covariance=0.3**2 * np.eye(NUISANCE_COUNT))
    return Baseline(
        belief,
        LEVELS,
        {"first": "0"},
        "nominal",
        1.0,
        model_sha256(Model()),
        noise(regimes=regimes),
    )


def test_what_was_accepted_is_kept_beside_the_commissioning(
    baseline: Baseline, later: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accepting, "belief_of", lambda *_: baseline.nuisances)
    grown = accepted_onto(baseline, [later], Model())
    assert grown.commissioning == baseline
    assert set(grown.recordings) == {"first", "seed 21"}
    assert [set(each.recordings) for each in grown.accepted] == [{"seed 21"}]
    assert grown.noise is not None
    assert grown.noise.tail.hours > 1.0
    path = tmp_path / "rig.json"
    write_baseline(grown, path)
    loaded = load_baseline(path, Model())
    assert loaded.noise == grown.noise
    assert loaded.accepted == grown.accepted
    assert loaded.commissioning is not None
    assert loaded.commissioning.noise == baseline.noise


def test_a_recording_is_accepted_once(baseline: Baseline, later: Recording) -> None:
    again = replace(baseline, recordings={"first": later.content_hash()})
    with pytest.raises(BaselineError, match="seed 21: is in the baseline already, as first"):
        accepted_onto(again, [later], Model())


def test_without_learnt_noise_there_is_nothing_to_learn_on_from(
    baseline: Baseline, later: Recording
) -> None:
    with pytest.raises(BaselineError, match=r"no learnt noise.*ten minutes"):
        accepted_onto(replace(baseline, noise=None), [later], Model())


def test_small_steps_of_a_slow_leak_are_refused_in_the_end(
    baseline: Baseline, later: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each step hides 0.004 L/min more of a leak that the latest baseline takes for normal."""
    monkeypatch.setattr(
        accepting, "hidden_flows", lambda _, moved, *rest: np.array([float(moved[0]), 0.0, 0.0])
    )
    steps = iter((0.004, 0.008, 0.012))

    def moved_on(*_: object) -> object:
        mean = np.zeros(NUISANCE_COUNT)
        mean[0] = next(steps)
        return replace(baseline.nuisances, mean=mean)

    monkeypatch.setattr(accepting, "belief_of", moved_on)
    grown = baseline
    for _ in range(2):
        grown = replace(accepted_onto(grown, [later], Model()), recordings={})
    with pytest.raises(BaselineError, match=r"external_leakage_1: .* hide 0\.012 L/min .*0\.01 in"):
        accepted_onto(grown, [later], Model())


def test_noise_that_grows_too_far_is_refused(
    baseline: Baseline, later: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    restless = replace(baseline.noise or noise(), tail=Tail(3.0, 1.0, 60, 200.0))
    monkeypatch.setattr(accepting, "_later_noise", lambda *_: restless)
    with pytest.raises(BaselineError, match=r"the limit at 10 alarms a day would be"):
        accepted_onto(baseline, [later], Model())


def test_a_seal_that_lets_more_through_hides_a_leak_of_that_flow() -> None:
    blocks = moving_blocks(40, 3)
    seal = nuisance_index("seal_leakage_1")
    coefficient = 0.02 * LITRE_PER_MINUTE / np.mean([block.sizes[0] for block in blocks])
    sealed = []
    for block in blocks:
        nuisances = block.nuisances.copy()
        nuisances[:, seal] = NUISANCES[seal].sigma * block.faults[:, 0]
        sealed.append(replace(block, nuisances=nuisances))
    moved = np.zeros(NUISANCE_COUNT)
    moved[seal] = coefficient / NUISANCES[seal].sigma
    hidden = hidden_flows([sealed], moved, noise(), NOMINAL)
    assert hidden[0] == pytest.approx(0.02, rel=0.01)
    assert hidden_flows([sealed], -moved, noise(), NOMINAL)[0] == 0.0
