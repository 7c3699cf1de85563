"""The seven-state filter in factors: the same equations, and no variance below zero."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.thesis import initial_state, thesis7_step, thesis7_ud_step
from estimator.filters.ud import dense_covariance
from rig.plant import NOMINAL, Model
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

WELL_KNOWN = np.array([1e-7, 1e3, 1e3, 1e-3, 1e-2, 1e-4, 1e2])


@pytest.fixture(scope="module")
def record() -> tuple[Array, Array, Array]:
    """Command (n,), true states (n, 7) and measurements (n, 3), one in thirty missing."""
    command = 3.0 * np.sin(2.0 * np.pi * 1e-3 * np.arange(1500))
    states = simulate(Model(), command, position=0.3)
    names = ("spool", "pressure_1", "pressure_2", "position", "velocity", "spool_velocity")
    load = NOMINAL.piston_area * (states["pressure_1"] - states["pressure_2"])
    truth = np.column_stack([*(states[name] for name in names), load])
    rng = np.random.default_rng(5)
    measured = truth[:, [3, 1, 2]] + np.array([3e-5, 3e4, 3e4]) * rng.normal(size=(1500, 3))
    measured[rng.uniform(size=measured.shape) < 1.0 / 30.0] = np.nan
    return command, truth, measured


def test_it_steps_as_the_seven_state_filter_does(record: tuple[Array, Array, Array]) -> None:
    """From the truth anew every ten samples: left alone it runs away, and rounding with it."""
    command, truth, measured = record
    for start in range(0, 1480, 10):
        x, P, out = truth[start].copy(), np.diag(WELL_KNOWN**2), np.empty(9)
        y, factors, told = x.copy(), P.copy(), np.empty(9)
        for k in range(start + 1, start + 11):
            u, (position, p1, p2) = command[k - 1], measured[k]
            thesis7_step(x, P, u, position, p1, p2, NOMINAL, out)
            thesis7_ud_step(y, factors, u, position, p1, p2, NOMINAL, told)
        deviation = np.sqrt(np.diag(P))
        assert np.abs((x - y) / deviation).max() < 1e-7
        apart = np.abs(P - dense_covariance(factors)) / np.outer(deviation, deviation)
        assert apart.max() < 1e-7
        assert told == pytest.approx(out, rel=1e-6, nan_ok=True)


def test_from_the_printed_start_no_variance_turns_negative(
    record: tuple[Array, Array, Array],
) -> None:
    """P0 = 1e4 I takes more digits than a double has: as a matrix P has negative variances."""
    command, _, measured = record
    x, P = initial_state(True)
    y, factors = initial_state(True)
    plain, factored = [], []
    out = np.empty(9)
    for k in range(1, command.size):
        u, (position, p1, p2) = command[k - 1], measured[k]
        thesis7_step(x, P, u, position, p1, p2, NOMINAL, out)
        thesis7_ud_step(y, factors, u, position, p1, p2, NOMINAL, out)
        plain.append(np.diag(P).min())
        factored.append(np.diag(factors).min())
    assert min(plain) < 0.0
    assert min(factored) > 0.0
    assert np.isfinite(factors).all()
