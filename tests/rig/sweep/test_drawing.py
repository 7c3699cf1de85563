from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.configuration.sweeps.distributions import Distribution
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from rig.plant import Parameters
from rig.sweep.drawing import draw
from rig.sweep.running import chunks_of, drawn_chunks


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return load_sweep("leaks", Path(__file__).parent)


@given(st.integers(0, 900), st.integers(1, 40), st.data())
def test_a_case_is_the_same_in_whichever_chunk_it_is(
    sweep: Sweep, first: int, count: int, data: st.DataObject
) -> None:
    case = data.draw(st.integers(first, first + count - 1))
    among, alone = draw(sweep, first, count), draw(sweep, case, 1)
    at = case - first
    for name, column in alone.columns.items():
        np.testing.assert_array_equal(among.columns[name].values[at], column.values[0])
    np.testing.assert_array_equal(among.parameters[:, at], alone.parameters[:, 0])
    np.testing.assert_array_equal(among.seeds[:, at], alone.seeds[:, 0])
    np.testing.assert_array_equal(among.coefficients[:, at], alone.coefficients[:, 0])


def test_what_else_is_drawn_changes_nothing_of_a_quantity(sweep: Sweep) -> None:
    fewer = replace(sweep, parameters={"viscous": sweep.parameters["viscous"]}, followers={})
    one, other = draw(sweep, 40, 16), draw(fewer, 40, 16)
    for name in ("viscous", "noise", "onset_s", "coefficient", "motion", "sine_amplitude"):
        np.testing.assert_array_equal(one.columns[name].values, other.columns[name].values)
    np.testing.assert_array_equal(one.seeds, other.seeds)


def test_another_seed_gives_other_cases(sweep: Sweep) -> None:
    other = draw(replace(sweep, seed=sweep.seed + 1), 0, 16)
    assert not np.intersect1d(draw(sweep, 0, 16).parameters[6], other.parameters[6]).size


def test_no_two_cases_share_their_noise(sweep: Sweep) -> None:
    seeds = draw(sweep, 0, 1000).seeds
    assert np.unique(seeds).size == seeds.size


def test_cases_are_as_often_healthy_leaky_and_moving_as_the_file_says(sweep: Sweep) -> None:
    cases = draw(sweep, 0, 4000)
    assert (cases.faults == "healthy").mean() == pytest.approx(0.25, abs=0.03)
    assert (cases.faults == "internal_leakage").mean() == pytest.approx(0.25, abs=0.03)
    assert (cases.columns["motion"].values == "sine").mean() == pytest.approx(0.5, abs=0.03)


def test_a_leak_passes_its_flow_at_its_drop(sweep: Sweep) -> None:
    assert sweep.leaks is not None
    fixed = replace(sweep.leaks, size=Distribution("fixed", (1e-5,)))
    cases = draw(replace(sweep, leaks=fixed), 0, 64)
    for row, drop in enumerate((6.9e6, 6.9e6, 2.5e6)):
        injected = cases.coefficients[row][cases.coefficients[row] > 0.0]
        assert injected.size
        np.testing.assert_allclose(injected * np.sqrt(drop), 1e-5)
    healthy = cases.faults == "healthy"
    assert not cases.coefficients[:, healthy].any()
    assert np.all(cases.onset_tick[healthy] >= sweep.ticks)


def test_stiction_follows_the_slip_friction_that_an_effect_draws(sweep: Sweep) -> None:
    law = Distribution("uniform", (800.0, 1400.0))
    one = replace(sweep, parameters={"coulomb": law}, followers={"stiction": "coulomb"})
    columns = draw(one, 0, 16).columns
    base: Parameters = sweep.rig.plant.parameters
    ratio = columns["stiction"].values.astype(float) / columns["coulomb"].values.astype(float)
    np.testing.assert_allclose(ratio, base.stiction / base.coulomb)


def test_every_case_is_in_one_chunk_beside_cases_like_it(sweep: Sweep) -> None:
    chunks = list(drawn_chunks(sweep, chunks_of(sweep)))
    numbers = np.concatenate([chunk.numbers for chunk in chunks])
    assert sorted(numbers) == list(range(sweep.cases))
    assert [chunk.numbers.size for chunk in chunks] == list(chunks_of(sweep).values())
    alike = [np.unique(chunk.columns["motion"].values).size == 1 for chunk in chunks]
    assert np.mean(alike) > 0.8


def test_a_chunk_is_the_same_whichever_others_are_wanted(sweep: Sweep) -> None:
    (alone,) = drawn_chunks(sweep, {7})
    among = next(chunk for chunk in drawn_chunks(sweep, chunks_of(sweep)) if chunk.chunk == 7)
    np.testing.assert_array_equal(alone.numbers, among.numbers)
    np.testing.assert_array_equal(alone.parameters, among.parameters)
