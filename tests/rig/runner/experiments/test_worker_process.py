"""What is computed in a process of its own comes back, or says why not."""

import os
from collections.abc import Callable

import pytest

from rig.runner.experiments.worker_process import ApartError, apart


def added(said: Callable[[str], None], left: int, right: int) -> int:
    """Return a sum, and say what is being added."""
    print("a line of its own, which nobody asked for")
    said(f"adding {left}")
    said(f"and {right}")
    return left + right


def divided(said: Callable[[str], None], left: int, right: int) -> float:
    return left / right


def own_process(said: Callable[[str], None]) -> int:
    return os.getpid()


def silent(words: str) -> None:
    """Say nothing."""


def test_a_result_comes_back_from_another_process_while_the_rig_is_looked_after() -> None:
    looked: list[int] = []
    said: list[str] = []
    assert apart(lambda: looked.append(1), said.append, added, 2, 3) == 5
    assert looked
    assert said == ["adding 2", "and 3"]
    assert apart(lambda: None, silent, own_process) != os.getpid()


def test_an_error_there_is_reported_here() -> None:
    with pytest.raises(ApartError, match="ZeroDivisionError"):
        apart(lambda: None, silent, divided, 1, 0)


def test_what_looking_after_the_rig_raises_ends_the_computation() -> None:
    def trips() -> None:
        raise RuntimeError("tripped")

    with pytest.raises(RuntimeError, match="tripped"):
        apart(trips, silent, added, 2, 3)
