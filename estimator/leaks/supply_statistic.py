"""The sequential test for a drop of the measured supply pressure, which reveals supply leakage.

Oil that leaks from the supply line passes no chamber. The accounts show such a leak only through
the valve's flow, which falls with the root of the supply pressure; a measured supply pressure shows
it directly. The mean supply pressure of a block of the account is explained by

    p_s = p_0 - R mean(q |q|) - r mean(q) - [since an onset] (d + e mean(q)) + noise,

where q is the flow that the valve draws from a supply that droops by R q^2 (Merritt 1967, ch. 3).
Other flow into the valve of a healthy rig makes r, and so does a supply whose droop grows with the
flow itself, as that of a regulated pump or of a laminar line, or with a power between one and two.
A leak q_L of the line makes d = R q_L^2 and e = 2 R q_L. The statistic is the drop at the valve's
mean flow since the onset, less a dead zone, divided by its standard error; it follows Student's t.
A leak of a chamber is no such drop, as its oil comes through the valve. A pump that was turned down
makes the same drop as a leak.
"""

from dataclasses import replace
from functools import lru_cache
from math import exp, log, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    BLOCK_S,
    SUPPLY_LEAKAGE,
    AccountBlock,
    between,
    lasting_noise,
    noise_limit,
    student_quantile,
)
from rig.plant import LITRE_PER_MINUTE, Parameters

from .fault_scores import WITNESSES
from .finding import Finding
from .leak_statistic import MINIMUM_BLOCKS, SHARES
from .leak_verdicts import PRIOR

Array = NDArray[np.float64]

ONSETS: Final = 240
"""Number of possible onsets: the last two minutes of blocks. Older blocks count in sums only."""
NOISE: Final = 1.5e3
"""Expected noise of a block's mean supply pressure, Pa: 30 kPa a sample over 500 samples, rounded
up. It has the weight of `_NOISE_WEIGHT` blocks in the estimated noise."""
_NOISE_WEIGHT: Final = 8.0
WANDER: Final = 2e-3
"""First part of the dead zone, relative to the supply pressure: hysteresis and drift of a pressure
regulator."""
DROOP_ERROR: Final = 0.1
"""Second part of the dead zone, relative to the change of the droop at the onset. The squared flow
is off by 10 % where the valve's flow is off by 5 % (`NUISANCES`), differently in every motion."""
SUPPLY_SIGMA: Final = 0.05
"""Prior standard deviation of the supply pressure, relative to that pressure."""
DROOP_SIGMA: Final = 2e12
"""Prior standard deviation of the droop R, Pa/(m^3/s)^2."""
PROPORTIONAL_SIGMA: Final = 2.0 * DROOP_SIGMA * 13.5 * LITRE_PER_MINUTE
"""Prior standard deviation of the droop r that is proportional to the flow, Pa/(m^3/s).

It has the slope that the droop R q^2 with R = `DROOP_SIGMA` has at half the valve's rated flow of
27 L/min, which comes to 0.4 MPa at rated flow. Other flow of a healthy rig, 1 L/min past lands and
edges that are slightly open, makes a thirteenth of that."""
PROPORTIONAL_ERROR: Final = 0.05
"""Third part of the dead zone, relative to the change of the proportional droop at the onset: the
valve's flow is off by 5 %."""
_LEAK_FLOW: Final = 20.0 * LITRE_PER_MINUTE
"""Prior standard deviation (m^3/s) of a leak of the supply line; it scales the unknown e."""
SIGNS: Final = np.array([-1.0, 2.0 * DROOP_SIGMA * _LEAK_FLOW / PROPORTIONAL_SIGMA])
"""Factors that turn the columns of p_0 and r into those of d and e. A drop d lowers the pressure
that p_0 raises; e has the leak's prior in place of the droop's."""
_ROUNDS: Final = 4
"""Greatest number of fits; each one uses the noise variance that the previous one left."""
_CONVERGED: Final = 0.01
"""Relative change of the noise variance below which no further fit is made."""
_GREATEST_LOG_ODDS: Final = 700.0


class SupplyTest:
    """Tests the supply pressure of all blocks added so far for a drop, in bounded memory.

    Args:
        parameters: the parameters of the rig that are assumed.
        false_alarms_per_day: alarms that all tests together may raise on a healthy rig in a day of
            continuous running; this test has one part in `SHARES` of them.
        model_error: factor on all parts of the dead zone and on what is allowed for noise that
            lasts from block to block; 0 means that the model is exact.
    """

    def __init__(
        self, parameters: Parameters, false_alarms_per_day: float, model_error: float = 1.0
    ) -> None:
        self._model_error = model_error
        self._assumed = parameters.supply_pressure, parameters.supply_droop
        self._share = false_alarms_per_day * BLOCK_S / 86400.0 / SHARES
        # A row for each block: 1, -mean(q) and -mean(q |q|), each times its unknown's prior (Pa),
        # then the measured less the assumed supply pressure (Pa).
        self._scale = np.array(
            [SUPPLY_SIGMA * parameters.supply_pressure, PROPORTIONAL_SIGMA, DROOP_SIGMA]
        )
        self._blocks = 0
        self._rows = np.zeros((ONSETS, 4))
        self._starts = np.zeros(ONSETS)
        # Products of rows that were overwritten: those before a found drop, and those since.
        self._before = np.zeros((4, 4))
        self._since = np.zeros((4, 4))
        self._likeliest: Finding | None = None
        self._tested = 0

    def add(self, block: AccountBlock) -> None:
        """Add one block; an incomplete one, or one without a supply pressure, is ignored."""
        if not block.complete or np.isnan(block.supply_pressure):
            return
        at = self._blocks % ONSETS
        if self._blocks >= ONSETS:
            self._leave(at)
        supply, droop = self._assumed
        flow, square = block.supply_flow
        self._rows[at, :3] = self._scale * (1.0, -flow, -square)
        self._rows[at, 3] = block.supply_pressure - supply + droop * square
        self._starts[at] = block.start_s
        self._blocks += 1

    def _leave(self, at: int) -> None:
        """Add the products of the row at an index, which is to be overwritten, to the sums."""
        found = self.search()
        dropped = found is not None and found.onset <= self._blocks - ONSETS
        if not dropped:
            self._before += self._since
            self._since[:] = 0.0
        leaving = self._since if dropped else self._before
        leaving += np.outer(self._rows[at], self._rows[at])

    @property
    def settings(self) -> tuple[float, ...]:
        """Return what the search for a drop goes by, for compiled code.

        These are the expected variance of the noise, Pa^2; its weight in blocks; the greatest
        number of fits; the change of the variance at which they end; the unit of the first unknown,
        Pa; the parts of the dead zone by wander, Pa, by the proportional droop and by the other
        one, both ratios; and the model error.
        """
        return (
            NOISE**2, _NOISE_WEIGHT, float(_ROUNDS), _CONVERGED, float(self._scale[0]),
            WANDER * self._assumed[0], PROPORTIONAL_ERROR, DROOP_ERROR, self._model_error,
        )  # fmt: skip

    def limit(self) -> float:
        """Return the value that the statistic exceeds on a healthy rig at the stated rate.

        With a model error of 1 or more it holds as if all onsets were independent; for an exact
        model (0) the dependence is taken into account, and values between 0 and 1 interpolate.
        """
        return _limit(self._share, self._blocks, self._model_error)

    def search(self) -> Finding | None:
        """Return the likeliest drop, as a supply leakage, if it exceeds the limit; else None.

        What must exceed the limit is its statistic. The finding's coefficient is the drop in Pa.
        """
        likeliest, limit = self._best(), self.limit()
        if likeliest is None or not likeliest.statistic > limit:
            return None
        return replace(likeliest, limit=limit)

    def odds(self) -> float:
        """Return the odds that the supply pressure dropped, with the prior of a supply leak.

        They are at most e^700. They are 0 if the pressure did not drop at all, or with fewer than
        `MINIMUM_BLOCKS` blocks.
        """
        likeliest = self._best()
        if likeliest is None:
            return 0.0
        # The prior of the drop is uniform up to the tolerance of the supply pressure.
        width = min(sqrt(2.0 * pi) * likeliest.deviation / self._scale[0], 1.0)
        log_odds = 0.5 * max(likeliest.statistic, 0.0) ** 2 + log(PRIOR * width)
        return exp(min(log_odds, _GREATEST_LOG_ODDS))

    def _best(self) -> Finding | None:
        """Return the likeliest drop, even if it may be noise; None if the pressure did not drop."""
        if self._tested != self._blocks:
            self._tested = self._blocks
            self._likeliest = self._searched() if self._blocks >= MINIMUM_BLOCKS else None
        return self._likeliest

    def _searched(self) -> Finding | None:
        rows = self._rows[: self._blocks]
        if self._blocks > ONSETS:
            rows = self._rows[np.arange(self._blocks - ONSETS, self._blocks) % ONSETS]
        # A drop older than the rows keeps its onset.
        held = self._since[0, 0] > 0.0
        first = 0 if self._blocks > ONSETS else WITNESSES
        onsets = range(first, 1 if held else rows.shape[0] - WITNESSES + 1)
        found = self._likeliest_of(rows, onsets)
        if found is None:
            return None
        at, drop, deviation, statistic, spread = found
        onset = self._blocks - rows.shape[0] + at
        if held and self._likeliest is not None:
            onset, onset_s = self._likeliest.onset, self._likeliest.onset_s
        else:
            onset_s = float(self._starts[onset % ONSETS])
        return Finding(
            SUPPLY_LEAKAGE, onset, drop, deviation, statistic, statistic**2, onset_s, spread
        )  # fmt: skip

    def _likeliest_of(
        self, rows: Array, tried: range
    ) -> tuple[int, float, float, float, float] | None:
        """Return the likeliest drop among some onsets; None if the pressure did not drop.

        Args:
            rows: rows of the blocks that are kept, oldest first, (blocks, 4).
            tried: indices in `rows` of the onsets.

        Returns:
            Index of the onset, drop and its standard error in Pa, statistic, and the factor by
            which uneven or lasting noise has raised the variance.
        """
        # Products since each onset, and of all blocks.
        since = np.cumsum((rows[:, :, None] * rows[:, None, :])[::-1], axis=0)[::-1]
        total = self._before + self._since + since[0]
        onsets = np.arange(tried.start, tried.stop)
        since = since[onsets] + self._since
        contrasts = self._contrasts(since)
        variance = NOISE**2
        for _ in range(_ROUNDS):
            estimates, covariances, explained = _fitted(since, total, variance)
            falls = (contrasts * estimates).sum(axis=1) > 0.0
            best = int(np.argmax(np.where(falls, explained, -np.inf)))
            left = _NOISE_WEIGHT * NOISE**2 + total[3, 3] - explained[best] * variance
            before, variance = variance, float(left) / (_NOISE_WEIGHT + self._blocks)
            if abs(variance - before) < _CONVERGED * variance:
                break
        if not falls[best]:
            return None
        estimate, contrast = estimates[best], contrasts[best]
        drop = float(contrast @ estimate)
        spread = self._spread(rows, estimate, onsets[best], variance)
        deviation = sqrt(float(contrast @ covariances[best] @ contrast) * spread)
        dead = WANDER * self._assumed[0]
        droops = self._droop_changes(since[best], total) * estimate[1:3]
        dead += float(np.abs(droops) @ (PROPORTIONAL_ERROR, DROOP_ERROR))
        statistic = (drop - self._model_error * dead) / deviation
        return int(onsets[best]), drop, deviation, statistic, spread

    def _droop_changes(self, since: Array, total: Array) -> Array:
        """Return how much the droops change the mean supply pressure from before to after an onset.

        The two values are for r and R, in Pa per unit of these unknowns, which are in units of
        their priors.

        Args:
            since: products of the rows since the onset, (4, 4).
            total: products of all rows, (4, 4).
        """
        before, scale = total - since, self._scale[0]
        changes = since[0, 1:3] / since[0, 0] - before[0, 1:3] / before[0, 0]
        return np.asarray(changes * scale)

    def _contrasts(self, since: Array) -> Array:
        """Return weights of the unknowns that give the mean drop in Pa since each onset.

        The result is float64 (onsets, 5); only d and e have weights other than zero.
        """
        contrasts = np.zeros((since.shape[0], 5))
        contrasts[:, 3] = self._scale[0]
        contrasts[:, 4] = -SIGNS[1] * self._scale[0] * since[:, 0, 1] / since[:, 0, 0]
        return contrasts

    def _spread(self, rows: Array, estimate: Array, onset: int, variance: float) -> float:
        """Return the factor by which uneven or lasting noise raises the variance of a drop.

        Args:
            rows: rows of the blocks that are kept, (blocks, 4).
            estimate: the unknowns of the fit, (5,).
            onset: index in `rows` from which the drop is present.
            variance: noise variance of the fit, Pa^2.
        """
        left = rows[:, 3] - rows[:, :3] @ estimate[:3]
        left[onset:] -= rows[onset:, :2] @ (SIGNS * estimate[3:])
        # Two unknowns are fitted to the blocks since the onset alone.
        uneven = float((left[onset:] ** 2).sum()) / (left[onset:].size - 2) / variance
        return max(uneven, 1.0) * lasting_noise(left[:, None], self._model_error)


@lru_cache(maxsize=4096)
def _limit(share: float, blocks: int, model_error: float) -> float:
    """Return `SupplyTest.limit` for a number of blocks; `share` is the test's alarms a block."""
    freedom = _NOISE_WEIGHT + blocks
    onsets = min(max(blocks, 1), ONSETS)
    bound = student_quantile(min(share / onsets, 0.25), freedom)
    exact = noise_limit(share, WITNESSES, max(onsets, MINIMUM_BLOCKS), freedom)
    return between(exact, bound, model_error)


def _fitted(since: Array, total: Array, variance: float) -> tuple[Array, Array, Array]:
    """Fit the unknowns p_0, r, R, d, e for all possible onsets of the drop, with a given noise.

    Args:
        since: products of the rows since each onset, (onsets, 4, 4).
        total: products of all rows, (4, 4).
        variance: noise variance, Pa^2.

    Returns:
        The unknowns in units of their priors, float64 (onsets, 5); their covariances,
        (onsets, 5, 5); and the weighted sum of squares that each fit explains, (onsets,).
    """
    squares = np.empty((since.shape[0], 5, 5))
    squares[:, :3, :3] = total[:3, :3]
    squares[:, :3, 3:] = since[:, :3, :2] * SIGNS
    squares[:, 3:, :3] = squares[:, :3, 3:].transpose(0, 2, 1)
    squares[:, 3:, 3:] = since[:, :2, :2] * np.outer(SIGNS, SIGNS)
    products = np.empty((since.shape[0], 5))
    products[:, :3] = total[:3, 3]
    products[:, 3:] = since[:, :2, 3] * SIGNS
    # A drop may be as great as the supply pressure itself: next to no prior.
    prior = np.diag([1.0, 1.0, 1.0, SUPPLY_SIGMA**2, 1.0])
    covariance = np.linalg.inv(squares / variance + prior)
    estimate = (covariance @ products[:, :, None])[:, :, 0] / variance
    explained = (estimate * products).sum(axis=1) / variance
    return estimate, np.asarray(covariance), explained
