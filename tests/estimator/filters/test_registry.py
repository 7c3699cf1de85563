"""A filter does the same in the loop, in a replay, and twice."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.product_model import STATE_COUNT, predict_product
from estimator.filters.registry import FILTERS, OUTPUTS, FilterRun, run_filter, start_memory
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion, SimulatedLoop, estimates_in
from rig.plant import NOMINAL, Model
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TICKS = 3000
MEASURED = ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m", "supply_pressure_Pa")


def looped(name: str) -> tuple[dict[str, Array], FilterRun]:
    model = Model()
    setpoint = 0.3 + 0.1 * np.sin(np.pi * np.arange(TICKS) * 1e-3)
    motion = Motion(setpoint, False, np.zeros((TICKS, 8)), 0.3, 500)
    memory = start_memory(name, model)
    loop = SimulatedLoop(simulated_rig(model, 1), motion, memory, model.parameters)
    loop.position()
    rows = np.concatenate([loop.advance(700) for _ in range(5)])
    channels = {channel: rows[:, i].copy() for i, channel in enumerate(loop.channels)}
    return channels, estimates_in(rows, loop.channels, memory)


def replayed(name: str, channels: dict[str, Array]) -> FilterRun:
    measured = np.column_stack([channels[c] for c in MEASURED])
    return run_filter(channels["time_s"], channels["command_V"], measured, Model(), name)


@pytest.mark.parametrize("name", FILTERS)
def test_loop_and_replay_agree_to_the_bit(name: str) -> None:
    channels, there = looped(name)
    here, again = replayed(name, channels), replayed(name, channels)
    for other in (there, again):
        assert np.array_equal(here.states, other.states, equal_nan=True)
        assert np.array_equal(here.outputs, other.outputs, equal_nan=True)
    assert np.isnan(here.outputs[0]).all()
    assert here.outputs.shape == (TICKS, len(OUTPUTS))


def test_an_unknown_filter_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="product, thesis-6, thesis-7"):
        start_memory("kalman", Model())


def test_samples_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        run_filter(np.zeros(5), np.zeros(5), np.zeros((5, 3)), Model())


@pytest.mark.parametrize("channel", ["position_m", "pressure_1_Pa", "pressure_2_Pa"])
def test_the_first_sample_is_the_first_that_is_whole(channel: str) -> None:
    channels, _ = looped("product")
    whole = replayed("product", channels)
    late = {name: values.copy() for name, values in channels.items()}
    late[channel][:40] = np.nan
    run = replayed("product", late)
    assert np.isnan(run.states[:40]).all()
    assert np.isfinite(run.states[40:]).all()
    assert np.isfinite(run.outputs[41:]).all()
    assert run.state("position_m")[-1] == pytest.approx(whole.state("position_m")[-1], abs=1e-6)


@pytest.mark.parametrize("damping", [0.3, 0.7, 1.0, 1.5])
def test_the_spool_is_predicted_exactly_at_any_damping(damping: float) -> None:
    model = Model(parameters=NOMINAL._replace(valve_damping=damping))
    command = np.full(40, 2.0)
    truth = simulate(model, command, substeps=64)
    x = np.zeros(STATE_COUNT)
    x[1:4] = 6.9e6, 6.9e6, 0.3
    for k in range(1, command.size):
        predict_product(x, 2.0, 13.8e6, model.parameters, np.empty((6, STATE_COUNT)))
        assert x[0] == pytest.approx(truth["spool"][k], rel=1e-5)


@pytest.mark.parametrize("air", [0.0, 0.005])
def test_the_prediction_follows_the_plant(air: float) -> None:
    """A rig that slides without friction needs no load: the filter's model is the plant's."""
    parameters = NOMINAL._replace(coulomb=0.0, stiction=0.0, viscous=0.0, entrained_air=air)
    command = 3.0 * np.sin(2.0 * np.pi * 0.7 * np.arange(400) * 1e-3)
    truth = simulate(Model(parameters=parameters), command, substeps=64)
    errors = []
    for k in range(50, 399):
        x = np.zeros(STATE_COUNT)
        names = ("spool", "pressure_1", "pressure_2", "position", "velocity", "spool_velocity")
        x[:6] = [truth[name][k] for name in names]
        predict_product(
            x, command[k], parameters.supply_pressure, parameters, np.empty((6, STATE_COUNT))
        )
        errors.append(x[:6] - [truth[name][k + 1] for name in names])
    worst = np.abs(errors).max(axis=0)
    assert worst[1:3].max() < 3e3
    assert worst[3] < 1e-7
    assert worst[4] < 1e-3
