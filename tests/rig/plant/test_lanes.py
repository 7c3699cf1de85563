"""Lanes come to what the same functions come to with floats."""

import math
from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from scipy import stats

from rig.lanes import LANES, anywhere, everywhere, gather, load, load_fields, scatter, select, store
from rig.lanes.normal import fill_normal, start_streams
from rig.plant.dynamics import rates, valve_flows
from rig.plant.parameters import Parameters
from tools.simulated.drawn_rigs import drawn_rig

Array = NDArray[np.float64]
EXPONENTS = np.concatenate([np.linspace(-708.0, 0.0, 4001), -np.geomspace(1e-12, 30.0, 2007)])


@njit
def _exponentials(x: Any, y: Any) -> Any:
    for i in range(x.shape[0]):
        store(y, i, math.exp(load(x, i)))


def test_exponentials_are_right_to_two_units_in_the_last_place() -> None:
    x = EXPONENTS[: EXPONENTS.size // LANES * LANES].reshape(-1, LANES)
    y = np.empty_like(x)
    _exponentials(x, y)
    assert (np.abs(y - np.exp(x)) <= 2.0 * np.spacing(np.exp(x))).all()


def test_an_exponential_that_vanishes_is_next_to_nothing() -> None:
    y = np.empty((1, LANES))
    _exponentials(np.full((1, LANES), -1e9), y)
    assert (y < 1e-300).all()


@njit
def _arithmetic(a: Any, b: Any) -> Any:
    c = max(a, 2.0) - min(b, a) * 3.0 / (1.0 + abs(b))
    c += math.floor(a)
    c -= math.sqrt(abs(a))
    c *= math.copysign(2.0, b)
    return select((a > b) | ~(a >= 0.0), -c, select((a != b) & (b <= 0.5), c, 1.0))


@njit
def _arithmetic_of_lanes(a: Any, b: Any, c: Any) -> Any:
    for i in range(a.shape[0]):
        store(c, i, _arithmetic(load(a, i), load(b, i)))


def test_every_operation_does_in_each_lane_what_it_does_to_floats() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 50, LANES))
    b[:5] = a[:5]
    c = np.empty_like(a)
    _arithmetic_of_lanes(a, b, c)
    expected = [
        [_arithmetic(*pair) for pair in zip(*row, strict=True)] for row in zip(a, b, strict=True)
    ]
    assert c == pytest.approx(np.array(expected), rel=1e-14, abs=1e-14)


@njit
def _where(x: Any) -> Any:
    positive = load(x, 0) > 0.0
    return anywhere(positive), everywhere(positive), anywhere(x[0, 0] > 0.0)


@pytest.mark.parametrize("positive", [0, 1, LANES])
def test_branches_know_whether_something_holds_anywhere_or_everywhere(positive: int) -> None:
    x = np.where(np.arange(LANES)[::-1] < positive, 1.0, -1.0)[None]
    assert _where(x) == (positive > 0, positive == LANES, positive == LANES)


@njit
def _exchange(source: Any, rows: Any, target: Any, chosen: Any) -> Any:
    values = gather(source, load(rows, 0))
    scatter(target, load(rows, 0), values, load(chosen, 0) > 0.0)


def test_each_lane_reads_and_writes_a_row_of_its_own() -> None:
    source = np.arange(5.0 * LANES).reshape(5, LANES)
    rows = np.arange(LANES, dtype=np.float64)[None] % 5
    chosen = (np.arange(LANES) % 2.0)[None]
    target = np.full_like(source, -1.0)
    _exchange(source, rows, target, chosen)
    expected = np.full_like(source, -1.0)
    for lane in range(1, LANES, 2):
        expected[lane % 5, lane] = source[lane % 5, lane]
    assert np.array_equal(target, expected)


LAW = Parameters._fields.index("friction_law")


@njit
def _rates(states: Any, parameters: Any, like: Any, faults: Any, out: Any) -> Any:
    par: Any = load_fields(parameters, like, LAW)
    s = states
    k = rates(load(s, 0), load(s, 1), load(s, 2), load(s, 3), load(s, 4), load(s, 5), load(s, 6),
              load(s, 7), load(s, 8), 2.0, par,
              (load(faults, 0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))  # fmt: skip
    store(out, 0, k[0])
    store(out, 1, k[1])
    store(out, 2, k[2])
    store(out, 3, k[3])
    store(out, 4, k[4])
    store(out, 5, k[5])
    store(out, 6, k[6])
    store(out, 7, k[7])
    store(out, 8, k[8])


@pytest.mark.long
@pytest.mark.parametrize("law", [0.0, 1.0])
def test_the_plants_rates_are_the_same_in_lanes(law: float) -> None:
    rng = np.random.default_rng(1)
    scale = np.array([1e-4, 0.1, 5e6, 5e6, 0.4, 0.3, 1e-4, 1e6, 1e5])
    centre = np.array([0.0, 0.0, 3e6, 3e6, 0.3, 0.0, 0.0, 13e6, 2e5])
    states = centre + scale * rng.uniform(-1.0, 1.0, (LANES, 9))
    rigs = [drawn_rig(rng)._replace(friction_law=law) for _ in range(LANES)]
    fault = np.zeros((1, LANES))
    fault[0, 3] = 1e-9
    out = np.empty((9, LANES))
    whole: Any = np.ascontiguousarray
    one_rig: Any = rates
    _rates(whole(states.T), whole(np.array(rigs).T), rigs[0], fault, out)
    for lane, (state, rig) in enumerate(zip(states, rigs, strict=True)):
        alone = one_rig(*state, 2.0, rig, (fault[0, lane], *(0.0,) * 7))
        assert out[:, lane] == pytest.approx(alone, rel=1e-12)


def test_floats_choose_without_the_compiler_too() -> None:
    assert select(1.0 > 2.0, 3.0, 4.0) == 4.0
    assert anywhere(True)
    assert not everywhere(False)
    compiled: Any = valve_flows
    plain = compiled.py_func
    for opening in (-1e-5, 1e-5):
        values = (opening, 5e6, 4e6, 13.8e6, 1e5, 6e-4)
        assert compiled(*values) == plain(*values)


@pytest.fixture(scope="module")
def normal() -> Array:
    numbers = np.empty((200_000, LANES))
    fill_normal(start_streams(range(LANES)), numbers)
    return numbers


def test_normal_numbers_are_distributed_as_they_should_be(normal: Array) -> None:
    for lane in range(LANES):
        assert stats.kstest(normal[:, lane], "norm").pvalue > 1e-4
    # Tails, of all lanes: counts beyond 3 and 4 sigma within five of their own sigma.
    for bound in (3.0, 4.0):
        expected = normal.size * 2.0 * stats.norm.sf(bound)
        assert np.sum(np.abs(normal) > bound) == pytest.approx(expected, abs=5.0 * expected**0.5)


def test_normal_numbers_depend_neither_on_those_before_nor_on_other_lanes(normal: Array) -> None:
    bound = 5.0 / normal.shape[0] ** 0.5
    for numbers in (normal, normal**2 - 1.0):
        for lag in (1, 2, 3, 4, 8):
            product = numbers[lag:] * numbers[:-lag]
            assert (np.abs(product.mean(axis=0)) < bound * product.std(axis=0)).all()
        correlation = np.corrcoef(numbers.T) - np.eye(LANES)
        assert (np.abs(correlation) < bound).all()


def test_a_seed_gives_the_same_numbers_however_they_are_batched_and_in_whichever_lane() -> None:
    whole, parts, turned = np.empty((3, 12, LANES))
    fill_normal(start_streams(range(LANES)), whole)
    streams = start_streams(range(LANES))
    for i in range(0, 12, 4):
        part = np.empty((4, LANES))
        fill_normal(streams, part)
        parts[i : i + 4] = part
    fill_normal(start_streams(range(LANES)[::-1]), turned)
    assert np.array_equal(whole, parts)
    assert np.array_equal(whole, turned[:, ::-1])


def test_every_lane_wants_a_seed() -> None:
    with pytest.raises(ValueError, match="seeds"):
        start_streams([1, 2])
