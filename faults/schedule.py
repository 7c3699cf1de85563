"""Faults over the time of a test, and the table of coefficients that the plant takes from them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import Checks, RequestError, RequestProblem
from rig.plant import FAULT_COLUMNS, quantities

from .bypass import NOMINAL_BYPASSES, port_opening, series_coefficient
from .verdict import FAULT_KINDS, LEAK_KINDS, Verdict

# Times are rounded to this many decimals; otherwise rounding errors could delay a fault by a tick.
_TIME_DECIMALS: Final = 9
_INSTANT_S: Final = 10.0**-_TIME_DECIMALS

_BLOCKAGE: Final = Verdict.RETURN_BLOCKAGE


class FaultError(RequestError):
    """The error of a fault that cannot be injected, or of faults that exclude each other."""


@dataclass(frozen=True)
class Fault:
    """One fault of a test: from `at_s` on it grows to its coefficient, from `until_s` on it ends.

    A square-root leak comes from a bypass. Its ball valve opens over `travel_s` from `at_s` on, and
    shuts as slowly from `until_s` on. As it is in series with the needle, most of the leak appears
    early in the travel. A linear leak or a return blockage has no bypass; it is proportional to the
    open part of the port. In either case the coefficient itself (the needle, or wear) rises
    linearly over `ramp_s` from `at_s` on.

    Attributes:
        kind: one of `faults.verdict.FAULT_KINDS`.
        coefficient: coefficient of the fully open fault: m^3/(s Pa^0.5) (eq. 5.2), m^3/(s Pa) if
            linear (eq. 5.1), Pa/(m^3/s)^2 for return_blockage.
        linear: whether the leak is proportional to the pressure drop; for leaks of the actuator
            only.
        at_s: time at which the ball begins to open, in s from the start of the test.
        until_s: time at which the ball begins to shut, in s; inf for never.
        ramp_s: time in s that the coefficient takes to grow; 0 for at once.
        travel_s: time in s that the ball takes from shut to open; 0 for at once.
        ball_coefficient: coefficient of the open ball valve alone, m^3/(s Pa^0.5); None for that of
            the nominal rig; without effect on a fault that has no bypass.
        follows: coefficient of the fault at the same place that ends as this one begins, from which
            this one grows or shrinks; 0 if it begins by itself, with a shut bypass.
        goes_on: whether another fault at the same place begins as this one ends, so that the bypass
            is not shut.

    Raises:
        FaultError: the kind is unknown, a value is out of range, or the coefficient is not below
            that of the ball; the coefficient is checked only once all else is valid.
    """

    kind: str
    coefficient: float
    linear: bool = False
    at_s: float = 0.0
    until_s: float = inf
    ramp_s: float = 0.0
    travel_s: float = 0.0
    ball_coefficient: float | None = None
    follows: float = 0.0
    goes_on: bool = False

    def __post_init__(self) -> None:
        with Checks(str(self.kind), FaultError, self) as checks:
            remedy = f"give one of {', '.join(FAULT_KINDS)}"
            checks.require(self.kind in FAULT_KINDS, "kind", "is no fault", remedy)
            fits = not self.linear or self.kind in LEAK_KINDS
            limit = "holds for the leaks of the actuator only"
            checks.require(fits, "linear", limit, "leave it out")
            fits = self.ball_coefficient is None or 0.0 < self.ball_coefficient < inf
            remedy = "give it in m^3/(s Pa^0.5), or leave it out for the nominal rig's"
            checks.require(fits, "ball_coefficient", "is not above 0 or not finite", remedy)
            self._require_times(checks)
            checks.finish()
            self._require_coefficient(checks)

    def _require_times(self, checks: Checks) -> None:
        for name, remedy in (
            ("at_s", "give seconds from the start of the test"),
            ("ramp_s", "give seconds, 0 for at once"),
            ("travel_s", "give seconds, 0 for at once"),
        ):
            is_time = 0.0 <= getattr(self, name) < inf
            checks.require(is_time, name, "is below 0 s or not finite", remedy)
        remedy = "end the fault after it begins, or leave until_s out"
        limit = f"is not after at_s ({self.at_s})"
        checks.require(self.until_s > self.at_s, "until_s", limit, remedy)

    def _require_coefficient(self, checks: Checks) -> None:
        quantity = quantities()["return_back_pressure" if self.kind == _BLOCKAGE else self.column]
        shown = f"{self.coefficient:.4g} {quantity.unit}"
        remedy = "give it in SI, or leave the fault out"
        limit = f"is not above 0 and up to {quantity.upper:.4g}"
        fits = 0.0 < self.coefficient <= quantity.upper
        checks.require(fits, "coefficient", limit, remedy, shown)
        if self._through_bypass:
            fits = not self.coefficient >= self._ball
            limit = f"is not below the {self._ball:.4g} of the open ball valve"
            remedy = "ask for a smaller leak or fit a larger ball valve"
            checks.require(fits, "coefficient", limit, remedy, shown)

    @property
    def column(self) -> str:
        """Return the name, one of `FAULT_COLUMNS`, of the plant's coefficient for this fault."""
        return f"{self.kind}_linear" if self.linear else str(self.kind)

    @property
    def end_s(self) -> float:
        """Return the time in s at which the ball has shut and the fault is gone; inf for never.

        A ball that is still opening at `until_s` shuts from where it is. If another fault goes on
        at the same place, this is when that begins.
        """
        if self.goes_on:
            return self.until_s
        return self.until_s + min(self.travel_s, self.until_s - self.at_s)

    @property
    def _through_bypass(self) -> bool:
        return not self.linear and self.kind != _BLOCKAGE

    @property
    def _ball(self) -> float:
        """Return the coefficient of the open ball valve; only for a fault through a bypass."""
        if self.ball_coefficient is None:
            return NOMINAL_BYPASSES[self.kind].ball_coefficient
        return self.ball_coefficient

    def ball_position(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ball's position (0 shut, 1 open) at each time in s, same shape as `time_s`.

        Before a fault that `follows` another and after one that `goes_on`, the ball is that other
        one's to move, and the position is 0.
        """
        opening = _share(time_s, self.at_s, 0.0 if self.follows else self.travel_s)
        if self.goes_on:
            return np.where(_share(time_s, self.until_s, 0.0) > 0.0, 0.0, opening)
        if self.follows:
            return (opening - _share(time_s, self.until_s, self.travel_s)).clip(0.0)
        reached = _share(np.array([self.until_s]), self.at_s, self.travel_s)[0]
        return np.minimum(opening, reached - _share(time_s, self.until_s, self.travel_s)).clip(0.0)

    def acting(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coefficient that acts at each time in s, same unit as `coefficient`.

        The result has the shape of `time_s`. It lies between 0 and the larger of `coefficient` and
        `follows`, and is 0 before `at_s` and from `end_s` on.
        """
        port = port_opening(self.ball_position(time_s))
        grown = _share(time_s, self.at_s, self.ramp_s)
        if not self._through_bypass:
            return (self.follows + (self.coefficient - self.follows) * grown) * port
        before, needle = self._needle(self.follows), self._needle(self.coefficient)
        series = series_coefficient(before + (needle - before) * grown, self._ball * port)
        return np.minimum(series, max(self.coefficient, self.follows))

    def _needle(self, coefficient: float) -> float:
        """Return the coefficient of the needle that makes a leak of `coefficient` with the ball."""
        share = coefficient / self._ball
        return float(coefficient / np.sqrt((1.0 - share) * (1.0 + share)))


def linked(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Return faults with those linked that meet at one place, in the order in which they begin.

    Of two faults of one kind and law, of which the later begins at the very time at which the
    earlier ends, the earlier `goes_on` and the later `follows` it. Linking faults again changes
    nothing.
    """
    made = sorted(faults, key=lambda fault: fault.at_s)
    for index, later in enumerate(made):
        for place in range(index):
            earlier = made[place]
            meets = abs(earlier.until_s - later.at_s) < _INSTANT_S
            if meets and earlier.column == later.column:
                made[place] = replace(earlier, goes_on=True)
                made[index] = replace(later, follows=earlier.coefficient)
    return tuple(made)


def _share(time_s: NDArray[np.float64], start_s: float, length_s: float) -> NDArray[np.float64]:
    """Return the part (0 to 1) of a period that has passed at each time; all times are in s.

    The period begins at `start_s`. If `length_s` is 0, the result jumps from 0 to 1 there.
    """
    elapsed = np.round(time_s - start_s, _TIME_DECIMALS)
    if length_s < _INSTANT_S:
        return (elapsed >= 0.0).astype(np.float64)
    return np.clip(elapsed / length_s, 0.0, 1.0)


class FaultSchedule:
    """The faults of one test, in the order in which they begin; several may act at once.

    Raises:
        FaultError: a fault begins before an earlier one on the same column is gone (`end_s`), which
            is impossible as a bypass has one coefficient.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self.faults = linked(faults)
        problems = [
            RequestProblem(
                str(later.kind),
                "at_s",
                later.at_s,
                f"is before the same fault from {earlier.at_s} s on is gone ({earlier.end_s} s)",
                "begin it later, or as the first one ends: the bypass then stays open",
            )
            for column in FAULT_COLUMNS
            for earlier, later in pairwise(f for f in self.faults if f.column == column)
            if later.at_s < earlier.end_s
        ]
        if problems:
            raise FaultError(problems)

    def table(self, n_ticks: int, period_s: float) -> NDArray[np.float64]:
        """Return the coefficients that act in each tick, float64 (n_ticks, 8), SI.

        Columns are as `rig.plant.faults.FAULT_COLUMNS`. Row k has the coefficients at the time
        k `period_s` (s), which the plant keeps constant over the tick.
        """
        time_s = period_s * np.arange(n_ticks, dtype=np.float64)
        table = np.zeros((n_ticks, len(FAULT_COLUMNS)))
        for fault in self.faults:
            table[:, FAULT_COLUMNS.index(fault.column)] += fault.acting(time_s)
        return table
