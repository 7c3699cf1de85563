"""The product filter as in a textbook: dense covariance, Joseph form, one reading after another."""

import numpy as np
from numpy.typing import NDArray

from estimator.filters.product_model import DYNAMIC, STATE_COUNT, predict_product
from estimator.filters.product_noise import DRY, ProductNoise
from rig.plant import Parameters

Array = NDArray[np.float64]


def process_noise(noise: ProductNoise) -> Array:
    """Return the covariance Q (11, 11) of the process noise over a tick."""
    pressure, leakage = noise.chamber_pressure, noise.leakage
    return np.diag(
        [0.0, pressure, pressure, 0.0, noise.velocity, noise.spool_velocity, noise.load,
         leakage, leakage, leakage, noise.null_bias]
    )  # fmt: skip


class DenseFilter:
    """A product filter with dense covariance.

    Attributes:
        x: state (11,).
        P: covariance (11, 11).
        squares: for each reading used, its squared innovation divided by its expected variance.
    """

    def __init__(self, first: Array, par: Parameters, noise: ProductNoise) -> None:
        position, p1, p2, spool = first
        self.x = np.zeros(STATE_COUNT)
        self.x[:4] = spool, p1, p2, position
        self.x[6] = par.piston_area * (p1 - p2)
        self.x[7:] = (
            par.external_leakage_1,
            par.external_leakage_2,
            par.internal_leakage,
            par.spool_null_bias,
        )
        self.P = np.diag(np.array(noise.initial) ** 2)
        self.squares: list[float] = []
        self._par, self.noise = par, noise

    def predict(self, command: float, supply: float) -> None:
        """Predict state and covariance over one tick, from the command (V) and supply (Pa)."""
        jacobian = np.empty((DYNAMIC, STATE_COUNT))
        predict_product(self.x, command, supply, self._par, jacobian)
        transition = np.vstack([jacobian, np.eye(STATE_COUNT)[DYNAMIC:]])
        self.P = transition @ self.P @ transition.T + process_noise(self.noise)

    def correct(self, sample: Array) -> None:
        """Correct state and covariance by a sample (position, p1, p2, spool); NaN is not used."""
        position, p1, p2, spool = sample
        noise = self.noise
        self._measure(0, spool, noise.spool)
        self._measure(3, position, noise.position)
        for index, pressure in ((1, p1), (2, p2)):
            if pressure < DRY:
                self.x[index] = pressure
                self.P[index] = self.P[:, index] = 0.0
                self.P[index, index] = noise.pressure
            else:
                self._measure(index, pressure, noise.pressure)

    def _measure(self, index: int, measured: float, variance: float) -> None:
        if np.isnan(measured):
            return
        h = np.eye(STATE_COUNT)[index]
        expected = self.P[index, index] + variance
        gain = self.P[index] / expected
        innovation = measured - self.x[index]
        kept = np.eye(STATE_COUNT) - np.outer(gain, h)
        self.x = self.x + gain * innovation
        self.P = kept @ self.P @ kept.T + variance * np.outer(gain, gain)
        self.squares.append(innovation**2 / expected)
