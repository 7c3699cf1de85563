"""Rigs drawn at random for the leak test, float64 (n,) for each quantity, SI."""

from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE, NOMINAL

Array = NDArray[np.float64]

MOST_BLOCKING = 1e-4 * LITRE_PER_MINUTE
"""Data sheet's greatest leak of a blocking valve at 10 MPa, m^3/s: that of `config/rigs/locked`."""


@dataclass(frozen=True)
class Rigs:
    """The quantities of n rigs.

    Attributes:
        leaks: flows (n, 3) in m^3/s at the test's pressure and difference.
        exponents: powers (n, 3) of the pressure with which they grow.
        position: where the ram stands, m.
        bulk_modulus: that of the oil without air, Pa.
        air: volume fraction of air at atmospheric pressure.
        blocking: leaks (n, 2) of the blocking valves at 10 MPa, m^3/s.
        blocking_exponents: powers (n, 2) of the pressure with which they grow.
        warmth: by how much the oil of each chamber (n, 2) is warmer than its surroundings, K.
        cooling_s: time constant of its exponential approach, s.
        heat: part of a pressure step that goes with the heat of compression.
        quick_s: time constant of three tenths of that, s.
        slow_s: time constant of the rest, s.
        yielding: part of a pressure step that goes as hoses and seals yield, (n, 2).
        yielding_s: time constant of that, s.
        creep: creep of the ram under the whole difference, m for each e-fold of 1 s + time.
        phase: where between two counts of the encoder the ram stands, m.
        zero_drift: drift of each pressure transducer (n, 2), Pa/s.
    """

    leaks: Array
    exponents: Array
    position: Array
    bulk_modulus: Array
    air: Array
    blocking: Array
    blocking_exponents: Array
    warmth: Array
    cooling_s: Array
    heat: Array
    quick_s: Array
    slow_s: Array
    yielding: Array
    yielding_s: Array
    creep: Array
    phase: Array
    zero_drift: Array


def drawn(count: int, generator: np.random.Generator, leaks: Array) -> Rigs:
    """Return rigs drawn at random, with `leaks` (count, 3) in m^3/s."""

    def between(low: float, high: float, *width: int) -> Array:
        return generator.uniform(low, high, (count, *width))

    def spread(low: float, high: float) -> Array:
        return np.exp(between(log(low), log(high)))

    common = generator.normal(0.0, 8.0, (count, 1))
    return Rigs(
        leaks=leaks,
        exponents=between(0.5, 1.0, 3),
        position=between(0.1, 0.5),
        bulk_modulus=NOMINAL.bulk_modulus * (1.0 + 0.08 * generator.standard_normal(count)),
        air=between(0.0, 0.005),
        blocking=MOST_BLOCKING * between(0.0, 1.0, 2),
        blocking_exponents=between(0.5, 1.0, 2),
        warmth=common + generator.normal(0.0, 3.0, (count, 2)),
        cooling_s=spread(200.0, 1500.0),
        heat=between(0.04, 0.09),
        quick_s=spread(20.0, 60.0),
        slow_s=spread(300.0, 900.0),
        yielding=between(0.001, 0.006, 2),
        yielding_s=spread(3.0, 20.0),
        creep=between(0.0, 4e-6),
        phase=between(0.0, 3e-5),
        zero_drift=generator.normal(0.0, 100.0, (count, 2)),
    )
