"""What is computed in a process of its own comes back, or says why not."""

import operator
import os

import pytest

from rig.runner.experiments.worker_process import ApartError, apart, at_once


def test_a_result_comes_back_from_another_process_while_the_rig_is_looked_after() -> None:
    looked: list[int] = []
    assert apart(lambda: looked.append(1), operator.add, 2, 3) == 5
    assert looked
    assert apart(lambda: None, os.getpid) != os.getpid()
    assert at_once(lambda: None, os.getpid) == os.getpid()


def test_an_error_there_is_reported_here() -> None:
    with pytest.raises(ApartError, match="ZeroDivisionError"):
        apart(lambda: None, operator.truediv, 1, 0)


def test_what_looking_after_the_rig_raises_ends_the_computation() -> None:
    def trips() -> None:
        raise RuntimeError("tripped")

    with pytest.raises(RuntimeError, match="tripped"):
        apart(trips, pow, 2, 3)
