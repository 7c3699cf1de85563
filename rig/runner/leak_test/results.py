"""What came of a leak test, as figures for programs."""

from dataclasses import dataclass
from typing import Any, Final

from estimator.leak_test import FALSE_ALARMS, LeakTestResult, Soak
from rig.plant import LITRE_PER_MINUTE

SCHEMA: Final = "rig-leak-test"
"""Value of the key `schema`, by which `leak_test.json` is recognized."""


@dataclass(frozen=True)
class LeakTest:
    """What came of a leak test.

    Attributes:
        rig: name of the rig.
        found: what the fit tells.
        foreseen: smallest leaks in m^3/s that 95 of 100 tests find, computed before the test, in
            the order of `rig.plant.LEAKS`.
        soaks: the samples.
        duration_s: how long the test took, s.
    """

    rig: str
    found: LeakTestResult
    foreseen: tuple[float, ...]
    soaks: tuple[Soak, ...]
    duration_s: float

    @property
    def leaks(self) -> tuple[str, ...]:
        """The names of the places that leak."""
        return tuple(each.name for each in self.found.findings if each.is_leak)


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
        "misfit": test.found.misfit,
        "duration_s": test.duration_s,
    }
