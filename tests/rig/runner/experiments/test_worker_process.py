"""What is computed in a process of its own comes back, or says why not."""

import os
from collections.abc import Callable

import pytest

from rig.runner.experiments.worker_process import ApartError, apart


def added(said: Callable[[str], None], left: int, right: int) -> tuple[int, int]:
    """Return a sum and the process that made it, and say what is being added."""
    print("a line of its own, which nobody asked for")
    said(f"adding {left}")
    said(f"and {right}")
    return left + right, os.getpid()


def divided(said: Callable[[str], None], left: int, right: int) -> float:
    return left / right


def silent(words: str) -> None:
    """Say nothing."""


def test_a_result_comes_back_from_another_process_while_the_rig_is_looked_after() -> None:
    looked: list[int] = []
    said: list[str] = []
    total, process = apart(lambda: looked.append(1), said.append, added, 2, 3)
    assert total == 5
    assert process != os.getpid()
    assert looked
    assert said == ["adding 2", "and 3"]


def test_an_error_there_is_reported_here() -> None:
    with pytest.raises(ApartError, match="ZeroDivisionError"):
        apart(lambda: None, silent, divided, 1, 0)


def test_what_looking_after_the_rig_raises_ends_the_computation() -> None:
    def trips() -> None:
        raise RuntimeError("tripped")

    with pytest.raises(RuntimeError, match="tripped"):
        apart(trips, silent, added, 2, 3)
