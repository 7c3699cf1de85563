"""Learnt noise as plain values for JSON, for the file of a baseline, and back."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from estimator.accounts import MODEL_NOISE
from rig.plant import FAULTS

from .noise import MOST_LASTING, LearntNoise, RegimeNoise
from .regimes import REGIMES
from .tail import RegimePeaks, Tail

STATED_RATES: Final = (100.0, 10.0, 1.0)
"""Alarms a day for which a baseline says how often its rig is expected to alarm."""
MOST_DEAD_ZONE: Final = 10.0
"""Most that a dead zone, or a leak that goes unseen, may be, L/min. What is larger counts as a
wrong sensor and not as a leak (`estimator.leaks`)."""
LEAST_BASE: Final = 0.5
"""Lowest limit over which peaks are counted. A flow that exceeds its dead zone by less than half a
standard error is no evidence of a fault, and says nothing of how far the statistic may go."""
LARGEST: Final = 1e12
"""Largest number of any kind that is learnt: far beyond all times in s and sums of excesses."""


def expected_alarms(noise: LearntNoise) -> dict[float, tuple[float, float]]:
    """Return for each of `STATED_RATES` the alarms a day that are expected, as a 90 % interval.

    It is how well the healthy hours tell the rate at which the limit for that setting is exceeded.
    """
    tail = noise.tail
    return {rate: tail.interval(rate) for rate in STATED_RATES}


def noise_content(noise: LearntNoise) -> dict[str, Any]:
    """Return learnt noise as plain values, from which `noise_of` makes it again.

    What is derived from the rest, for people who read the file, is the noise in L/min of a block
    without doubts, and the expected alarms.
    """
    return {
        "regimes": {
            name: {
                "seconds": each.seconds,
                "noise_L_per_min": each.factor * MODEL_NOISE,
                "factor": each.factor,
                "chambers": each.chambers,
                "lasting": each.lasting,
            }
            for name, each in noise.regimes.items()
        },
        "spool_correction": noise.spool_correction,
        "dead_zone_L_per_min": dict(zip(FAULTS, noise.dead_zone, strict=True)),
        "peaks": {
            "over": noise.tail.base,
            "hours": noise.tail.hours,
            "count": noise.tail.peaks,
            "excess": noise.tail.excess,
            "regimes": {
                each.regime: {"hours": each.hours, "count": each.peaks}
                for each in noise.tail.regimes
            },
        },
        "expected_alarms_per_day": {
            f"{rate:g}": {"low": low, "high": high}
            for rate, (low, high) in expected_alarms(noise).items()
        },
    }


def noise_of(content: Mapping[str, Any]) -> LearntNoise:
    """Return the learnt noise whose plain values `noise_content` made.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: the content is no learnt noise; a value
            outside its range is named with the range.
    """
    regimes = {}
    for name, fields in dict(content["regimes"]).items():
        if name not in REGIMES:
            raise ValueError(f"noise: regimes: {name} is none of {', '.join(REGIMES)}")
        at = f"noise: regimes: {name}"
        regimes[name] = RegimeNoise(
            _within(fields["seconds"], 0.0, LARGEST, f"{at}: seconds"),
            _within(fields["factor"], 0.0, 1e3, f"{at}: factor"),
            _within(fields["chambers"], -0.95, 0.95, f"{at}: chambers"),
            _within(fields["lasting"], 0.0, MOST_LASTING, f"{at}: lasting"),
        )
    zones = content["dead_zone_L_per_min"]
    dead = tuple(
        _within(zones[name], 0.0, MOST_DEAD_ZONE, f"noise: dead_zone: {name}") for name in FAULTS
    )
    peaks = content["peaks"]
    tail = Tail(
        _within(peaks["over"], LEAST_BASE, 100.0, "noise: peaks: over"),
        _within(peaks["hours"], 1e-3, 1e6, "noise: peaks: hours"),
        int(_within(peaks["count"], 0.0, 1e9, "noise: peaks: count")),
        _within(peaks["excess"], 0.0, LARGEST, "noise: peaks: excess"),
        _peaks_by_regime(peaks.get("regimes", {})),
    )
    # Files from before the accounts were corrected have none.
    correction = _within(content.get("spool_correction", 0.0), 0.0, 1.0, "noise: spool_correction")
    return LearntNoise(regimes, dead, tail, correction)


def _peaks_by_regime(content: Mapping[str, Any]) -> tuple[RegimePeaks, ...]:
    """Return the peaks of each regime; none from files of earlier versions, which have no such key.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: as of `noise_of`.
    """
    found = []
    for name, fields in dict(content).items():
        if name not in REGIMES:
            raise ValueError(f"noise: peaks: regimes: {name} is none of {', '.join(REGIMES)}")
        at = f"noise: peaks: regimes: {name}"
        hours = _within(fields["hours"], 0.0, 1e6, f"{at}: hours")
        found.append(
            RegimePeaks(name, hours, int(_within(fields["count"], 0.0, 1e9, f"{at}: count")))
        )
    return tuple(found)


def _within(value: object, least: float, most: float, name: str) -> float:
    number = float(value)  # type: ignore[arg-type]
    if not (isfinite(number) and least <= number <= most):
        raise ValueError(f"{name}: {number:g} is outside {least:g} to {most:g}")
    return number
