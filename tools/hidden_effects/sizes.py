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


def _up(low: float, high: float) -> Sizes:
    return Sizes(((low, high),))


def _either_way(low: float, high: float) -> Sizes:
    return Sizes(((-high, -low), (low, high)))


def _shift(nominal: float, *factors: tuple[float, float]) -> Sizes:
    return Sizes(tuple((nominal * low, nominal * high) for low, high in factors))


_REST: Final = Sizes(((0.0, 0.0),), even=True)

SIZES: Final[Mapping[str, Mapping[str, Sizes]]] = {
    "spool_null_bias": {"value": _either_way(4e-6, 5e-5)},
    "valve_deadband": {"value": _up(3e-6, 5e-5)},
    "valve_underlap_leakage": {"value": _up(3e-6, 4e-5)},
    "valve_flow_asymmetry": {"value": _either_way(0.04, 0.3)},
    "valve_hysteresis": {"value": _up(2e-6, 2e-5)},
    "valve_bandwidth": {"value": Sizes(((200.0, 480.0), (850.0, 2000.0)))},
    "valve_rate_limit": {"value": _up(5e-3, 0.03)},
    "command_delay": {"value": _up(1e-3, 0.02)},
    "entrained_air": {"value": _up(0.01, 0.05)},
    "bulk_modulus": {"value": _shift(TABLE.oil_stiffness, (0.45, 0.75), (1.3, 1.7))},
    "supply_pressure": {"value": _shift(TABLE.pump_pressure, (0.6, 0.9), (1.1, 1.4))},
    "supply_droop": {"value": _up(2e12, 2e13)},
    "supply_ripple": {
        "amplitude": _up(8e4, 6e5),
        "frequency": _up(15.0, 150.0),
        "phase": Sizes(((0.0, 2.0 * pi),), even=True),
    },
    "return_back_pressure": {"value": _up(2e12, 2e13)},
    "friction_asymmetry": {"value": _either_way(80.0, 500.0)},
    "stiction_level": {"value": _shift(TABLE.break_away, (0.55, 0.85), (1.2, 1.7))},
    "coulomb_level": {"value": _shift(TABLE.sliding, (0.5, 0.85), (1.15, 1.8))},
    "stribeck_velocity": {"value": _shift(TABLE.stribeck, (0.25, 0.6), (1.6, 4.0))},
    "viscous_friction": {"value": _shift(TABLE.drag, (0.1, 0.5), (1.6, 4.0))},
    "presliding_compliance": {"value": _shift(TABLE.seal_stiffness, (0.05, 0.4))},
    "internal_leakage": {"value": _up(1e-9, 1e-8)},
    "external_leakage_1": {"value": _up(5e-10, 6e-9)},
    "external_leakage_2": {"value": _up(5e-10, 6e-9)},
    "spring_load": {"stiffness": _up(5e3, 1e5), "contact": _REST},
    "constant_force": {"value": _either_way(150.0, 3000.0)},
    "payload_mass": {"value": _up(25.0, 500.0)},
    "end_stop": {"stiffness": _up(2e6, 5e7)},
    "pressure_1_bias": {"value": _either_way(8e4, 1e6)},
    "pressure_2_bias": {"value": _either_way(8e4, 1e6)},
    "pressure_1_gain": {"value": Sizes(((0.8, 0.97), (1.03, 1.2)))},
    "pressure_2_gain": {"value": Sizes(((0.8, 0.97), (1.03, 1.2)))},
    "pressure_lag": {"value": _up(2e-3, 0.05)},
    "position_gain": {"value": Sizes(((0.9, 0.985), (1.015, 1.1)))},
    "position_delay": {"value": _up(1e-3, 0.02)},
    "position_backlash": {"value": _up(1.5e-4, 2e-3)},
}
"""Sizes by effect on the menu and by parameter, SI.

`_REST` stands for parameters that `drawn_trials` draws later, because they depend on the motion.
"""

OFF_MENU_SIZES: Final[Mapping[str, Mapping[str, Sizes]]] = {
    "tight_spot": {
        "tight_spot": _up(400.0, 1500.0),
        "tight_place": _REST,
        "tight_width": _up(0.01, 0.05),
    },
    "pilot_resonance": {
        "pilot_frequency": _up(120.0, 500.0),
        "pilot_damping": _up(0.05, 0.2),
    },
    "warming_oil": {"oil_trend": Sizes(((0.012, 0.025), (-0.03, -0.015)))},
    "cogging": {"cogging": _up(300.0, 1500.0), "cogging_pitch": _up(0.008, 0.06)},
    "pressed_seal": {"squeeze": _up(1e-11, 4e-11)},
    "drifting_null": {"null_trend": _either_way(4e-7, 2e-6)},
    "worn_place": {
        "worn_leak": _up(6e-9, 3e-8),
        "worn_place": _REST,
        "worn_width": _up(0.01, 0.05),
    },
    "leaking_relief": {
        "relief_leak": _up(5e-12, 3e-11),
        "relief_pressure": Sizes(((7.4e6, 8.2e6),), even=True),
    },
    "square_drag": {"drag_square": _up(3e3, 2e4)},
    "encoder_wave": {"encoder_wave": _up(2e-4, 8e-4), "encoder_pitch": _up(0.008, 0.04)},
    "jittering_command": {"dead_time_jitter": _up(6e-3, 0.02)},
    "fading_valve": {"valve_heat": _up(8e-3, 0.02)},
}

NUISANCES: Final[Mapping[str, tuple[float, float]]] = {
    "oil_stiffness": (TABLE.oil_stiffness, 0.15),
    "edge_coefficient": (TABLE.edge_coefficient, 0.05),
    "drag": (TABLE.drag, 0.30),
    "pump_pressure": (TABLE.pump_pressure, 0.05),
}
"""Values that differ between healthy rigs: nominal value (SI), greatest deviation as a share."""
