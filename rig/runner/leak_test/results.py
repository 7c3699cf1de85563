"""What came of a leak test, as figures for programs and in words."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.leak_test import FALSE_ALARMS, LeakTestResult, Soak
from rig.plant import LITRE_PER_MINUTE

SCHEMA: Final = "rig-leak-test"
"""Value of the key `schema`, by which `leak_test.json` is recognized."""


_SECOND_PART: Final = 0.25
"""Length in s of the stretch whose mean is the first, or the last, pressure of a soak."""

PLACES: Final = {
    "external_leakage_1": "chamber 1, out",
    "external_leakage_2": "chamber 2, out",
    "internal_leakage": "across the piston",
}
"""What the places that may leak are called for a reader."""


class SoakEnds(NamedTuple):
    """How a soak began and ended, as means of a quarter of a second."""

    pressure_1: tuple[float, float]
    """Pressure of chamber 1 at first and at last, Pa."""
    pressure_2: tuple[float, float]
    """That of chamber 2, Pa."""
    way: float
    """Way of the ram, m."""


@dataclass(frozen=True)
class LeakTest:
    """What came of a leak test.

    Attributes:
        rig: name of the rig.
        found: what the fit tells.
        foreseen: smallest leaks in m^3/s that 95 of 100 tests find, computed before the test, in
            the order of `rig.plant.LEAKS`.
        ends: how each soak began and ended.
        duration_s: how long the test took, s.
        blocking_leak: greatest leak of a shut blocking valve by its data sheet, m^3/s.
        blocking_pressure: the pressure difference at which that is stated, Pa.
    """

    rig: str
    found: LeakTestResult
    foreseen: tuple[float, ...]
    ends: tuple[SoakEnds, ...]
    duration_s: float
    blocking_leak: float
    blocking_pressure: float

    @property
    def leaks(self) -> tuple[str, ...]:
        """The names of the places that leak."""
        return tuple(each.name for each in self.found.findings if each.is_leak)


def ends_of(soak: Soak) -> SoakEnds:
    """Return how a soak began and ended."""
    samples = max(1, round(_SECOND_PART / (soak.time_s[1] - soak.time_s[0])))

    def ends(values: NDArray[np.float64]) -> tuple[float, float]:
        return float(values[:samples].mean()), float(values[-samples:].mean())

    way = float(soak.position[-1] - soak.position[0])
    return SoakEnds(ends(soak.pressure_1), ends(soak.pressure_2), way)


def leak_test_lines(test: LeakTest) -> Iterator[str]:
    """Yield a line for each place with its leak and 95 % interval, and one for blocking valves."""
    for each in test.found.findings:
        flow, low, high, smallest = (
            value / LITRE_PER_MINUTE for value in (each.flow, each.lower, each.upper, each.smallest)
        )
        verdict = "leak" if each.is_leak else "healthy"
        yield (
            f"{PLACES[each.name]}: {verdict}, {flow:.5f} ({low:.5f} to {high:.5f}) L/min, "
            f"could have seen {smallest:.5f}"
        )
    valves = " and ".join(
        f"{each.flow / LITRE_PER_MINUTE:.5f} ({each.lower / LITRE_PER_MINUTE:.5f} to "
        f"{each.upper / LITRE_PER_MINUTE:.5f})"
        for each in test.found.blocking
    )
    yield (
        f"blocking valves: {valves} L/min at {1e-6 * test.blocking_pressure:g} MPa, at most "
        f"{test.blocking_leak / LITRE_PER_MINUTE:.5f} by their data sheet"
    )


def leak_test_figures(test: LeakTest) -> dict[str, Any]:
    """Return the results as JSON-able values, flows in L/min; other programs rely on the keys."""
    levels = test.found.levels
    return {
        "schema": SCHEMA,
        "rig": test.rig,
        "leaks": list(test.leaks),
        "false_alarms": FALSE_ALARMS,
        "pressure_Pa": levels.pressure,
        "difference_Pa": levels.difference,
        "places": {
            each.name: {
                "verdict": "leak" if each.is_leak else "healthy",
                "leak_L_per_min": each.flow / LITRE_PER_MINUTE,
                "interval_95_L_per_min": [
                    each.lower / LITRE_PER_MINUTE,
                    each.upper / LITRE_PER_MINUTE,
                ],
                "smallest_L_per_min": each.smallest / LITRE_PER_MINUTE,
                "foreseen_L_per_min": foreseen / LITRE_PER_MINUTE,
                "limited_by": each.limited_by,
            }
            for each, foreseen in zip(test.found.findings, test.foreseen, strict=True)
        },
        "blocking_valves": {
            "pressure_Pa": test.blocking_pressure,
            "most_L_per_min": test.blocking_leak / LITRE_PER_MINUTE,
            **{
                f"chamber_{each.chamber}": {
                    "leak_L_per_min": each.flow / LITRE_PER_MINUTE,
                    "interval_95_L_per_min": [
                        each.lower / LITRE_PER_MINUTE,
                        each.upper / LITRE_PER_MINUTE,
                    ],
                }
                for each in test.found.blocking
            },
        },
        "misfit": test.found.misfit,
        "duration_s": test.duration_s,
    }
