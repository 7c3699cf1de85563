"""Filters and accounts use the effects of the model that they are given, and lose by not doing so.

On a rig with an effect of the catalogue, the model that has it must do as well as the nominal one
does on the nominal rig, and better than the nominal one does here.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.product_lanes import ProductLanes
from estimator.filters.product_model import DYNAMIC, STATE_COUNT, predict_product
from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.oil_account import OilAccount
from estimator.leaks.replaying import filter_recording, replay, samples_of
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import NO_FAULT, NOMINAL, Model, Parameters
from rig.plant.added_terms import AddedTerm, fields_of
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.simulated.recordings import recorded

Array = NDArray[np.float64]

ONSET_S: Final = 12.0
EFFECTS: Final = {
    "pressure_1_bias": 2.5e5,
    "pressure_2_gain": 1.1,
    "position_gain": 1.05,
    "valve_deadband": 5e-6,
    "valve_underlap_leakage": 5e-6,
    "valve_flow_asymmetry": 0.1,
    "valve_hysteresis": 5e-6,
    "command_delay": 0.004,
    "return_back_pressure": 3e12,
    "supply_droop": 3e12,
}


@cache
def with_effect(effect: str, leak_L_per_min: float = 0.0, seconds: float = 16.0) -> Recording:  # noqa: N803
    """Return a run of a rig with an effect, and from `ONSET_S` on a leak of chamber 1."""
    model = Model().with_effect(effect, value=EFFECTS[effect]) if effect else Model()
    return of_model(model, leak_L_per_min, seconds)


def of_model(model: Model, leak_L_per_min: float = 0.0, seconds: float = 16.0) -> Recording:  # noqa: N803
    """Return a run of a rig that is a model, and from `ONSET_S` on a leak of chamber 1."""
    time_s = np.arange(round(seconds / TICK)) * TICK
    faults = np.tile(np.array(NO_FAULT), (time_s.size, 1))
    faults[time_s >= ONSET_S, 0] = leak_L_per_min * LITRE_PER_MINUTE / np.sqrt(6.9e6)
    waves = (np.sin(2.0 * np.pi * f * time_s + f * f * 9.0) for f in (0.2, 0.5, 0.9))
    motion = Motion(0.3 + 0.05 * sum(waves), False, faults, 0.3, 1500)
    rig = simulated_rig(model, 1, supply_pressure_sensor=False)
    return recorded(rig, motion)


@dataclass(frozen=True)
class Worth:
    """Missing oil in L/min and pressure errors in Pa (2,), root mean squares."""

    missing: float
    pressure: Array


def worth(recording: Recording, model: Model) -> Worth:
    run = filter_recording(recording, model)
    account = OilAccount(model.parameters, LeakTest(1.0))
    missing = [block.missing for block in account.add(samples_of(recording), run)]
    settled = slice(3000, None)
    errors = [
        (run.state(f"pressure_{i}_Pa") - recording[f"true_pressure_{i}_Pa"])[settled]
        for i in (1, 2)
    ]
    flow = np.sqrt(np.mean(np.square(missing[3:]))) / LITRE_PER_MINUTE
    return Worth(float(flow), np.sqrt(np.mean(np.square(errors), axis=1)))


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_model_with_the_effect_accounts_for_the_oil_and_the_nominal_one_does_not(
    effect: str,
) -> None:
    usual = worth(with_effect(""), Model())
    informed = worth(with_effect(effect), Model().with_effect(effect, value=EFFECTS[effect]))
    nominal = worth(with_effect(effect), Model())
    assert informed.missing < usual.missing + 0.003
    assert informed.missing < 0.34 * nominal.missing
    assert (informed.pressure < 1.1 * usual.pressure).all()
    assert (informed.pressure < 1.02 * nominal.pressure).all()


TERMS: Final = {
    "a flow": AddedTerm(
        "flow, chamber 1", "position", "bump", False, -0.3 * LITRE_PER_MINUTE, 0.3, 0.05
    ),
    "a leak at one place": AddedTerm(
        "leak across the piston", "position", "bump", False, 1.2e-8, 0.3, 0.05
    ),
    "worn edges": AddedTerm(
        "valve edges", "spool opening", "table", False, 1.0,
        knots=((-8e-5, 0.0), (-2e-5, 4e-6), (2e-5, 4e-6), (8e-5, 0.0)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TERMS)
def test_a_model_with_an_added_term_accounts_for_its_flow(name: str) -> None:
    lost = Model(parameters=NOMINAL._replace(**fields_of((TERMS[name],))))
    recording = of_model(lost)
    informed = worth(recording, lost).missing
    assert informed < worth(with_effect(""), Model()).missing + 0.01
    assert informed < 0.2 * worth(recording, Model()).missing


def test_an_added_term_takes_a_leak_of_its_size_off_the_accounts() -> None:
    coefficient = 0.2 * LITRE_PER_MINUTE / np.sqrt(6.9e6)
    leaking = of_model(Model(parameters=NOMINAL._replace(external_leakage_1=coefficient)))
    knots = tuple((p, -coefficient * float(np.sqrt(p))) for p in np.linspace(1e6, 13e6, 9).tolist())
    term = AddedTerm("flow, chamber 1", "pressure 1", "table", False, 1.0, knots=knots)
    blind = Model(parameters=NOMINAL._replace(**fields_of((term,))))
    assert worth(leaking, Model()).missing > 0.1
    assert worth(leaking, blind).missing < worth(with_effect(""), Model()).missing + 0.003


@pytest.mark.parametrize("effect", ["pressure_1_bias", "valve_deadband", "return_back_pressure"])
def test_the_detector_with_the_effect_sees_no_leak_in_health_and_a_small_one_right(
    effect: str,
) -> None:
    model = Model().with_effect(effect, value=EFFECTS[effect])
    assert replay(with_effect(effect, seconds=30.0), model).decision.verdict == "healthy"
    leaking = with_effect(effect, 0.1, 30.0)
    decision = replay(leaking, model).decision
    later = leaking.time_s >= ONSET_S + 2.0
    flow = float(np.abs(leaking["true_leak_1_m3_per_s"])[later].mean())
    assert decision.verdict == "external_leakage_1"
    assert decision.onset_s == pytest.approx(ONSET_S, abs=0.5)
    low, high = decision.interval_m3_per_s or (0.0, 0.0)
    assert low <= flow <= high


REAL: Final = NOMINAL._replace(
    valve_deadband=2e-6, valve_underlap_leakage=6e-6, valve_flow_asymmetry=0.2, payload_mass=40.0
)


def _state(spool: float) -> Array:
    return np.array([spool, 6e6, 5e6, 0.3, 0.1, 0.0, 600.0, 1e-9, 2e-9, 1e-9, 1e-6])


@pytest.mark.parametrize("spool", [1e-4, 5e-6, 0.5e-6, -4e-6, -1e-4])
def test_the_jacobian_of_real_edges_is_that_of_the_prediction(spool: float) -> None:
    x = _state(spool)
    rows, unused = np.empty((DYNAMIC, STATE_COUNT)), np.empty((DYNAMIC, STATE_COUNT))
    command = spool / REAL.valve_gain
    predict_product(x.copy(), command, 13.8e6, REAL, rows)
    steps = np.array([1e-9, 10.0, 10.0, 1e-6, 1e-6, 1e-6, 1e-2, 1e-13, 1e-13, 1e-13, 1e-9])
    for j, step in enumerate(steps):
        low, high = x.copy(), x.copy()
        low[j] -= step
        high[j] += step
        predict_product(low, command, 13.8e6, REAL, unused)
        predict_product(high, command, 13.8e6, REAL, unused)
        slope = (high - low)[:DYNAMIC] / (2.0 * step)
        scale = np.abs(slope) + 1e-6 * np.array([1e-6, 1e5, 1e5, 1e-4, 1e-2, 1e-3]) / step
        assert (np.abs(rows[:, j] - slope) < 1e-3 * scale).all(), j


@pytest.mark.parametrize("field", ["command_delay", "valve_hysteresis", "supply_droop"])
def test_filters_in_lanes_refuse_what_needs_a_memory_of_each(field: str) -> None:
    parameters: Parameters = NOMINAL._replace(**{field: 1e-5})
    with pytest.raises(ValueError, match=f"model: filters in lanes do not take {field}"):
        ProductLanes(Model(parameters=parameters))
