"""Calibrates a needle valve: finds its coefficient from a flow meter and the pressure drop.

A flow meter and two pressures see the bypass, ball and needle in series: k = q / sqrt(dp). Noise is
judged by batches long against the meter's lag, which are independent of each other (the method of
batch means: Law, Simulation Modeling and Analysis, ch. 9).
"""

import datetime
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import hypot, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import Checks, RequestError

from .bypass import BypassValve, coefficient_beside
from .needle import NeedleCharacteristic

Array = NDArray[np.float64]

RESOLVED: Final = 3.0
"""Number of standard errors above which a flow is distinguished from no flow."""
_SETTLED: Final = 3.0
"""Number of standard deviations by which a batch may differ from the batches after it."""
_LEAST_DROP: Final = 3e5
"""Pa. Ten times the noise of a pressure transducer: a smaller drop says little about a valve."""


class CalibrationError(RequestError):
    """A valve that cannot be calibrated by what was measured."""


class UnsettledError(Exception):
    """The batches go on changing, so that there is nothing to average yet."""


class Estimate(NamedTuple):
    """A value and its standard error, in the same unit."""

    value: float
    standard_error: float

    @property
    def is_resolved(self) -> bool:
        """Whether the value can be distinguished from zero."""
        return self.value > RESOLVED * self.standard_error


@dataclass(frozen=True)
class Measurement:
    """One opening of a needle, measured once.

    Attributes:
        opening: that the needle was sent to, 0 to 1.
        upwards: whether it came from a smaller opening.
        feedback: opening that the needle reported, NaN if it reports none.
        flow: through the bypass, m^3/s, without the meter's zero.
        drop_Pa: mean pressure drop across the bypass.
        coefficient: of ball and needle in series, m^3/(s Pa^0.5).
    """

    opening: float
    upwards: bool
    feedback: float
    flow: Estimate
    drop_Pa: float  # noqa: N815
    coefficient: Estimate


@dataclass(frozen=True)
class CalibratedPoint:
    """One opening of a calibrated needle.

    Attributes:
        opening: 0 to 1.
        coefficient: of the needle alone, m^3/(s Pa^0.5); the mean of up and down.
        hysteresis: by how much it was greater on the way up, m^3/(s Pa^0.5).
    """

    opening: float
    coefficient: Estimate
    hysteresis: float

    @property
    def bound(self) -> float:
        """The most that the coefficient can be, by two standard errors (95 %)."""
        return max(self.coefficient.value, 0.0) + 2.0 * self.coefficient.standard_error


@dataclass(frozen=True)
class NeedleCalibration:
    """A needle valve as calibrated.

    Attributes:
        needle: its characteristic, through the points that the meter resolves.
        points: everything that was measured, by opening.
    """

    needle: NeedleCharacteristic
    points: tuple[CalibratedPoint, ...]


def batches(samples: Array, ticks: int) -> Array:
    """Return successive batches (m, ticks) of samples; an incomplete first one is left out."""
    return samples[samples.size % ticks :].reshape(-1, ticks)


def settled(values: Array) -> Array:
    """Return batch values (m,) without the first ones, as long as those differ from the rest.

    Noise is taken from successive differences (von Neumann 1941), which a drift hardly moves.

    Raises:
        UnsettledError: less than half of them agree.
    """
    for first in range(values.size - values.size // 2):
        rest = values[first + 1 :]
        noise = sqrt(float(np.mean(np.diff(rest) ** 2)) / 2.0)
        allowed = _SETTLED * noise * sqrt(1.0 + 1.0 / rest.size)
        if abs(values[first] - rest.mean()) <= allowed + 1e-9 * abs(rest.mean()):
            return values[first:]
    raise UnsettledError("it goes on changing")


def meter_zero(flow: Array, ticks: int) -> Estimate:
    """Return what a meter reads without a flow, m^3/s, from samples (n,) and a batch's length.

    Batches have medians, here and of a flow: a meter that reads nothing below zero cuts off part of
    its noise, which lifts a mean much more. Samples that are NaN do not count.
    """
    known = flow[np.isfinite(flow)]
    medians = np.median(batches(known, ticks), axis=1)
    return Estimate(float(medians.mean()), _error_of_mean(medians))


def measured_coefficient(
    flow: Array, drop: Array, zero: Estimate, ticks: int
) -> tuple[Estimate, Estimate, float]:
    """Return flow in m^3/s, coefficient in m^3/(s Pa^0.5), and mean drop in Pa, once settled.

    Args:
        flow: (n,) as metered, m^3/s; where it or the drop is NaN, neither counts.
        drop: (n,) across the bypass, Pa; its sign does not matter, as meters see no direction.
        zero: of the meter.
        ticks: samples of a batch.

    Raises:
        UnsettledError: the coefficient goes on changing.
    """
    known = np.isfinite(flow) & np.isfinite(drop)
    roots = batches(np.sqrt(np.abs(drop[known])), ticks).mean(axis=1)
    flows = np.median(batches(flow[known], ticks), axis=1) - zero.value
    coefficients = settled(flows / roots)
    flows, roots = flows[-coefficients.size :], roots[-coefficients.size :]
    return (
        _with_zero(flows, zero.standard_error),
        _with_zero(coefficients, zero.standard_error / float(roots.mean())),
        float(np.mean(roots**2)),
    )


def _with_zero(values: Array, zero_error: float) -> Estimate:
    return Estimate(float(values.mean()), hypot(_error_of_mean(values), zero_error))


def _error_of_mean(values: Array) -> float:
    return float(np.std(values, ddof=1)) / sqrt(values.size)


def calibrated_needle(
    valve: BypassValve, measurements: Iterable[Measurement], date: datetime.date
) -> NeedleCalibration:
    """Return a needle's own coefficient at each opening, the ball's share removed.

    Openings at which the meter does not distinguish the flow from none are left out; a shut needle
    that passes so little counts as tight.

    Raises:
        CalibrationError: the drop was too small, more passed than the open ball lets pass, or
            nothing passed the open needle.
        BypassError: what was measured does not increase with the opening.
    """
    ordered = sorted(measurements, key=lambda each: each.opening)
    _require_possible(valve, ordered)
    points = tuple(
        _point(valve, opening, list(group))
        for opening, group in groupby(ordered, key=lambda each: each.opening)
    )
    table = [(each.opening, each.coefficient.value) for each in points
             if each.coefficient.is_resolved]  # fmt: skip
    if not table or table[0][0] > 0.0:
        table.insert(0, (0.0, 0.0))
    name = f"{valve.name}, {date.isoformat()}"
    return NeedleCalibration(NeedleCharacteristic.from_table(table, date, name), points)


def _require_possible(valve: BypassValve, measurements: Sequence[Measurement]) -> None:
    checks = Checks(valve.name, CalibrationError)
    for each in measurements:
        where = f"opening {each.opening:g}"
        checks.require(
            each.drop_Pa >= _LEAST_DROP,
            where,
            f"{1e-6 * each.drop_Pa:.2f} MPa",
            f"is less drop than the {1e-6 * _LEAST_DROP:g} MPa that a measurement needs",
            "check the supply pressure and the pressure lines",
        )
        checks.require(
            each.coefficient.value < valve.ball_coefficient,
            where,
            f"{each.coefficient.value:.4g} m^3/(s Pa^0.5)",
            f"is more than the open ball passes ({valve.ball_coefficient:.4g})",
            "correct its `bore` in the rig file, or check the meter",
        )
    fully_open = measurements[-1].coefficient
    checks.require(
        fully_open.is_resolved,
        f"opening {measurements[-1].opening:g}",
        f"{fully_open.value:.2g} +- {fully_open.standard_error:.2g} m^3/(s Pa^0.5)",
        "cannot be told from no flow",
        "check that ball and needle open, and the meter",
    )
    checks.finish()


def _point(valve: BypassValve, opening: float, group: Sequence[Measurement]) -> CalibratedPoint:
    estimates = [_without_ball(each.coefficient, valve) for each in group]
    values = {each.upwards: k.value for each, k in zip(group, estimates, strict=True)}
    # The errors have a plain mean: most of each may be the zero's error, which all share.
    return CalibratedPoint(
        opening,
        Estimate(
            float(np.mean([k.value for k in estimates])),
            float(np.mean([k.standard_error for k in estimates])),
        ),
        values.get(True, np.nan) - values.get(False, np.nan),
    )


def _without_ball(series: Estimate, valve: BypassValve) -> Estimate:
    ball = valve.ball_coefficient
    # The derivative of the result by the series coefficient.
    slope = (1.0 - (series.value / ball) ** 2) ** -1.5
    return Estimate(float(coefficient_beside(series.value, ball)), slope * series.standard_error)
