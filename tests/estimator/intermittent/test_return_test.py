"""A leak that comes and goes is named by what its openings add up to, at the stated alarm rate."""

from dataclasses import replace
from math import exp

import pytest

from estimator.accounts import AccountBlock
from estimator.intermittent import kept_blocks
from estimator.intermittent.return_test import LEAST_CLAIMED, SHARE, ReturnTest
from rig.plant import FAULTS, LEAKS, NOMINAL
from rig.plant.parameters import LITRE_PER_MINUTE
from tests.estimator.leaks.test_leak_statistic import blocks, blocks_of_an_exact_model

FIRST = 40
"""Block at which the leak opens for the first time: 20 s."""


def returning(
    leak: str, flow: float, stay: int, period: int, count: int = 240, seed: int = 1
) -> list[AccountBlock]:
    """Return blocks with a leak that is open for `stay` of every `period` blocks; flow in L/min."""
    healthy = blocks(count, seed, noise=0.004)
    leaking = blocks(count, seed, noise=0.004, leak=leak, flow=flow)
    return [
        there if k >= FIRST and (k - FIRST) % period < stay else none
        for k, (none, there) in enumerate(zip(healthy, leaking, strict=True))
    ]


def after(series: list[AccountBlock]) -> ReturnTest:
    test = ReturnTest(NOMINAL, 1.0)
    for block in series:
        test.add(block)
    return test


@pytest.mark.parametrize("leak", LEAKS)
def test_a_leak_too_short_for_a_steady_one_is_named_with_its_openings(leak: str) -> None:
    found = after(returning(leak, 0.2, 4, 20)).search()
    assert found is not None
    assert found.leak == leak
    assert found.openings == 10
    starts = [each.start_s for each in found.episodes]
    assert starts == pytest.approx([20.0 + 10.0 * k for k in range(10)], abs=0.3)
    assert [e.end_s - e.start_s for e in found.episodes if e.end_s is not None] == pytest.approx(
        [2.0] * 10, abs=0.4
    )
    assert found.duty == pytest.approx(0.2, abs=0.02)
    assert found.duty_interval[0] < 0.2 < found.duty_interval[1]
    assert found.leak_m3_per_s / LITRE_PER_MINUTE == pytest.approx(0.19, abs=0.02)


def test_evidence_is_kept_while_the_leak_is_shut() -> None:
    shut = blocks(440, 1, noise=0.004)[240:]
    series = returning("external_leakage_1", 0.2, 4, 20, count=440)[:240]
    open_, shut_again = after(series), after([*series, *shut])
    lost = open_.evidence()[0][0] - shut_again.evidence()[0][0]
    assert lost < 0.15 * len(shut)
    assert shut_again.stands_out


def test_a_leak_that_stays_is_not_said_to_come_and_go() -> None:
    for leak in LEAKS:
        steady = blocks(200, 2, noise=0.004, leak=leak, flow=0.2, onset=FIRST)
        assert after(steady).search() is None


def test_two_openings_are_not_enough() -> None:
    once_more = returning("external_leakage_2", 0.3, 6, 60, count=FIRST + 2 * 60)
    assert LEAST_CLAIMED == 3
    assert after(once_more).search() is None


def test_a_healthy_rig_that_is_the_model_exceeds_the_limit_no_more_often_than_stated() -> None:
    """The statistic of Shiryaev and Roberts grows by one in each block on average, so that it
    exceeds a limit A in one of A blocks at most."""
    rate, runs, length = 4000.0, 20, 100
    exceeded = 0
    for seed in range(runs):
        test = ReturnTest(NOMINAL, rate, model_error=0.0)
        for block in blocks_of_an_exact_model(length, seed):
            test.add(block)
            if test.evidence()[0].max() > test.limit:
                exceeded += 1
                break
    allowed = SHARE * rate * 0.5 / 86400.0 * runs * length
    assert allowed == pytest.approx(4.6, abs=0.1)
    assert exceeded <= allowed


def test_the_limit_is_that_of_a_tenth_of_the_stated_rate() -> None:
    assert exp(ReturnTest(NOMINAL, 10.0).limit) == pytest.approx(86400.0 / 0.5)


def test_a_long_run_keeps_its_openings_though_its_blocks_are_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kept_blocks, "KEPT", 200)
    test = after(returning("external_leakage_1", 0.2, 4, 20, count=500))
    found = test.search()
    assert found is not None
    assert found.openings == pytest.approx(23, abs=1)
    assert found.episodes[0].start_s == pytest.approx(20.0, abs=0.3)
    assert found.duty == pytest.approx(0.2, abs=0.03)


def test_blocks_that_grew_while_a_chamber_was_dry_are_left_out() -> None:
    series = blocks(60, 3, noise=0.004)
    grown = replace(series[30], end_s=series[30].start_s + 4.0, missing=series[30].missing + 1e-4)
    with_it, without = (
        after([*series[:30], grown, *series[31:]]),
        after([*series[:30], *series[31:]]),
    )
    assert with_it.evidence()[0].tolist() == without.evidence()[0].tolist()


def test_a_null_that_jumps_to_and_fro_is_no_leak() -> None:
    series = blocks(240, 4, noise=0.004)
    jumping = [
        replace(block, missing=block.missing + 0.2 * block.nuisances[:, 0])
        if k >= FIRST and k % 20 < 6
        else block
        for k, block in enumerate(series)
    ]
    assert after(jumping).search() is None
    assert len(FAULTS) == 5
