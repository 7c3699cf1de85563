"""A drift of the encoder is named alone where it is sure, otherwise beside other faults."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.encoder import DriftTest, EncoderDrift
from estimator.leaks import Decision, found_in, replay
from estimator.leaks.drift_watch import DriftWatch
from estimator.leaks.finding import Finding
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, NOMINAL, TICK, Model
from rig.recording import Recording
from tools.simulated.drawn_rigs import MIDDLE, multisine
from tools.simulated.recordings import SETTLE_TICKS, recorded

SURE = EncoderDrift(2e-3, 3e-4, 20.0, 9.0, 5.5, 150.0)
OPEN = replace(SURE, could_also_be=("internal_leakage", "null_shift"))
LEAK = Decision("internal_leakage", 20.0, 1e-6, 1e-7, statistic=7.0, threshold=5.8)
HEALTHY = Decision("healthy")


def watch(monkeypatch: pytest.MonkeyPatch, *found: EncoderDrift | None) -> DriftWatch:
    """Return a watch whose test finds these drifts, one in each search."""
    made = DriftWatch(lambda: DriftTest(NOMINAL, 1.0))
    left = iter(found)
    monkeypatch.setattr(made._test, "search", lambda: next(left))
    return made


def finding(likelihood: float) -> Finding:
    return Finding(2, 40, 1e-9, 1e-11, 7.0, likelihood, 20.0, 1.0)


def test_a_sure_drift_takes_the_place_of_a_leak_that_explains_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    named = watch(monkeypatch, SURE).beside(LEAK, 30.0, [finding(90.0)])
    assert (named.verdict, named.drift, named.onset_s) == ("encoder_drift", SURE, 20.0)
    assert named.could_also_be == ()
    assert named.leak_m3_per_s is None


def test_two_faults_that_together_explain_as_much_stay_the_verdict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    several = replace(LEAK, verdict="multiple")
    found = [finding(90.0), finding(50.0)]
    assert watch(monkeypatch, SURE).beside(several, 30.0, found) == several


def test_until_they_are_told_apart_the_verdict_names_all_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    leak = watch(monkeypatch, OPEN).beside(LEAK, 30.0, [finding(90.0)])
    assert leak.verdict == "internal_leakage"
    assert leak.could_also_be == ("encoder_drift", "null_shift")
    silent = watch(monkeypatch, OPEN).beside(HEALTHY, 30.0, [])
    assert silent.verdict == "inconclusive"
    assert silent.could_also_be == ("encoder_drift", "internal_leakage", "null_shift")
    assert silent.suspected is None


def test_a_verdict_that_the_drift_cannot_be_mistaken_for_is_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    external = replace(LEAK, verdict="external_leakage_1")
    assert watch(monkeypatch, OPEN).beside(external, 30.0, [finding(90.0)]) == external


def test_a_drift_that_was_named_for_5_s_stays_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    drifts = watch(monkeypatch, SURE, SURE, None, None)
    assert drifts.beside(HEALTHY, 30.0, []).verdict == "encoder_drift"
    assert drifts.beside(HEALTHY, 35.0, []).verdict == "encoder_drift"
    assert drifts.beside(HEALTHY, 40.0, []).verdict == "encoder_drift"
    larger = replace(LEAK, statistic=SURE.statistic + 1.0)
    assert drifts.beside(larger, 41.0, [finding(90.0)]) == larger


def test_a_drift_that_passes_sooner_is_withdrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    drifts = watch(monkeypatch, SURE, None)
    assert drifts.beside(HEALTHY, 30.0, []).verdict == "encoder_drift"
    assert drifts.beside(HEALTHY, 32.0, []) == HEALTHY


def drifting(seconds: float, onset_s: float, rate: float) -> Recording:
    """Return a recording in closed loop of a rig whose encoder drifts by `rate` (m/s).

    A loop whose reading is off by d asks for the setpoint less d of the ram itself.
    """
    n = round(seconds / TICK)
    away = rate * np.maximum(np.arange(n) * TICK - onset_s, 0.0)
    setpoint = multisine(np.random.default_rng(5), n) - away
    motion = Motion(setpoint, False, np.zeros((n, len(FAULT_COLUMNS))), MIDDLE, SETTLE_TICKS)
    made = recorded(simulated_rig(Model(parameters=NOMINAL), 3), motion)
    return Recording({**made.channels, "position_m": made["position_m"] + away})


def test_an_encoder_that_drifts_by_2_mm_a_second_is_named_within_30_s() -> None:
    history = replay(drifting(36.0, 10.0, 2e-3), Model()).history
    assert history[19][1].verdict == "healthy"
    assert history[-1][1].verdict == "encoder_drift"
    drift = history[-1][1].drift
    assert drift is not None
    assert abs(drift.rate_m_per_s - 2e-3) < 2.0 * drift.deviation_m_per_s
    assert [each.decision.verdict for each in found_in(history)] == ["encoder_drift"]
