"""One law through everything: it keeps to what is known best, and owns up where it does not fit."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.friction.break_away import presliding_creep
from estimator.friction.curve import FrictionCurve, FrictionEstimate, slip_curve
from estimator.friction.fit import PARAMETERS, StribeckFit
from estimator.friction.joint import DISAGREEMENT, JointFit, joint_fit, steady_among
from estimator.friction.samples import Spring
from estimator.friction.steady_strokes import SteadySpeed
from estimator.friction.stiction import NO_LEVEL, StictionLevel, Trend
from rig.plant import NOMINAL

TRUTH = (1000.0, 2600.0, 0.036, 300.0, 40.0)
ERRORS = np.array([3.0, 90.0, 0.0012, 5.0, 0.4])
SLOPE = 0.002
FLAT = Trend(0.0, 5.0, False)
SPEEDS = (-0.45, -0.3, -0.25, 0.25, 0.3, 0.45)


def sliding(values: np.ndarray) -> FrictionCurve:
    estimates = {
        name: FrictionEstimate(float(value), float(error), "")
        for name, value, error in zip(PARAMETERS, values, ERRORS, strict=True)
    }
    fit = StribeckFit(values, np.diag(ERRORS**2), 9.0, False)
    return FrictionCurve(estimates, (), fit, 0.05, 0.5, 40, Spring(0.0, 0.0), 1e-3)


def level(stiction: float) -> StictionLevel:
    """Return what the break-aways of a rig show whose stiction, but for that, is the truth's."""
    law = (TRUTH[0], stiction, *TRUTH[2:])
    creep = presliding_creep(NOMINAL._replace(**dict(zip(PARAMETERS, law, strict=True))), SLOPE)
    back, out = slip_curve(np.array([-creep, creep]), law)
    return StictionLevel(0.5 * (out - back), 1.0, TRUTH[4], 1.0, 5e-5, FLAT, FLAT, 10)


def steady(rng: np.random.Generator) -> list[SteadySpeed]:
    return [
        SteadySpeed(
            speed,
            float(slip_curve(np.array([speed]), TRUTH)[0] + rng.standard_normal()),
            1.0,
            True,
        )
        for speed in SPEEDS
    ]


def fitted(rng: np.random.Generator) -> JointFit:
    start = np.array(TRUTH) + ERRORS * rng.standard_normal(5)
    measured = level(TRUTH[1])
    measured = replace(measured, level=measured.level + rng.standard_normal())
    found = joint_fit(sliding(start), measured, steady(rng), NOMINAL, SLOPE)
    assert found is not None
    return found


def test_intervals_hold_the_truth_and_stiction_is_known_by_the_break_aways() -> None:
    rng = np.random.default_rng(1)
    fits = [fitted(rng) for _ in range(100)]
    for index, name in enumerate(PARAMETERS):
        scores = [
            (fit.values[index] - TRUTH[index]) / (fit.estimates[name].standard_error or 0.0)
            for fit in fits
        ]
        assert np.mean(np.abs(scores) < 1.96) >= 0.9, name
    assert np.median([fit.estimates["stiction"].standard_error or 0.0 for fit in fits]) < 8.0


def test_without_break_aways_stiction_stays_an_extrapolation() -> None:
    found = joint_fit(sliding(np.array(TRUTH)), NO_LEVEL, [], NOMINAL, SLOPE)
    assert found is not None
    assert found.values == pytest.approx(TRUTH)
    assert found.estimates["stiction"].standard_error == pytest.approx(90.0, rel=0.01)


def test_a_law_that_does_not_fit_is_doubted_and_its_intervals_widened() -> None:
    wrong = level(3200.0)
    found = joint_fit(sliding(np.array(TRUTH)), wrong, [], NOMINAL, SLOPE)
    assert found is not None
    assert found.disagreement > DISAGREEMENT
    assert found.misfit > 4.0
    assert (found.estimates["stiction"].standard_error or 0.0) > 5.0


def test_strokes_where_friction_falls_with_speed_are_left_out() -> None:
    curve = sliding(np.array(TRUTH))
    slow, fast = SteadySpeed(0.05, 0.0, 1.0, True), SteadySpeed(0.3, 0.0, 1.0, True)
    shaking = SteadySpeed(0.4, 0.0, 1.0, False)
    assert steady_among([slow, fast, shaking], curve) == [fast]


def test_nothing_is_fitted_where_sliding_did_not_show_a_parameter() -> None:
    curve = sliding(np.array(TRUTH))
    unseen = dict(curve.estimates) | {"viscous": FrictionEstimate(None, None, "N s/m", "speed")}
    assert joint_fit(replace(curve, estimates=unseen), NO_LEVEL, [], NOMINAL, SLOPE) is None


def test_the_band_of_the_curve_is_narrowest_where_speeds_were_measured() -> None:
    found = fitted(np.random.default_rng(2))
    at_speed, between = found.force_error(np.array([0.3, 0.03]))
    assert at_speed < between
    assert found.force(np.array([0.3])) == pytest.approx(
        slip_curve(np.array([0.3]), TRUTH), abs=5.0
    )
