"""The sizes of the hidden effects: for each parameter, the intervals that it is drawn from.

Some effects shift a value that differs between healthy rigs anyway. Their intervals leave out those
values that refitting the nuisances would explain. The argument `limits` of
`drawn_trials.drawn_trial` replaces the ends next to the neutral value by multiples of the detection
limits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

from numpy import exp, log
from numpy.random import Generator

from tools.hidden_effects.rig_values import TABLE


@dataclass(frozen=True)
class Sizes:
    """The distribution that a parameter is drawn from.

    Attributes:
        intervals: each is (low, high); one of them is drawn first, all as likely, then a value
            within it.
        even: whether the value is uniform within its interval. Otherwise its logarithm is, and both
            ends of the interval must have the same sign.
    """

    intervals: tuple[tuple[float, float], ...]
    even: bool = False

    def drawn(self, rng: Generator) -> float:
        """Return a value drawn from the distribution."""
        low, high = self.intervals[int(rng.integers(len(self.intervals)))]
        if self.even:
            return float(rng.uniform(low, high))
        sign = -1.0 if high < 0.0 else 1.0
        return float(sign * exp(rng.uniform(*sorted((log(abs(low)), log(abs(high)))))))

    def beyond(self, smallest: float, neutral: float = 0.0) -> "Sizes":
        """Return the sizes with intervals that begin at the distance `smallest` from `neutral`.

        Each interval must lie on one side of the neutral value. Its end near that value is replaced
        and its far end stays; an interval that does not reach so far is left out.

        Raises:
            ValueError: no interval reaches so far.
        """
        kept: list[tuple[float, float]] = []
        for low, high in self.intervals:
            if low >= neutral:
                low = neutral + smallest
            else:
                high = neutral - smallest
            if low <= high:
                kept.append((low, high))
        if not kept:
            raise ValueError(f"no size in {self.intervals} is {smallest:g} from {neutral:g}")
        return Sizes(tuple(kept), self.even)

    def below(self, largest: float) -> "Sizes":
        """Return the sizes with intervals that end at `largest`; their lower ends stay.

        Intervals that begin above it are left out; those that ended below it become longer. This
        is meant for effects that are the larger, the smaller their value.

        Raises:
            ValueError: all intervals begin above `largest`.
        """
        kept = tuple((low, largest) for low, _ in self.intervals if low <= largest)
        if not kept:
            raise ValueError(f"no size in {self.intervals} is at most {largest:g}")
        return Sizes(kept, self.even)


def up(low: float, high: float) -> Sizes:
    """Return sizes whose logarithm is uniform between two positive ends."""
    return Sizes(((low, high),))


def either_way(low: float, high: float) -> Sizes:
    """Return the same with either sign."""
    return Sizes(((-high, -low), (low, high)))


def even(low: float, high: float) -> Sizes:
    """Return sizes that are uniform between two ends."""
    return Sizes(((low, high),), even=True)


def _shift(nominal: float, *factors: tuple[float, float]) -> Sizes:
    return Sizes(tuple((nominal * low, nominal * high) for low, high in factors))


_REST: Final = even(0.0, 0.0)

SIZES: Final[Mapping[str, Mapping[str, Sizes]]] = {
    "spool_null_bias": {"value": either_way(4e-6, 5e-5)},
    "valve_deadband": {"value": up(3e-6, 5e-5)},
    "valve_underlap_leakage": {"value": up(3e-6, 4e-5)},
    "valve_flow_asymmetry": {"value": either_way(0.04, 0.3)},
    "valve_hysteresis": {"value": up(2e-6, 2e-5)},
    "valve_bandwidth": {"value": Sizes(((200.0, 480.0), (850.0, 2000.0)))},
    "valve_rate_limit": {"value": up(5e-3, 0.03)},
    "command_delay": {"value": up(1e-3, 0.02)},
    "entrained_air": {"value": up(0.01, 0.05)},
    "bulk_modulus": {"value": _shift(TABLE.oil_stiffness, (0.45, 0.75), (1.3, 1.7))},
    "supply_pressure": {"value": _shift(TABLE.pump_pressure, (0.6, 0.9), (1.1, 1.4))},
    "supply_droop": {"value": up(2e12, 2e13)},
    "supply_ripple": {
        "amplitude": up(8e4, 6e5),
        "frequency": up(15.0, 150.0),
        "phase": even(0.0, 2.0 * pi),
    },
    "return_back_pressure": {"value": up(2e12, 2e13)},
    "friction_asymmetry": {"value": either_way(80.0, 500.0)},
    "stiction_level": {"value": _shift(TABLE.break_away, (0.55, 0.85), (1.2, 1.7))},
    "coulomb_level": {"value": _shift(TABLE.sliding, (0.5, 0.85), (1.15, 1.8))},
    "stribeck_velocity": {"value": _shift(TABLE.stribeck, (0.25, 0.6), (1.6, 4.0))},
    "viscous_friction": {"value": _shift(TABLE.drag, (0.1, 0.5), (1.6, 4.0))},
    "presliding_compliance": {"value": _shift(TABLE.seal_stiffness, (0.05, 0.4))},
    "internal_leakage": {"value": up(1e-9, 1e-8)},
    "external_leakage_1": {"value": up(5e-10, 6e-9)},
    "external_leakage_2": {"value": up(5e-10, 6e-9)},
    "spring_load": {"stiffness": up(5e3, 1e5), "contact": _REST},
    "constant_force": {"value": either_way(150.0, 3000.0)},
    "payload_mass": {"value": up(25.0, 500.0)},
    "end_stop": {"stiffness": up(2e6, 5e7)},
    "pressure_1_bias": {"value": either_way(8e4, 1e6)},
    "pressure_2_bias": {"value": either_way(8e4, 1e6)},
    "pressure_1_gain": {"value": Sizes(((0.8, 0.97), (1.03, 1.2)))},
    "pressure_2_gain": {"value": Sizes(((0.8, 0.97), (1.03, 1.2)))},
    "pressure_lag": {"value": up(2e-3, 0.05)},
    "position_gain": {"value": Sizes(((0.9, 0.985), (1.015, 1.1)))},
    "position_delay": {"value": up(1e-3, 0.02)},
    "position_backlash": {"value": up(1.5e-4, 2e-3)},
}
"""Sizes by effect on the menu and by parameter, SI.

`_REST` stands for parameters that `drawn_trials` draws later, because they depend on the motion.
"""

NUISANCES: Final[Mapping[str, tuple[float, float]]] = {
    "oil_stiffness": (TABLE.oil_stiffness, 0.15),
    "edge_coefficient": (TABLE.edge_coefficient, 0.05),
    "drag": (TABLE.drag, 0.30),
    "pump_pressure": (TABLE.pump_pressure, 0.05),
}
"""Values that differ between healthy rigs: nominal value (SI), greatest deviation as a share."""
