"""Trials of the leak test: how often leaks are found, and how often tight cylinders are accused."""

from typing import NamedTuple

import numpy as np

from estimator.leak_test import BlockingLeak, LeakTestResult, fit_leaks, levels_of
from rig.plant import DATA_SHEET, LEAKS, LITRE_PER_MINUTE, NOMINAL

from .drawing import MOST_BLOCKING, drawn
from .physics import soaks_of

BLOCKING = BlockingLeak(MOST_BLOCKING, 1e7)


class Score(NamedTuple):
    """What came of the trials of one place and size."""

    place: str
    """One of `LEAKS`, or "healthy"."""
    size: float
    """Leak in L/min."""
    trials: int
    found: int
    """In how many the place was accused; for healthy rigs, any place."""
    elsewhere: int
    """In how many another place was accused."""
    covered: int
    """In how many the interval held the true flow; for healthy rigs, all three did."""
    scatter: float
    """Root mean square error of the flow, L/min; for healthy rigs, the greatest of the three."""


def results(place: str, size: float, count: int, seed: int) -> list[LeakTestResult]:
    """Return what the fit says of `count` rigs with a leak of `size` L/min in a place."""
    number = LEAKS.index(place) if place in LEAKS else len(LEAKS)
    generator = np.random.default_rng([seed, number, round(1e6 * size)])
    leaks = np.zeros((count, len(LEAKS)))
    if place in LEAKS:
        leaks[:, number] = size * LITRE_PER_MINUTE
    levels = levels_of(NOMINAL)
    tests = soaks_of(drawn(count, generator, leaks), levels, generator)
    return [fit_leaks(soaks, levels, NOMINAL, DATA_SHEET, BLOCKING) for soaks in tests]


def scored(place: str, size: float, count: int, seed: int) -> Score:
    """Return how trials of one place and size came out."""
    found = elsewhere = covered = 0
    errors = []
    for result in results(place, size, count, seed):
        accused = {each.name for each in result.findings if each.is_leak}
        found += place in accused if place in LEAKS else bool(accused)
        elsewhere += bool(accused - {place}) if place in LEAKS else 0
        judged = [each for each in result.findings if place in (each.name, "healthy")]
        truth = size * LITRE_PER_MINUTE
        covered += all(each.lower <= truth <= each.upper for each in judged)
        errors.append([(each.flow - truth) / LITRE_PER_MINUTE for each in judged])
    scatter = float(np.sqrt(np.mean(np.square(errors), axis=0)).max())
    return Score(place, size, count, found, elsewhere, covered, scatter)
