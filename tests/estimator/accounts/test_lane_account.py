"""Accounts in lanes are those of one rig, bit for bit, but for e^x about null."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.flow import BLOCK_TICKS, AccountBlock, FlowAccount
from estimator.accounts.lane_account import LaneAccounts
from rig.lanes import LANES
from rig.plant import NOMINAL
from rig.plant.integrator import TICK

Array = NDArray[np.float64]

NULL = (1e-6, 5e-7)


def samples(first: int, ticks: int) -> tuple[Array, Array]:
    """Return readings (ticks, 6, LANES) and estimates (ticks, 11, LANES) of rams in motion."""
    t = (first + np.arange(ticks))[:, None] * TICK
    lane = np.arange(LANES)
    states = np.zeros((ticks, 11, LANES))
    states[:, 0] = (1e-7 + 2e-5 * lane) * np.sin((3.0 + lane) * t)
    states[:, 1] = 7e6 + 1e6 * np.sin(5.0 * t + lane)
    states[:, 2] = 6e6 - 1e6 * np.sin(5.0 * t + lane)
    states[:, 3] = 0.3 + 0.01 * np.cos((3.0 + lane) * t)
    readings = np.zeros((ticks, 6, LANES))
    readings[:, :3] = states[:, [3, 1, 2]]
    readings[:, 4] = 13.8e6 + 1e4 * np.sin(t)
    return readings, states


def alone(account: FlowAccount, time_s: Array, readings: Array, states: Array) -> AccountBlock:
    rows = np.array([time_s, *states[:, :4].T, np.ones(time_s.size), readings[:, 4]])
    (block,) = account.add(np.ascontiguousarray(rows), NULL)
    return block


def test_each_lane_has_the_account_of_one_rig() -> None:
    own = [FlowAccount(NOMINAL) for _ in range(LANES)]
    lanes = LaneAccounts(NOMINAL, [FlowAccount(NOMINAL) for _ in range(LANES)])
    nulls = np.repeat(np.array(NULL)[:, None], LANES, axis=1)
    for block in range(2):
        first = block * BLOCK_TICKS + (block > 0)
        readings, states = samples(first, BLOCK_TICKS + (block == 0))
        time_s: Array = (first + np.arange(len(readings), dtype=np.float64)) * TICK
        found = lanes.add(float(time_s[-1]), readings, states, nulls)
        for lane in range(LANES):
            expected = alone(own[lane], time_s, readings[:, :, lane], states[:, :, lane])
            ours = found[lane]
            assert ours is not None
            assert (ours.start_s, ours.end_s) == (expected.start_s, expected.end_s)
            assert ours.complete
            assert expected.complete
            assert ours.position_range == expected.position_range
            assert ours.supply_flow == pytest.approx(expected.supply_flow, rel=1e-12)
            for name in ("missing", "nuisances", "faults", "sizes", "doubts"):
                np.testing.assert_allclose(
                    getattr(ours, name), getattr(expected, name), rtol=1e-10, atol=1e-22
                )


@pytest.mark.parametrize(
    "what", ["a reading is missing", "a pressure is frozen", "a chamber is dry", "not started"]
)
def test_a_lane_in_another_state_is_left_to_its_own_account(what: str) -> None:
    accounts = [FlowAccount(NOMINAL) for _ in range(LANES)]
    lanes = LaneAccounts(NOMINAL, accounts)
    readings, states = samples(0, BLOCK_TICKS + 1)
    if what == "a reading is missing":
        readings[100, 0, 2] = np.nan
    elif what == "a pressure is frozen":
        readings[100:140, 2, 2] = readings[100, 2, 2]
    elif what == "a chamber is dry":
        states[100, 1, 2] = -1e5
    else:
        states[:10, :, 2] = np.nan
    found = lanes.add(BLOCK_TICKS * TICK, readings, states, np.zeros((2, LANES)))
    assert [lane for lane, block in enumerate(found) if block is None] == [2]
    assert accounts[2].memory[0] == -1.0
