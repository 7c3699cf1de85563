"""The oil accounts close on a rig as modelled, and show every fault and weakness as they say."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.flow import (
    BLOCK_TICKS,
    AccountBlock,
    FlowAccount,
    reference_drop,
    reference_flow,
)
from estimator.accounts.nuisances import NUISANCES
from rig.plant import FAULTS, NOMINAL, Model, Parameters
from rig.plant.dynamics import valve_conductance
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.simulation import simulate

Array = NDArray[np.float64]
Motion = dict[str, Array]

NAMES = [nuisance.name for nuisance in NUISANCES]
TICKS = 8 * BLOCK_TICKS + 1
ESTIMATED = ("spool", "pressure_1", "pressure_2", "position")
UNMEASURED = np.full(TICKS, np.nan)
COMMAND = 3.0 * np.sin(2.0 * np.pi * 0.7 * np.arange(TICKS) * 1e-3) + np.sin(
    2.0 * np.pi * 1.9 * np.arange(TICKS) * 1e-3
)


def moved(parameters: Parameters) -> Motion:
    return simulate(Model(parameters=parameters), COMMAND, substeps=8)


def accounts(motion: Motion, null_bias: float = 0.0, parts: int = 1) -> list[AccountBlock]:
    account = FlowAccount(NOMINAL)
    time_s = np.arange(TICKS) * 1e-3
    states = [motion[name] for name in ESTIMATED]
    rows = np.array([time_s, *states, np.ones(TICKS), UNMEASURED])
    blocks = []
    for piece in np.array_split(rows, parts, axis=1):
        blocks += account.add(np.ascontiguousarray(piece), (null_bias, 0.0))
    return blocks


def missing(blocks: list[AccountBlock]) -> Array:
    return np.array([block.missing for block in blocks]) / LITRE_PER_MINUTE


@pytest.fixture(scope="module")
def sound() -> Motion:
    return moved(NOMINAL)


def test_no_oil_is_missing_on_the_rig_as_modelled(sound: Motion) -> None:
    assert np.abs(missing(accounts(sound))).max() < 0.005


@pytest.mark.parametrize("leak", FAULTS[:3])
def test_what_is_missing_is_the_leak(leak: str) -> None:
    blocks = accounts(moved(NOMINAL._replace(**{leak: 3e-9})))
    column = FAULTS.index(leak)
    told = np.array([block.faults[:, column] for block in blocks]) * 3e-9 / LITRE_PER_MINUTE
    assert np.abs(told).max() > 0.2
    assert missing(blocks) == pytest.approx(told, abs=0.006)


def _signature(blocks: list[AccountBlock], name: str) -> Array:
    index = NAMES.index(name)
    return np.array([block.nuisances[:, index] for block in blocks]) / NUISANCES[index].sigma


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("spool_null_bias", 2e-7),
        ("discharge_coefficient", 0.002),
        ("supply_pressure", 5e4),
        ("return_pressure", 2e4),
        ("return_back_pressure", 2e12),
        ("supply_droop", 2e12),
        ("bulk_modulus", 0.15),
    ],
)
def test_a_rig_unlike_its_model_misses_oil_as_the_signature_says(
    sound: Motion, name: str, change: float
) -> None:
    relative = name in ("discharge_coefficient", "bulk_modulus")
    value = getattr(NOMINAL, name)
    truth = NOMINAL._replace(**{name: value * (1.0 + change) if relative else value + change})
    blocks = accounts(moved(truth), null_bias=change if name == "spool_null_bias" else 0.0)
    told = _signature(blocks, name) * change / LITRE_PER_MINUTE
    found = missing(blocks) - missing(accounts(sound)).mean(axis=0)
    size = np.abs(told).max()
    assert size > 0.01
    assert np.abs(found - told).max() < 0.25 * size + 0.004
    assert np.corrcoef(found.ravel(), told.ravel())[0, 1] > 0.9


@pytest.mark.parametrize(
    ("name", "change", "measured"),
    [
        ("pressure_1_bias", 5e4, lambda m, c: {"pressure_1": m["pressure_1"] + c}),
        ("pressure_2_bias", 5e4, lambda m, c: {"pressure_2": m["pressure_2"] + c}),
        ("edge_1um", 3e-7, lambda m, c: {"spool": m["spool"] + c * np.sign(m["spool"])}),
        ("spool_delay", 1e-3, lambda m, _: {"spool": np.roll(m["spool"], 1)}),
    ],
)
def test_a_transducer_that_errs_misses_oil_as_the_signature_says(
    sound: Motion, name: str, change: float, measured: Callable[[Motion, float], Motion]
) -> None:
    blocks = accounts(sound | measured(sound, change))
    told = _signature(blocks, name)[1:] * change / LITRE_PER_MINUTE
    found = (missing(blocks) - missing(accounts(sound)))[1:]
    size = np.abs(told).max()
    assert size > 0.005
    assert np.abs(found - told).max() < 0.1 * size + 1e-3


def test_the_four_edges_make_up_the_valve(sound: Motion) -> None:
    for block in accounts(sound):
        column = {name: block.nuisances[:, NAMES.index(name)] for name in NAMES}
        sigma = {nuisance.name: nuisance.sigma for nuisance in NUISANCES}
        edges = sum(
            column[name] / sigma[name]
            for name in ("edge_supply_1", "edge_return_1", "edge_return_2", "edge_supply_2")
        )
        valve = column["discharge_coefficient"] / sigma["discharge_coefficient"]
        assert edges == pytest.approx(valve, rel=1e-12)


def test_a_lost_supply_pressure_and_a_blocked_return_have_their_nuisance_signature(
    sound: Motion,
) -> None:
    for block in accounts(sound):
        per_pascal = block.nuisances[:, NAMES.index("supply_pressure")] / 6.9e5
        assert block.faults[:, FAULTS.index("supply_leakage")] == pytest.approx(-per_pascal)
        blocked = block.nuisances[:, NAMES.index("return_back_pressure")] / 2e12
        assert block.faults[:, FAULTS.index("return_blockage")] == pytest.approx(blocked)


def test_the_supply_droops_by_the_flow_that_its_account_says() -> None:
    droop = 2e12
    motion = moved(NOMINAL._replace(supply_droop=droop))
    account = FlowAccount(NOMINAL)
    time_s, states = 1e-3 * np.arange(TICKS), [motion[name] for name in ESTIMATED]
    blocks = account.add(np.array([time_s, *states, np.ones(TICKS), motion["supply_pressure"]]))
    for block in blocks:
        lost = NOMINAL.supply_pressure - block.supply_pressure
        flow, square = block.supply_flow
        assert lost == pytest.approx(droop * square, rel=0.02)
        assert 0.0 < flow < np.sqrt(square)


@pytest.mark.parametrize("parts", [2, 7, 400])
def test_how_samples_are_batched_does_not_matter(sound: Motion, parts: int) -> None:
    whole, pieces = accounts(sound), accounts(sound, parts=parts)
    assert [block.end_s for block in whole] == [block.end_s for block in pieces]
    for one, other in zip(whole, pieces, strict=True):
        assert np.array_equal(one.missing, other.missing)
        assert np.array_equal(one.nuisances, other.nuisances)


def test_a_block_is_half_a_second(sound: Motion) -> None:
    blocks = accounts(sound)
    assert len(blocks) == 8
    assert [block.start_s for block in blocks] == pytest.approx(np.arange(8) * 0.5)
    assert [block.end_s for block in blocks] == pytest.approx(0.5 + np.arange(8) * 0.5)


def test_no_block_begins_or_ends_while_a_chamber_is_dry(sound: Motion) -> None:
    dry = sound["pressure_2"].copy()
    dry[600:1300] = 1e4
    blocks = accounts(sound | {"pressure_2": dry})
    assert blocks[1].start_s == pytest.approx(0.5)
    assert blocks[1].end_s == pytest.approx(1.5)
    assert all(block.complete for block in blocks)
    always = accounts(sound | {"pressure_2": np.full(TICKS, 1e4)})
    assert not any(block.complete for block in always)


def complete(sound: Motion, fresh: NDArray[np.bool_]) -> list[bool]:
    """Return which of the first three blocks count, if only some samples were measured."""
    time_s = np.arange(TICKS, dtype=np.float64) * 1e-3
    rows = np.array([time_s, *(sound[name] for name in ESTIMATED), fresh, UNMEASURED])
    return [block.complete for block in FlowAccount(NOMINAL).add(rows)[:3]]


@pytest.mark.parametrize(("lost", "counts"), [(50, True), (51, False), (70, False)])
def test_a_block_with_too_long_a_dropout_is_not_complete(
    sound: Motion, lost: int, counts: bool
) -> None:
    fresh = np.ones(TICKS, np.bool_)
    fresh[510 : 510 + lost] = False
    assert complete(sound, fresh) == [True, counts, True]


@pytest.mark.parametrize("apart", [2, 4, 5])
def test_a_device_that_the_filter_bridges_gives_complete_blocks(sound: Motion, apart: int) -> None:
    assert complete(sound, np.arange(TICKS) % apart == 0) == [True, True, True]


@pytest.mark.parametrize("apart", [6, 10, 50])
def test_a_device_that_is_too_slow_for_the_filter_gives_none(sound: Motion, apart: int) -> None:
    assert complete(sound, np.arange(TICKS) % apart == 0) == [False, False, False]


@pytest.mark.parametrize("apart", [1, 4, 5])
def test_dropouts_of_a_slow_device_count_as_much_as_those_of_a_fast_one(
    sound: Motion, apart: int
) -> None:
    fresh = np.arange(TICKS) % apart == 0
    fresh[510:580] = False
    assert complete(sound, fresh) == [True, False, True]


def test_leaks_are_quoted_at_their_reference_drops() -> None:
    assert reference_drop(NOMINAL, "external_leakage_1") == pytest.approx(6.9e6)
    assert reference_drop(NOMINAL, "internal_leakage") == pytest.approx(2.6e6, rel=0.01)
    flow = reference_flow(NOMINAL, "external_leakage_2", 3.87e-9) / LITRE_PER_MINUTE
    assert flow == pytest.approx(0.61, abs=0.01)


def at_rest(noise: float, opening: float = 0.0) -> list[AccountBlock]:
    """Return accounts of a ram held for a minute, of whose spool an estimate is noisy (m)."""
    count = 120 * BLOCK_TICKS + 1
    shocks = np.random.default_rng(1).standard_normal(count)
    spool = np.zeros(count)
    for k in range(1, count):
        spool[k] = 0.5 * spool[k - 1] + 0.75**0.5 * noise * shocks[k]
    held = (np.full(count, value) for value in (12e6, 2.7e6, 0.3, 1.0, np.nan))
    time_s = np.arange(count, dtype=np.float64) * 1e-3
    return FlowAccount(NOMINAL).add(np.array([time_s, spool + opening, *held]))


def test_noise_about_null_lets_no_oil_through() -> None:
    """It opens one edge, then the other, at unlike pressure drops: half its mean size is a flow."""
    noise = 4.3e-7
    supply, p1 = NOMINAL.supply_pressure, 12e6
    unlike = np.sqrt(supply - p1) - np.sqrt(p1 - NOMINAL.return_pressure)
    feigned = valve_conductance(NOMINAL) * 0.5 * noise * np.sqrt(2.0 / np.pi) * abs(unlike)
    assert feigned / LITRE_PER_MINUTE > 0.01
    assert abs(missing(at_rest(noise))[2:, 0].mean()) < 0.2 * feigned / LITRE_PER_MINUTE


def test_noise_about_null_tells_nothing_of_the_lines() -> None:
    """What it lets through errs as the account does, and would be taken for a fault's sign."""
    lines = [FAULTS.index(name) for name in ("supply_leakage", "return_blockage")]
    noisy, open_ = (
        np.mean([block.sizes[lines] for block in at_rest(4.3e-7, opening)[2:]], axis=0)
        for opening in (0.0, 5e-6)
    )
    assert (noisy < 1e-3 * open_).all()


@pytest.mark.parametrize(("apart", "counts"), [(1, True), (5, True), (6, False)])
def test_a_block_tells_how_far_the_spools_readings_were_from_its_estimates(
    sound: Motion, apart: int, counts: bool
) -> None:
    time_s = np.arange(TICKS) * 1e-3
    departures = np.where(np.arange(TICKS) % apart == 0, 2e-7 + 1e-7 * (time_s > 0.5), np.nan)
    rows = [time_s, *(sound[name] for name in ESTIMATED), np.ones(TICKS), UNMEASURED]
    first, second = FlowAccount(NOMINAL).add(np.array([*rows, departures]))[:2]
    expected = (2e-7, 3e-7) if counts else (np.nan, np.nan)
    found = first.spool_departure, second.spool_departure
    assert found == pytest.approx(expected, nan_ok=True, rel=1e-3)
    assert np.array_equal(first.missing, FlowAccount(NOMINAL).add(np.array(rows))[0].missing)
