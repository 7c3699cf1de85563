"""The thesis filters as references: printed tuning, textbook algebra, behaviour shown as it is."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numba import njit
from numpy.typing import NDArray

from estimator.filters import covariance, thesis, thesis_model
from estimator.filters.covariance import COLUMNS
from estimator.filters.fused import _c_fma
from estimator.filters.thesis import initial_state, thesis6_step, thesis7_step
from rig.plant import NOMINAL, Model
from rig.plant.simulation import simulate
from tools.thesis_linearised import (
    thesis6_jacobian,
    thesis6_predict,
    thesis7_jacobian,
    thesis7_predict,
)

Array = NDArray[np.float64]

MEASURED = [3, 1, 2]
# A state known this well is well conditioned, unlike the printed P0.
WELL_KNOWN = np.array([1e-7, 1e3, 1e3, 1e-3, 1e-2, 1e-4, 1e2])


class Reference(NamedTuple):
    """One filter: compiled step, and what a textbook needs to do the same."""

    size: int
    step: Callable[..., None]
    predict: Callable[..., Array]
    jacobian: Callable[..., Array]
    Q: Array
    R: Array


SIX = Reference(
    6,
    thesis6_step,
    thesis6_predict,
    thesis6_jacobian,
    np.diag(thesis.THESIS6_PROCESS_NOISE),
    np.diag(thesis.THESIS6_MEASUREMENT_NOISE),
)
SEVEN = Reference(
    7,
    thesis7_step,
    thesis7_predict,
    thesis7_jacobian,
    np.diag(thesis.THESIS7_PROCESS_NOISE),
    np.diag(thesis.THESIS7_MEASUREMENT_NOISE),
)
FILTERS = [pytest.param(SIX, id="thesis-6"), pytest.param(SEVEN, id="thesis-7")]


class Record(NamedTuple):
    """Command (n,), true states (n, 7) and measurements (n, 3) of a healthy rig, SI."""

    command: Array
    truth: Array
    measured: Array


@pytest.fixture(scope="module")
def record() -> Record:
    """Open-loop sine of 1 Hz; one measurement in fifty is missing."""
    command = 3.0 * np.sin(2.0 * np.pi * 1e-3 * np.arange(2001))
    states = simulate(Model(), command, position=0.3)
    p1, p2 = states["pressure_1"], states["pressure_2"]
    order = ("spool", "pressure_1", "pressure_2", "position", "velocity", "spool_velocity")
    truth = np.column_stack([*(states[k] for k in order), NOMINAL.piston_area * (p1 - p2)])
    generator = np.random.default_rng(5)
    noise = generator.normal(size=(command.size, 3)) * [1e-5, 3e4, 3e4]
    measured = np.ascontiguousarray(truth[:, MEASURED] + noise)
    measured[generator.random(measured.shape) < 0.02] = np.nan
    return Record(command, truth, measured)


def textbook_step(
    reference: Reference, x: Array, P: Array, u: float, z: Array
) -> tuple[Array, Array, Array]:
    """Return x, P and outputs by eqs. 4.17 and 4.18 with full matrices and one joint update."""
    A = reference.jacobian(x, NOMINAL)
    x, P = reference.predict(x, u, NOMINAL), A @ P @ A.T + reference.Q
    there = ~np.isnan(z)
    H = np.eye(reference.size)[MEASURED]
    S = H @ P @ H.T + reference.R
    innovation = z - H @ x
    used, gain_of = H[there], S[np.ix_(there, there)]
    K = np.linalg.solve(gain_of, used @ P).T
    x = x + K @ innovation[there]
    P = (np.eye(reference.size) - K @ used) @ P
    variances = np.where(there, np.diag(S), np.nan)
    return x, 0.5 * (P + P.T), np.concatenate([innovation, z - H @ x, variances])


def apart(ours: tuple[Array, Array, Array], theirs: tuple[Array, Array, Array]) -> float:
    """Return the largest relative difference in x, P and outputs, zero meaning one sigma."""
    sigma = np.sqrt(np.diag(theirs[1]))
    variances = theirs[2][6:]
    scale = np.concatenate([np.sqrt(variances), np.sqrt(variances), variances])
    assert np.array_equal(np.isnan(ours[2]), np.isnan(theirs[2]))
    return float(
        max(
            np.max(np.abs(ours[0] - theirs[0]) / (np.abs(theirs[0]) + sigma)),
            np.max(np.abs(ours[1] - theirs[1]) / np.outer(sigma, sigma)),
            np.nanmax(np.abs(ours[2] - theirs[2]) / scale, initial=0.0),
        )
    )


@pytest.mark.parametrize(("reference", "restart"), [(SIX, 2000), (SEVEN, 5)], ids=["6", "7"])
def test_the_straight_line_step_is_the_textbook_filter(
    reference: Reference, restart: int, record: Record
) -> None:
    """Over 2000 steps. The seven-state filter runs away, and rounding with it: it restarts."""
    n, worst = reference.size, 0.0
    for k in range(1, 2001):
        if (k - 1) % restart == 0:
            x, P = record.truth[k - 1, :n].copy(), np.diag(WELL_KNOWN[:n] ** 2)
            state, covariance = x.copy(), P.copy()
        out = np.empty(9)
        u, z = record.command[k - 1], record.measured[k]
        reference.step(x, P, u, *z, NOMINAL, out)
        state, covariance, expected_out = textbook_step(reference, state, covariance, u, z)
        worst = max(worst, apart((x, P, out), (state, covariance, expected_out)))
    assert worst < 1e-9


def test_the_columns_are_those_of_the_printed_jacobians() -> None:
    """Number of entries that are not zero, row by row in eqs. 4.19 and 6.20."""
    counts = {n: [len({i, *row}) for i, row in enumerate(rows)] for n, rows in COLUMNS.items()}
    assert counts == {6: [2, 4, 4, 2, 3, 2], 7: [2, 4, 4, 2, 4, 2, 1]}


@pytest.mark.parametrize("reference", FILTERS)
def test_the_compiled_step_rounds_as_plain_python_does(
    reference: Reference, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its functions write the code that is compiled, and compute by themselves without it."""
    n = reference.size
    linearised = thesis_model.linearised_6 if n == 6 else thesis_model.linearised_7
    monkeypatch.setattr(covariance, "fma", _c_fma())
    monkeypatch.setattr(covariance, "_propagated", covariance._propagate)
    monkeypatch.setattr(covariance, "_corrected", covariance._correct)
    monkeypatch.setattr(covariance, "_stored", covariance._store)
    x, P = initial_state(n == 7)
    plain_x, plain_covariance = x.copy(), P.copy()
    out, plain_out = np.empty(9), np.empty(9)
    for k in range(1, 50):
        u, z = record.command[k - 1], record.measured[k]
        reference.step(x, P, u, *z, NOMINAL, out)
        covariance.kalman_step.py_func(
            linearised(tuple(plain_x), u, NOMINAL), plain_x, plain_covariance,
            (np.diag(reference.Q), np.diag(reference.R)), z, plain_out,
        )  # fmt: skip
        assert out.tobytes() == plain_out.tobytes()
        assert x.tobytes() == plain_x.tobytes()
        assert P.tobytes() == plain_covariance.tobytes()


def compiled_loop(reference: Reference) -> Callable[..., None]:
    step = reference.step

    @njit(error_model="numpy")
    def run(x, P, command, measured, outputs):  # type: ignore[no-untyped-def]
        for k in range(1, command.size):
            z = measured[k]
            # NOMINAL is a compile-time constant here: folding it must not change a bit.
            step(x, P, command[k - 1], z[0], z[1], z[2], NOMINAL, outputs[k])

    return run


@pytest.mark.parametrize("reference", FILTERS)
def test_a_step_gives_the_same_bits_inside_a_compiled_loop(
    reference: Reference, record: Record
) -> None:
    n = reference.size
    x, P = record.truth[0, :n].copy(), np.diag(WELL_KNOWN[:n] ** 2)
    looped_x, looped_covariance = x.copy(), P.copy()
    looped = np.zeros((500, 9))
    compiled_loop(reference)(
        looped_x, looped_covariance, record.command[:500], record.measured[:500], looped
    )
    single = np.zeros((500, 9))
    for k in range(1, 500):
        reference.step(x, P, record.command[k - 1], *record.measured[k], NOMINAL, single[k])
    assert single.tobytes() == looped.tobytes()
    assert x.tobytes() == looped_x.tobytes()
    assert P.tobytes() == looped_covariance.tobytes()


def test_the_six_state_filter_starts_and_is_tuned_as_printed() -> None:
    """Section 4.5 and chapter 5."""
    x, P = initial_state(with_load=False)
    np.testing.assert_array_equal(x, [0.0, 6.8e6, 6.8e6, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(P, 1e4 * np.eye(6))
    np.testing.assert_array_equal(np.diag(SIX.Q), [1e-20, 1e4, 1e4, 1e-6, 1e-6, 1e-20])
    np.testing.assert_array_equal(np.diag(SIX.R), [1e-4, 1e6, 1e6])


def test_the_seven_state_filter_starts_and_is_tuned_as_printed() -> None:
    """Section 7.2."""
    x, P = initial_state(with_load=True)
    np.testing.assert_array_equal(x, [0.0, 6.8e6, 6.8e6, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(P, 1e4 * np.eye(7))
    np.testing.assert_array_equal(np.diag(SEVEN.Q), [1e-20, 1e4, 1e4, 1e-6, 1e-4, 1e-20, 1e2])
    np.testing.assert_array_equal(np.diag(SEVEN.R), [1e-4, 1e5, 1e5])


@pytest.mark.parametrize("reference", FILTERS)
def test_the_first_innovation_variances_are_those_of_the_printed_start(
    reference: Reference,
) -> None:
    x, P = initial_state(reference.size == 7)
    out = np.empty(9)
    A = reference.jacobian(x, NOMINAL)
    expected = np.diag(1e4 * A @ A.T + reference.Q)[MEASURED] + np.diag(reference.R)
    reference.step(x, P, 0.0, 0.3, 6.8e6, 6.8e6, NOMINAL, out)
    np.testing.assert_allclose(out[6:9], expected, rtol=1e-12)


@pytest.mark.parametrize("reference", FILTERS)
@pytest.mark.parametrize("missing", range(3))
def test_a_missing_measurement_is_skipped_and_its_outputs_are_nan(
    reference: Reference, missing: int, record: Record
) -> None:
    n = reference.size
    x, P = record.truth[0, :n].copy(), np.diag(WELL_KNOWN[:n] ** 2)
    z = record.truth[1, MEASURED].copy()
    z[missing] = np.nan
    out = np.empty(9)
    reference.step(x, P, record.command[0], *z, NOMINAL, out)
    assert np.array_equal(np.isnan(out), np.tile(np.isnan(z), 3))
    assert np.all(np.isfinite(x))
    assert np.all(np.isfinite(P))


@pytest.mark.parametrize("reference", FILTERS)
def test_without_any_measurement_the_step_is_the_prediction(
    reference: Reference, record: Record
) -> None:
    n = reference.size
    x = record.truth[700, :n].copy()
    P = np.diag(WELL_KNOWN[:n] ** 2)
    A = reference.jacobian(x, NOMINAL)
    predicted = reference.predict(x, 1.5, NOMINAL)
    propagated = A @ P @ A.T + reference.Q
    reference.step(x, P, 1.5, np.nan, np.nan, np.nan, NOMINAL, np.empty(9))
    np.testing.assert_array_equal(x, predicted)
    sigma = np.sqrt(np.diag(propagated))
    assert np.max(np.abs(P - propagated) / np.outer(sigma, sigma)) < 1e-12


@pytest.mark.parametrize("reference", FILTERS)
def test_the_covariance_stays_symmetric_to_the_last_bit(
    reference: Reference, record: Record
) -> None:
    x, P = initial_state(reference.size == 7)
    out = np.empty(9)
    for k in range(1, 300):
        reference.step(x, P, record.command[k - 1], *record.measured[k], NOMINAL, out)
        assert np.array_equal(P, P.T)


@pytest.mark.parametrize("reference", FILTERS)
@given(p1=st.floats(-1e8, 1e8), p2=st.floats(-1e8, 1e8), spool=st.floats(-3e-4, 3e-4))
def test_an_estimate_beyond_supply_or_below_return_gives_finite_numbers(
    reference: Reference, p1: float, p2: float, spool: float
) -> None:
    n = reference.size
    x = np.array([spool, p1, p2, 0.3, 0.0, 0.0, 0.0])[:n]
    P = np.diag(WELL_KNOWN[:n] ** 2)
    out = np.empty(9)
    reference.step(x, P, 0.0, 0.3, 6.8e6, 6.8e6, NOMINAL, out)
    assert np.all(np.isfinite(x))
    assert np.all(np.isfinite(P))
    assert np.all(np.isfinite(out))


def run_as_printed(reference: Reference, record: Record) -> Array:
    x, P = initial_state(reference.size == 7)
    outputs = np.zeros((record.command.size, 9))
    for k in range(1, record.command.size):
        reference.step(x, P, record.command[k - 1], *record.measured[k], NOMINAL, outputs[k])
    return outputs


def test_from_the_printed_start_variances_turn_negative(record: Record) -> None:
    """P0 = 1e4 I takes more digits than a double has."""
    x, P = initial_state(with_load=True)
    least = 0.0
    for k in range(1, 100):
        u, (position, p1, p2) = record.command[k - 1], record.measured[k]
        thesis7_step(x, P, u, position, p1, p2, NOMINAL, np.empty(9))
        least = min(least, np.diag(P).min())
    assert least < 0.0


def test_the_six_state_filter_follows_a_healthy_rig(record: Record) -> None:
    outputs = run_as_printed(SIX, record)
    innovation, residual = outputs[1000:, 1:3], outputs[1000:, 4:6]
    assert np.nanmean(np.abs(innovation)) < 3e5
    assert np.nanmean(np.abs(residual)) < 0.3 * np.nanmean(np.abs(innovation))


def test_the_seven_state_filter_runs_away_as_printed_and_says_so(record: Record) -> None:
    """Its innovations exceed the supply pressure on a healthy rig; none of them is hidden."""
    innovation = run_as_printed(SEVEN, record)[1000:, 1:3]
    assert np.nanmax(np.abs(innovation)) > NOMINAL.supply_pressure
