"""A drop of the supply pressure is told from what the valve draws and from a regulator's wander."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.flow import AccountBlock
from estimator.leaks.finding import Finding
from estimator.leaks.supply_statistic import ONSETS, WANDER, SupplyTest
from rig.plant import NOMINAL
from rig.plant.parameters import LITRE_PER_MINUTE

Array = NDArray[np.float64]

DROOP = 1.5e12
BEGINS = 40
"""Index of the first block with what is done to the supply."""


def blocks(
    drop: Array, flow: Array | None = None, *, droop: float = DROOP, seed: int = 1
) -> list[AccountBlock]:
    """Return blocks of a motion, whose supply pressure is lower by `drop` (Pa, one each).

    The valve draws `flow` on average, L/min; the squares vary from block to block.
    """
    rng = np.random.default_rng(seed)
    if flow is None:
        flow = rng.uniform(4.0, 12.0, drop.size)
    mean = flow * LITRE_PER_MINUTE
    square = mean**2 * rng.uniform(1.2, 2.0, drop.size)
    pressure = 1.02 * NOMINAL.supply_pressure - droop * square - drop
    pressure += rng.normal(0.0, 1.3e3, drop.size)
    nothing = np.zeros((2, 1))
    return [
        AccountBlock(
            0.5 * i, 0.5 * (i + 1), np.zeros(2), nothing, nothing, np.zeros(5), complete=True,
            supply_pressure=float(pressure[i]), supply_flow=(float(mean[i]), float(square[i])),
        )
        for i in range(drop.size)
    ]  # fmt: skip


def watched(given: Sequence[AccountBlock], rate: float = 1.0) -> tuple[SupplyTest, list[int]]:
    """Return the test after these blocks, and after which of them it found a drop."""
    test = SupplyTest(NOMINAL, rate)
    found = []
    for i, block in enumerate(given):
        test.add(block)
        if test.search() is not None:
            found.append(i)
    return test, found


def dropped(pascals: float, count: int = 80, ends: int | None = None) -> Array:
    drop = np.zeros(count)
    drop[BEGINS:ends] = pascals
    return drop


def finding(test: SupplyTest) -> Finding:
    found = test.search()
    assert found is not None
    return found


@pytest.mark.parametrize("pascals", [4e4, 1e5, 1e6])
def test_a_drop_is_found_within_seconds_dated_and_measured(pascals: float) -> None:
    test, found = watched(blocks(dropped(pascals)))
    assert BEGINS + 3 <= found[0] <= BEGINS + 7
    assert finding(test).onset_s == pytest.approx(0.5 * BEGINS, abs=0.5)
    assert finding(test).coefficient == pytest.approx(pascals, abs=4.0 * finding(test).deviation)
    assert test.odds() > 1e6


def test_a_leak_of_the_line_drops_the_more_the_more_the_valve_draws() -> None:
    sound = blocks(dropped(0.0))
    leak = 10.0 * LITRE_PER_MINUTE
    leaking = [
        replace(
            block,
            supply_pressure=block.supply_pressure
            - (i >= BEGINS) * DROOP * (leak**2 + 2.0 * leak * block.supply_flow[0]),
        )
        for i, block in enumerate(sound)
    ]
    test, _ = watched(leaking)
    flow = np.mean([block.supply_flow[0] for block in sound[BEGINS:]])
    expected = DROOP * (leak**2 + 2.0 * leak * flow)
    assert finding(test).coefficient == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_supply_raises_no_alarm_at_rest_in_motion_or_where_a_chamber_leaks(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    levels = np.repeat(rng.uniform(0.0, 25.0, 8), 50)
    flow = levels * rng.uniform(0.7, 1.3, levels.size)
    _, found = watched(blocks(np.zeros(levels.size), flow, droop=rng.uniform(0.0, 3e12)), 100.0)
    assert not found


@pytest.mark.parametrize("pascals", [-1e6, -1e5, 0.8 * WANDER * NOMINAL.supply_pressure])
def test_neither_a_rise_nor_what_a_regulator_wanders_by_is_a_leak(pascals: float) -> None:
    _, found = watched(blocks(dropped(pascals)))
    assert not found


def test_where_the_model_is_exact_less_than_a_regulators_wander_is_a_leak() -> None:
    given = blocks(dropped(0.8 * WANDER * NOMINAL.supply_pressure))
    exact = SupplyTest(NOMINAL, 1.0, model_error=0.0)
    for block in given:
        exact.add(block)
    assert finding(exact).onset_s == pytest.approx(0.5 * BEGINS, abs=0.5)


def test_a_drop_keeps_its_onset_when_that_is_older_than_what_is_kept() -> None:
    test, found = watched(blocks(dropped(1e5, BEGINS + 2 * ONSETS)))
    assert found == list(range(found[0], BEGINS + 2 * ONSETS))
    assert finding(test).onset_s == pytest.approx(0.5 * BEGINS, abs=0.5)
    assert finding(test).coefficient == pytest.approx(1e5, rel=0.02)


def test_without_a_supply_pressure_nothing_is_said() -> None:
    unmeasured = [replace(each, supply_pressure=float("nan")) for each in blocks(dropped(1e6))]
    incomplete = [replace(each, complete=False) for each in blocks(dropped(1e6))]
    for given in (unmeasured, incomplete):
        test, found = watched(given)
        assert not found
        assert test.odds() == 0.0


@pytest.mark.parametrize("power", [1.0, 1.5, 1.75])
def test_a_supply_that_droops_with_another_power_of_the_flow_does_not_leak(power: float) -> None:
    """By 1.5 MPa at 15 L/min, in a motion that grows from 1 to 4 L/min to 5 to 12 L/min."""
    rng = np.random.default_rng(7)
    flow = np.where(np.arange(160) < 60, rng.uniform(1.0, 4.0, 160), rng.uniform(5.0, 12.0, 160))
    series = []
    for block in blocks(np.zeros(160), flow, droop=0.0):
        drawn = np.sqrt(block.supply_flow[1]) / (15.0 * LITRE_PER_MINUTE)
        pressure = block.supply_pressure - 1.5e6 * drawn**power
        series.append(replace(block, supply_pressure=pressure))
    assert not watched(series)[1]
