"""The noise of a regime is measured, kept in a file, and weighs the blocks of that regime."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.accounts.noise import sensor_noise
from estimator.learnt.content import expected_alarms, noise_content, noise_of
from estimator.learnt.measuring import Residuals, joined, measured_noise
from estimator.learnt.noise import RegimeNoise
from estimator.learnt.tail import RegimePeaks, Tail
from rig.plant import LITRE_PER_MINUTE, NOMINAL
from tests.estimator.leaks.test_leak_statistic import blocks
from tests.estimator.learnt.made_up import moving, noise

NOISE = 0.01 * LITRE_PER_MINUTE


def residuals(factor: float, chambers: float, lasting: float, count: int = 1000) -> Residuals:
    """Return residuals with the sensors' noise and that of a model; the latter is correlated."""
    rng = np.random.default_rng(3)
    made = [moving(block) for block in blocks(20, 1)]
    shared = np.linalg.cholesky(np.array([[1.0, chambers], [chambers, 1.0]]))
    error, left = np.zeros(2), []
    kept = [made[k % len(made)] for k in range(count)]
    roots = [np.linalg.cholesky(sensor_noise(block)) for block in made]
    for k in range(count):
        error = lasting * error + np.sqrt(1.0 - lasting**2) * (shared @ rng.standard_normal(2))
        left.append(roots[k % len(made)] @ rng.standard_normal(2) + factor * NOISE * error)
    return Residuals(kept, ["moving"] * count, np.array(left))


def test_size_and_correlations_are_measured() -> None:
    found = measured_noise([residuals(0.5, -0.6, 0.4)])
    assert set(found) == {"moving"}
    assert found["moving"].factor == pytest.approx(0.5, rel=0.15)
    assert found["moving"].chambers == pytest.approx(-0.6, abs=0.15)
    # The sensors' noise, which does not last, takes a share of it.
    assert 0.1 < found["moving"].lasting < 0.4


def test_noise_is_as_careful_as_that_from_the_part_of_the_blocks_that_count() -> None:
    part, whole = [standstills([0.0])] * 2, [standstills([0.0])] * 3
    few, careful = measured_noise(part), measured_noise(whole, counted=2.0 / 3.0)
    assert careful["standstill"].factor == pytest.approx(few["standstill"].factor)
    assert careful["standstill"].factor > 1.1 * measured_noise(whole)["standstill"].factor


def test_a_regime_that_hardly_occurred_is_not_learnt() -> None:
    assert measured_noise([residuals(0.5, 0.0, 0.0, count=40)]) == {}


def test_a_rig_is_not_taken_for_quieter_than_drawn_rigs() -> None:
    noise = measured_noise([residuals(0.0, 0.0, 0.0, count=1000)])["moving"]
    assert 0.06 <= noise.factor < 0.1


def standstills(offsets: list[float]) -> Residuals:
    """Return residuals of holds of 50 blocks, each off by its own part of 0.01 L/min, opposite."""
    error = NOISE * np.repeat(offsets, 50)
    held = [moving(blocks(1, 1)[0], travel=0.0)] * error.size
    return Residuals(held, ["standstill"] * error.size, np.column_stack([error, -error]))


def test_few_standstills_leave_the_next_one_to_the_careful_default() -> None:
    """All of a standstill is one value; the default's allowance is another."""
    ends = [standstills([0.0]) for _ in range(9)]
    few, many = (measured_noise(ends[:count])["standstill"] for count in (2, 9))
    assert few.factor == pytest.approx((1.0 / 3.0) ** 0.5, rel=0.02)
    assert many.factor == pytest.approx((1.0 / 10.0) ** 0.5, rel=0.02)
    assert few.lasting > 0.9
    assert few.chambers < -0.5


def test_an_error_that_stays_for_a_stretch_lasts_as_long_as_the_stretch() -> None:
    rng = np.random.default_rng(4)
    held = [standstills([error]) for error in 0.5 * rng.standard_normal(40)]
    found = measured_noise([replace(each, regimes=["creep"] * 50) for each in held])["creep"]
    assert (1.0 + found.lasting) / (1.0 - found.lasting) == pytest.approx(50.0, rel=0.1)


def test_noisy_and_lasting_regimes_count_for_less() -> None:
    block = moving(blocks(1, 1)[0])
    regimes = [
        {"moving": RegimeNoise(60.0, *each)}
        for each in ((0.1, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.6))
    ]
    weights = [np.linalg.norm(noise(regimes=each).whitening(block, NOMINAL)) for each in regimes]
    assert weights[0] > weights[1] > weights[2]


def test_two_spans_of_time_are_joined_by_their_length() -> None:
    new = noise(Tail(3.0, 3.0, 2, 1.0), {"moving": RegimeNoise(1800.0, 0.3, 0.0, 0.4)})
    both = joined(noise(), new)
    assert both.tail == Tail(3.0, 4.0, 12, 6.0)
    assert both.regimes["moving"].seconds == 2400.0
    assert both.regimes["moving"].factor == pytest.approx((0.25 * 0.01 + 0.75 * 0.09) ** 0.5)


def test_peaks_are_joined_by_regime_where_both_spans_tell_them() -> None:
    parts = (RegimePeaks("moving", 0.5, 8), RegimePeaks("creep", 0.5, 2))
    old, new = noise(Tail(1.0, 1.0, 10, 3.0, parts)), noise(Tail(1.0, 0.5, 4, 1.0, parts[:1]))
    both = joined(old, new).tail
    assert both.regimes == (RegimePeaks("moving", 1.0, 16), RegimePeaks("creep", 0.5, 2))
    assert joined(noise(), new).tail.regimes == ()
    content = json.loads(json.dumps(noise_content(old)))
    assert noise_of(content) == old


def test_it_survives_json_bit_for_bit_and_says_how_sure_it_is() -> None:
    made = noise()
    content = json.loads(json.dumps(noise_content(made)))
    assert noise_of(content) == made
    assert content["expected_alarms_per_day"]["1"]["high"] == expected_alarms(made)[1.0][1]
    assert all(low < rate < high for rate, (low, high) in expected_alarms(made).items())


def test_a_file_from_before_peaks_were_told_by_regime_has_none() -> None:
    content = noise_content(noise())
    del content["peaks"]["regimes"]
    assert noise_of(content) == noise()


def test_a_file_from_before_accounts_were_corrected_corrects_nothing() -> None:
    content = noise_content(replace(noise(), spool_correction=0.7))
    assert noise_of(content).spool_correction == 0.7
    del content["spool_correction"]
    assert noise_of(content) == noise()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda c: c["regimes"]["moving"].update(factor=-1.0), "moving: factor: -1 is outside 0"),
        (lambda c: c["regimes"].update(flying={}), "flying is none of near_stop, standstill"),
        (lambda c: c["peaks"].update(hours=0.0), "peaks: hours: 0 is outside"),
        (lambda c: c["peaks"].update(over=0.1), "peaks: over: 0.1 is outside 0.5 to 100"),
        (
            lambda c: c["peaks"].update(regimes={"flying": {}}),
            "noise: peaks: regimes: flying is none of near_stop",
        ),
        (lambda c: c.update(spool_correction=2.0), "spool_correction: 2 is outside 0 to 1"),
        (lambda c: c["peaks"].update(count=float("nan")), "peaks: count: nan is outside"),
    ],
)
def test_a_damaged_value_is_named_with_its_range(
    damage: Callable[[dict[str, Any]], object], says: str
) -> None:
    content = noise_content(replace(noise()))
    damage(content)
    with pytest.raises(ValueError, match=says):
        noise_of(content)
