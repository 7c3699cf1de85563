"""A drift of the encoder is told from a leak past the piston and from a null that shifts."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from estimator.accounts.flow import AccountBlock
from estimator.accounts.nuisances import DRIFT, NUISANCES, nuisance_index
from estimator.encoder import DriftTest, EncoderDrift
from estimator.encoder.drift_test import DEAD_ZONE, END_MARGIN
from rig.plant import LITRE_PER_MINUTE, NOMINAL, chamber_volumes

from ..leaks.test_leak_statistic import ROOT, blocks

AREA = NOMINAL.piston_area
BULK = nuisance_index("bulk_modulus")
MIDDLE = 0.3
ONSET = 40
"""Block at which the changes of these tests begin, at 20 s."""


def moving(count: int, seed: int, swing: float = 3e6) -> list[AccountBlock]:
    """Return blocks of a healthy ram whose pressures change by up to `swing` (Pa/s) in a block."""
    rng = np.random.default_rng((seed, 2))
    volumes = np.array(chamber_volumes(MIDDLE, NOMINAL))
    found = []
    for block in blocks(count, seed, noise=0.003, nuisance=0.0):
        rise = swing * rng.uniform(-1.0, 1.0) * np.array([1.0, -1.0])
        shapes = block.nuisances.copy()
        shapes[:, BULK] = -NUISANCES[BULK].sigma * volumes * rise / NOMINAL.bulk_modulus
        found.append(replace(block, nuisances=shapes, position_range=(MIDDLE, MIDDLE)))
    return found


def drifting(series: list[AccountBlock], rate: float) -> list[AccountBlock]:
    """Return blocks whose encoder drifts by `rate` (m/s) from block `ONSET` on."""
    volumes = np.array(chamber_volumes(MIDDLE, NOMINAL))
    found = []
    for k, block in enumerate(series):
        if k >= ONSET:
            rise_by_bulk = -block.nuisances[:, BULK] / NUISANCES[BULK].sigma / volumes
            away = rate * (0.5 * (block.start_s + block.end_s) - 0.5 * ONSET)
            moved = AREA * (rate + away * rise_by_bulk)
            block = replace(block, missing=block.missing + moved * np.array([-1.0, 1.0]))
        found.append(block)
    return found


def shifted(series: list[AccountBlock], of_tolerance: float) -> list[AccountBlock]:
    """Return blocks whose null shifts by a part of its tolerance (10 um) from `ONSET` on."""
    return [
        replace(b, missing=b.missing + of_tolerance * b.nuisances[:, 0]) if k >= ONSET else b
        for k, b in enumerate(series)
    ]


def leaking(series: list[AccountBlock], flow: float, signed: bool = True) -> list[AccountBlock]:
    """Return blocks with an internal leak of `flow` (L/min) from `ONSET` on.

    If not `signed`, the pressure difference keeps its sign in all blocks.
    """
    found = []
    for k, block in enumerate(series):
        faults = block.faults.copy()
        if not signed:
            faults[:, 2] = np.abs(faults[:, 2]) * np.array([1.0, -1.0])
        leak = flow * LITRE_PER_MINUTE / (0.6 * ROOT) * faults[:, 2] * (k >= ONSET)
        found.append(replace(block, faults=faults, missing=block.missing + leak))
    return found


def searched(series: list[AccountBlock]) -> tuple[DriftTest, list[EncoderDrift | None]]:
    """Return the test after all blocks, and what it found after each."""
    test = DriftTest(NOMINAL, 1.0)
    found = []
    for block in series:
        test.see(np.array([MIDDLE]))
        test.add(block)
        found.append(test.search())
    return test, found


@pytest.mark.parametrize("rate", [2e-3, -2e-3])
def test_a_drift_of_2_mm_a_second_is_named_within_30_s(rate: float) -> None:
    _, found = searched(drifting(moving(100, 1), rate))
    assert found[ONSET - 1] is None
    last = found[-1]
    assert last is not None
    assert last.is_sure
    assert abs(last.rate_m_per_s - rate) < 2.0 * last.deviation_m_per_s
    assert last.onset_s == pytest.approx(0.5 * ONSET, abs=2.0)


def test_where_pressures_do_not_change_the_null_may_be_the_cause_too() -> None:
    """The null's flow is then as steady as that of the drift, and only its size speaks for one."""
    _, found = searched(drifting(moving(100, 1, swing=0.0), 4e-3))
    sets = [each.could_also_be for each in found if each is not None]
    assert sets
    assert set(sets) == {("null_shift",)}


def test_where_the_pressure_difference_keeps_its_sign_a_leak_may_be_the_cause_too() -> None:
    series = leaking(moving(100, 1, swing=0.0), 0.0, signed=False)
    _, found = searched(drifting(series, -4e-3))
    last = found[-1]
    assert last is not None
    assert "internal_leakage" in last.could_also_be


@pytest.mark.parametrize("seed", range(3))
def test_no_healthy_rig_and_no_other_cause_is_taken_for_a_drift(seed: int) -> None:
    healthy = moving(100, seed)
    for series in (healthy, shifted(healthy, 0.05), shifted(healthy, -0.2), leaking(healthy, 0.3)):
        _, found = searched(series)
        assert not any(each is not None and each.is_sure for each in found)
    assert not any(searched(healthy)[1])


def test_a_reading_beyond_the_stroke_end_settles_it() -> None:
    test, found = searched(drifting(moving(100, 1, swing=0.0), 4e-3))
    assert found[-1] is not None
    assert not found[-1].is_sure
    test.see(np.array([NOMINAL.stroke_max + 0.5 * END_MARGIN]))
    still = test.search()
    assert still is not None
    assert not still.is_sure
    test.see(np.array([np.nan, NOMINAL.stroke_max + 2.0 * END_MARGIN]))
    proven = test.search()
    assert proven is not None
    assert proven.is_sure
    assert proven.gain == inf


def test_an_encoder_that_was_never_within_the_stroke_says_nothing_of_its_ends() -> None:
    """The recording of a rig that was not homed counts from anywhere."""
    test = DriftTest(NOMINAL, 1.0)
    for block in drifting(moving(100, 1, swing=0.0), 4e-3):
        test.see(np.array([NOMINAL.stroke_max + 1.0]))
        test.add(block)
    found = test.search()
    assert found is not None
    assert not found.is_sure


def test_a_drift_older_than_two_minutes_does_not_end_in_an_error() -> None:
    _, found = searched(drifting(moving(330, 2), 2e-3))
    assert any(each is not None and each.is_sure for each in found)


def test_the_dead_zone_is_what_a_healthy_null_may_wander_by() -> None:
    wander = DRIFT * NUISANCES[0].sigma
    assert wander == pytest.approx(3e-7)
    # 0.1 um of null is 0.01 L/min (estimator/accounts/nuisances.py).
    assert wander / 1e-7 * 0.01 == pytest.approx(DEAD_ZONE)
