from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.filters.registry import run_filter
from rig.configuration.sweeps.sweep import load_sweep
from rig.lanes import LANES
from rig.plant import FaultInput, Parameters
from rig.plant.integrator import LONGEST_STEP, TICK
from rig.sweep.drawing import Cases, draw
from rig.sweep.group import Group, Setting, setting_of
from rig.sweep.run_cases import judge_cases, run_thesis7
from rig.sweep.ticks import BLOCK, SUMS, setpoint_ticks
from tools.simulated.lanes import SimulatedLanes

SECONDS = 20.0


@pytest.fixture(scope="module")
def setting() -> Setting:
    """Return the shipped sweep's setting, with the loop's steps and without noise.

    Noise it draws in an order of its own.
    """
    sweep = load_sweep("leaks", Path(__file__).parent)
    whole = setting_of(replace(sweep, duration_s=SECONDS, longest_step_s=LONGEST_STEP))
    return replace(whole, sensors=whole.sensors._replace(pressure_noise=0.0))


@pytest.fixture(scope="module")
def cases() -> Cases:
    sweep = load_sweep("leaks", Path(__file__).parent)
    drawn = draw(replace(sweep, duration_s=SECONDS), 0, LANES)
    return replace(drawn, onset_tick=np.minimum(drawn.onset_tick, 8_000.0))


def test_a_group_runs_as_the_lanes_and_the_filter_of_one_rig_do(
    setting: Setting, cases: Cases
) -> None:
    sums = run_thesis7(Group(setting, cases, np.arange(LANES)))
    group = Group(setting, cases, np.arange(LANES))
    rigs = [Parameters(*column) for column in group.rigs.parameters.T.tolist()]
    lanes = SimulatedLanes(
        rigs,
        range(LANES),
        group.rigs.plant[4].tolist(),
        faults=[FaultInput(*column) for column in group.rigs.faults.T.tolist()],
        onsets=[int(onset) for onset in cases.onset_tick],
        sensors=setting.sensors,
    )
    setpoint, motions = np.empty((setting.ticks, LANES)), group.motions
    setpoint_ticks(
        0, motions.sines, motions.wave, motions.levels, motions.ends, np.zeros((1, LANES)), setpoint
    )
    readings = lanes.advance(setpoint, np.zeros_like(setpoint))
    time_s = np.arange(setting.ticks, dtype=np.float64) * 1e-3
    for lane in range(LANES):
        position, p1, p2, spool, _, command = np.ascontiguousarray(readings[:, :, lane].T)
        measured = np.column_stack([position, p1, p2, spool])
        run = run_filter(time_s, command, measured, setting.model, "thesis-7")
        absolute = np.abs(run.innovation[1:, 1:3]).reshape(setting.blocks, BLOCK, 2).sum(axis=1)
        np.testing.assert_allclose(sums[:, 0:2, lane], absolute, rtol=1e-9)
        squared = run.innovation[1:] ** 2 / run.outputs[1:, 6:9]
        squared = squared.reshape(setting.blocks, BLOCK, 3).sum(axis=1)
        np.testing.assert_allclose(sums[:, 2:5, lane], squared, rtol=1e-9)


def test_a_leak_flows_from_two_seconds_after_its_onset_on(setting: Setting, cases: Cases) -> None:
    flow = run_thesis7(Group(setting, cases, np.arange(LANES)))[:, SUMS.index("leak_flow")]
    leaky = cases.faults != "healthy"
    assert not flow[:, ~leaky].any()
    assert not flow[:19].any()  # up to 9.5 s
    assert np.all(flow[20:][:, leaky] > 0.0)


def test_with_steps_of_a_tick_a_leak_passes_what_it_passes_with_shorter_ones(
    setting: Setting, cases: Cases
) -> None:
    coarse = replace(setting, loop=setting.loop._replace(longest_step=TICK))
    fine, found = (
        run_thesis7(Group(each, cases, np.arange(LANES)))[:, SUMS.index("leak_flow")].sum(axis=0)
        for each in (setting, coarse)
    )
    assert not np.array_equal(found, fine)
    np.testing.assert_allclose(found, fine, rtol=0.02)


def test_the_last_group_may_lack_cases(setting: Setting, cases: Cases) -> None:
    whole = judge_cases(setting, cases)
    some = judge_cases(setting, cases.of(np.arange(3), 0))
    assert some["verdict"].shape == (3,)
    # Of rigs with the same effects, lanes do not depend on their neighbours.
    np.testing.assert_array_equal(some["innovation_1_Pa"], whole["innovation_1_Pa"][:3])


@pytest.mark.long
def test_the_products_detector_names_and_sizes_the_leaks_of_cases(cases: Cases) -> None:
    sweep = load_sweep("leaks", Path(__file__).parent)
    setting = setting_of(replace(sweep, duration_s=SECONDS, filter_name="product"))
    coefficients = np.zeros((3, LANES))
    coefficients[np.arange(LANES) % 3, np.arange(LANES)] = 8e-9
    faults = np.array(["external_leakage_1", "external_leakage_2", "internal_leakage"])
    plain = replace(
        cases,
        parameters=np.repeat(np.array(setting.like, dtype=float)[:, None], LANES, axis=1),
        coefficients=coefficients,
        faults=faults[np.arange(LANES) % 3],
        onset_tick=np.full(LANES, 9_000.0),
        onset_s=np.full(LANES, 9.0),
    )
    figures = judge_cases(setting, plain)
    assert figures["right"].sum() >= LANES - 1
    right = figures["right"]
    low, high = figures["leak_low_m3_per_s"][right], figures["leak_high_m3_per_s"][right]
    true = figures["leak_true_m3_per_s"][right]
    assert np.all((low < 1.1 * true) & (0.9 * true < high))
    assert np.all(figures["latency_s"][right] < 10.0)
    assert not figures["lost"].any()
    nis = figures["nis"].astype(np.float64)
    assert np.all((nis > 0.0) & (nis < 3.0))
