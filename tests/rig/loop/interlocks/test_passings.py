"""The log of passed limits, and where in a motion a limit holds."""

from math import inf, nan

import numpy as np

from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.judging import Interlock, Tick, check_sample, interlock
from rig.loop.interlocks.ladder import limit_table
from rig.loop.interlocks.passing_log import PASSINGS_KEPT
from rig.loop.interlocks.passings import (
    PassingReader,
    RungPassed,
    latest_passings,
    note_passing,
    passing_log,
)
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET

TOL = tolerances(NOMINAL, DATA_SHEET, frozenset(), TICK, 0.1, HomingSettings())


def judging(**keys: float) -> Interlock:
    limit = ChannelLimit("following_error_m", -inf, 5e-3, "indicate", **keys)
    return interlock(limit_table([limit], TICK), TOL)


def passed(judge: Interlock, errors: list[float], ahead: int = 0) -> list[RungPassed]:
    reader = PassingReader(judge.log)
    for number, error in enumerate(errors):
        sample = np.full(len(FAST_INPUTS), nan)
        sample[:3] = 0.3, 7e6 + number, 7e6 - number
        tick = Tick(
            sample, True, 1, 0.15, 0, 0.0, 1.0, True, True, error, 4, number, number + ahead
        )  # fmt: skip
        check_sample(tick, judge)
    return reader.take()


def test_a_passing_is_logged_once_in_the_tick_at_which_it_counts() -> None:
    errors = [0.0, 6e-3, 7e-3, 8e-3, 9e-3, 1e-3, 6e-3, 6e-3, 7e-3]
    found = passed(judging(for_s=0.002), errors)
    assert found == [RungPassed(4, 3, 0, 8e-3), RungPassed(4, 8, 0, 7e-3)]


def test_a_limit_holds_in_its_stretch_of_the_motion_alone() -> None:
    errors = [9e-3] * 10
    assert [each.tick for each in passed(judging(from_s=0.003, until_s=0.006), errors)] == [3]
    assert passed(judging(from_s=0.003, until_s=0.006, for_s=0.003), errors) == []


def test_a_motion_that_is_ahead_comes_to_the_stretch_earlier() -> None:
    ahead = passed(judging(from_s=0.003, until_s=0.006), [9e-3] * 10, ahead=2)
    assert [each.tick for each in ahead] == [1]


def test_who_reads_late_misses_the_oldest_passings_only() -> None:
    log = passing_log()
    early, late = PassingReader(log), PassingReader(log)
    for tick in range(PASSINGS_KEPT + 3):
        note_passing(log, 1, tick, 0, 1.5)
        if tick == 0:
            assert early.take() == [RungPassed(1, 0, 0, 1.5)]
    assert [each.tick for each in late.take()] == list(range(3, PASSINGS_KEPT + 3))
    assert late.take() == []
    assert [each.tick for each in latest_passings(log, 2)] == [PASSINGS_KEPT + 1, PASSINGS_KEPT + 2]
