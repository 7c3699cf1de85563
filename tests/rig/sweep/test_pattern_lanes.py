from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import FILTERS, OUTPUTS, FilterRun
from estimator.leaks.oil_account import Samples
from estimator.leaks.pattern import PatternDetector
from rig.configuration.sweeps.sweep import load_sweep
from rig.lanes import LANES
from rig.sweep.drawing import Cases, draw
from rig.sweep.group import Group, Setting, setting_of
from rig.sweep.run_cases import judged_by_pattern
from rig.sweep.ticks import BLOCK, SUMS

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def setting() -> Setting:
    sweep = load_sweep("leaks", Path(__file__).parent)
    return setting_of(replace(sweep, duration_s=40.0))


@pytest.fixture(scope="module")
def cases() -> Cases:
    return draw(replace(load_sweep("leaks", Path(__file__).parent), duration_s=40.0), 0, LANES)


def innovations(setting: Setting) -> Array:
    """Return innovations (ticks, 2, LANES) of filters whose rigs change at 25 s, in many ways."""
    random = np.random.default_rng(4)
    found = random.normal(0.0, 1e5, (setting.ticks, 2, LANES))
    rises = [(1.0, 1.0), (1.6, 1.0), (1.0, 1.6), (1.6, 1.5), (1.05, 1.0), (3.0, 1.4), (1.0, 0.5)]
    for lane, rise in enumerate(rises):
        found[25_000:, :, lane] *= rise
    return np.asarray(found)


def sums_of(found: Array, setting: Setting) -> Array:
    sums = np.zeros((setting.blocks, len(SUMS), LANES))
    absolute = np.abs(found)
    absolute[0] = 0.0
    sums[:, 0:2] = np.add.reduceat(absolute, 1 + BLOCK * np.arange(setting.blocks), axis=0)
    return sums


def alone(found: Array, lane: int) -> tuple[str, float | None, float]:
    """Return verdict, when it was first held, and statistic, by the detector of one rig."""
    detector = PatternDetector(1.0)
    time_s = np.arange(found.shape[0], dtype=np.float64) * 1e-3
    outputs = np.full((time_s.size, len(OUTPUTS)), np.nan)
    outputs[1:, 1:3] = found[1:, :, lane]
    nothing = np.zeros(time_s.size)
    held = []
    for block in range((time_s.size - 1) // BLOCK):
        part = slice(block * BLOCK + (block > 0), (block + 1) * BLOCK + 1)
        run = FilterRun(
            FILTERS["thesis-7"], time_s[part], np.empty((0, 7)), outputs[part], np.empty((0, 0))
        )
        detector.update(Samples(time_s[part], *[nothing[part]] * 6), run)
        held.append((detector.decide(), float(time_s[part][-1])))
    last = held[-1][0]
    if last.verdict == "healthy":
        return last.verdict, None, last.statistic
    return (
        last.verdict,
        next(at for decision, at in held if decision.verdict == last.verdict),
        last.statistic,
    )


def test_lanes_are_judged_as_by_the_detector_of_one_rig(setting: Setting, cases: Cases) -> None:
    found = innovations(setting)
    group = Group(setting, cases, np.arange(LANES))
    figures = judged_by_pattern(sums_of(found, setting), group)
    verdicts = set()
    for lane in range(LANES):
        verdict, detected_s, statistic = alone(found, lane)
        verdicts.add(verdict)
        assert figures["verdict"][lane] == verdict
        assert figures["statistic"][lane] == pytest.approx(statistic, rel=1e-9)
        if detected_s is None:
            assert np.isnan(figures["detected_at_s"][lane])
        else:
            assert figures["detected_at_s"][lane] == pytest.approx(detected_s)
    assert len(verdicts) == 4  # every pattern occurs
    named = figures["right"] & (figures["verdict"] != "healthy")
    assert np.isfinite(figures["latency_s"][named]).all()
    assert not (figures["latency_s"][named] < 0.0).any()


def test_a_filter_that_ran_away_is_reported(setting: Setting, cases: Cases) -> None:
    found = innovations(setting)
    found[30_000:, 0, 0] = np.nan
    found[30_000:, 1, 1] = 1e7
    group = Group(setting, cases, np.arange(LANES))
    lost = judged_by_pattern(sums_of(found, setting), group)["lost"]
    assert lost.tolist() == [True, True, *[False] * (LANES - 2)]
