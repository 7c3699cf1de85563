"""Calibration of a needle valve: its coefficient from a flow meter and the pressure drop.

A flow meter and two pressures measure the bypass, ball and needle in series: k = q / sqrt(dp).
Samples are averaged over batches that are long against the meter's lag and therefore independent of
each other; the noise follows from their differences (the method of batch means: Law, Simulation
Modeling and Analysis, ch. 9).
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
"""Number of standard errors above which a value is distinguished from zero."""
_SETTLED: Final = 3.0
"""Number of standard deviations by which a batch may differ from the batches after it."""
_LEAST_DROP: Final = 3e5
"""Least pressure drop in Pa of a measurement: ten times the noise of a pressure transducer."""


class CalibrationError(RequestError):
    """The error of measurements from which a valve cannot be calibrated."""


class UnsettledError(Exception):
    """The error of batches that still change, so that they cannot be averaged yet."""


class Estimate(NamedTuple):
    """A value and its standard error, in the same unit."""

    value: float
    standard_error: float

    @property
    def is_resolved(self) -> bool:
        """Return whether the value is above zero by more than `RESOLVED` standard errors."""
        return self.value > RESOLVED * self.standard_error


@dataclass(frozen=True)
class Measurement:
    """One measurement at one opening of a needle.

    Attributes:
        opening: opening to which the needle was sent, 0 to 1.
        upwards: whether the needle came from a smaller opening.
        feedback: opening that the needle reported; NaN if it reports no opening.
        flow: flow through the bypass, m^3/s, with the meter's zero subtracted.
        drop_Pa: mean pressure drop across the bypass.
        coefficient: coefficient of ball and needle in series, m^3/(s Pa^0.5).
    """

    opening: float
    upwards: bool
    feedback: float
    flow: Estimate
    drop_Pa: float  # noqa: N815
    coefficient: Estimate


@dataclass(frozen=True)
class CalibratedPoint:
    """The result of a calibration at one opening.

    Attributes:
        opening: opening of the needle, 0 to 1.
        coefficient: coefficient of the needle alone, m^3/(s Pa^0.5): the mean of all measurements
            at this opening, with the mean of their standard errors.
        hysteresis: coefficient on the last way up less that on the last way down, m^3/(s Pa^0.5);
            NaN if either was not measured.
    """

    opening: float
    coefficient: Estimate
    hysteresis: float

    @property
    def bound(self) -> float:
        """Return the upper bound of the coefficient, two standard errors (95 %) above its value.

        It is in m^3/(s Pa^0.5). A negative value counts as 0.
        """
        return max(self.coefficient.value, 0.0) + 2.0 * self.coefficient.standard_error


@dataclass(frozen=True)
class NeedleCalibration:
    """The result of the calibration of a needle valve.

    Attributes:
        needle: characteristic through the points whose flow the meter distinguishes from no flow;
            the shut needle has coefficient 0 if its own point is not among them.
        points: all points in the order of their openings.
    """

    needle: NeedleCharacteristic
    points: tuple[CalibratedPoint, ...]


def batches(samples: Array, ticks: int) -> Array:
    """Return samples (n,) as successive batches (m, ticks); the first n % ticks are left out."""
    return samples[samples.size % ticks :].reshape(-1, ticks)


def settled(values: Array) -> Array:
    """Return batch values (m,) without the leading ones that differ from the mean of those after.

    Values are left out one by one from the first, until one agrees with the mean of all after it to
    three standard deviations. The noise is estimated from successive differences (von Neumann
    1941), which a drift hardly changes.

    Raises:
        UnsettledError: half of the values or more would have to be left out, or fewer than three
            would be left.
    """
    # The noise of the rest is known from two values on.
    for first in range(min(values.size - values.size // 2, values.size - 2)):
        rest = values[first + 1 :]
        noise = sqrt(float(np.mean(np.diff(rest) ** 2)) / 2.0)
        allowed = _SETTLED * noise * sqrt(1.0 + 1.0 / rest.size)
        if abs(values[first] - rest.mean()) <= allowed + 1e-9 * abs(rest.mean()):
            return values[first:]
    raise UnsettledError("it goes on changing")


def meter_zero(flow: Array, ticks: int) -> Estimate:
    """Return the zero of a flow meter, its mean reading without flow in m^3/s, with standard error.

    Each batch counts with its median, as in `measured_coefficient`. A meter that reads nothing
    below zero cuts off part of its noise, which would raise a mean much more than a median.

    Args:
        flow: samples (n,) without flow, m^3/s, at least two batches; NaN ones do not count.
        ticks: number of samples of a batch.
    """
    known = flow[np.isfinite(flow)]
    medians = np.median(batches(known, ticks), axis=1)
    return Estimate(float(medians.mean()), _error_of_mean(medians))


def measured_coefficient(
    flow: Array, drop: Array, zero: Estimate, ticks: int
) -> tuple[Estimate, Estimate, float]:
    """Return a bypass's mean flow in m^3/s, coefficient in m^3/(s Pa^0.5), and mean drop in Pa.

    Batches before the coefficient has settled are left out (`settled`). Flow and coefficient come
    with standard errors, which include that of the zero.

    Args:
        flow: readings of the meter (n,), m^3/s; samples in which it or the drop is NaN do not
            count.
        drop: pressure drop across the bypass (n,), Pa; its sign does not matter, as meters see no
            direction.
        zero: zero of the meter, which is subtracted.
        ticks: number of samples of a batch.

    Raises:
        UnsettledError: the coefficient does not settle, or there are fewer than three batches.
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
    """Return the calibration of a needle alone, without the restriction of the ball valve.

    Openings at which the flow cannot be distinguished from no flow are left out of the
    characteristic. A shut needle with so little flow, or without a measurement, counts as tight.

    Args:
        valve: the bypass, of which the ball valve's coefficient is used.
        measurements: all measurements, at least one, in any order.
        date: day of the calibration.

    Raises:
        CalibrationError: a mean pressure drop was below 0.3 MPa, a coefficient was not below that
            of the open ball, or the flow at the largest opening cannot be told from no flow.
        BypassError: the largest opening is not 1, or the points do not clearly increase
            (`NeedleCharacteristic`).
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
    with Checks(valve.name, CalibrationError) as checks:
        for each in measurements:
            where = f"opening {each.opening:g}"
            limit = f"is less drop than the {1e-6 * _LEAST_DROP:g} MPa that a measurement needs"
            remedy = "check the supply pressure and the pressure lines"
            drop = f"{1e-6 * each.drop_Pa:.2f} MPa"
            checks.require(each.drop_Pa >= _LEAST_DROP, where, limit, remedy, drop)
            found, most = each.coefficient.value, valve.ball_coefficient
            limit = f"is more than the open ball passes ({most:.4g})"
            remedy = "correct its `bore` in the rig file, or check the meter"
            checks.require(found < most, where, limit, remedy, f"{found:.4g} m^3/(s Pa^0.5)")
        where, fully_open = f"opening {measurements[-1].opening:g}", measurements[-1].coefficient
        value = f"{fully_open.value:.2g} +- {fully_open.standard_error:.2g} m^3/(s Pa^0.5)"
        remedy = "check that ball and needle open, and the meter"
        checks.require(fully_open.is_resolved, where, "cannot be told from no flow", remedy, value)


def _point(valve: BypassValve, opening: float, group: Sequence[Measurement]) -> CalibratedPoint:
    estimates = [_without_ball(each.coefficient, valve) for each in group]
    values = {each.upwards: k.value for each, k in zip(group, estimates, strict=True)}
    # The errors are averaged and not combined as independent: most of each may come from the
    # meter's zero, which all have in common.
    mean = Estimate(
        float(np.mean([k.value for k in estimates])),
        float(np.mean([k.standard_error for k in estimates])),
    )
    hysteresis = values.get(True, np.nan) - values.get(False, np.nan)
    return CalibratedPoint(opening, mean, hysteresis)


def _without_ball(series: Estimate, valve: BypassValve) -> Estimate:
    ball = valve.ball_coefficient
    # The derivative of the result by the series coefficient.
    slope = (1.0 - (series.value / ball) ** 2) ** -1.5
    return Estimate(float(coefficient_beside(series.value, ball)), slope * series.standard_error)
