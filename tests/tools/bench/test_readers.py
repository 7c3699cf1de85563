"""The benchmark of readers compares like with like; what it measures is no test's."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.stream.settings import Endpoint
from tools.bench.readers import (
    BEGIN_MARK,
    BEHAVIOURS,
    END_MARK,
    READERS,
    Pairs,
    Readers,
    present,
    table,
)

ROOT = Path(__file__).parents[3]


def test_a_row_has_the_medians_of_pairs_and_of_their_ratios() -> None:
    without = np.full((3, 2), 20e-6)
    pairs = Pairs(
        with_=[1.0 * without, 1.5 * without, 40.0 * without],
        without=[without, without, without],
        missed=[(0.0, 0.0), (0.01, 0.0), (0.5, 0.002)],
        lacking=0,
    )
    assert pairs.row("fifty") == (
        "fifty", "20 -> 30", "20 -> 30", *["1.50"] * 6, "0.00 -> 1.00 %", "0",
    )  # fmt: skip


def test_every_kind_of_reader_is_one_that_there_is() -> None:
    assert {readers.what for readers in READERS} <= set(BEHAVIOURS)
    assert max(readers.count for readers in READERS) == 50


@pytest.mark.parametrize("count", [1, 3, 5, 7, 50])
def test_as_many_readers_come_as_are_asked_for(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []
    popen = subprocess.Popen

    def short(command: list[str], **given: Any) -> Any:
        started.append(int(command[-1]))
        return popen([sys.executable, "-S", "-c", "print('follows')"], **given)

    monkeypatch.setattr(subprocess, "Popen", short)
    with present(Readers("some", "read", count), Endpoint("tcp", "127.0.0.1", 1)):
        assert sum(started) == count


def test_trips_of_the_machine_are_told() -> None:
    text = table([("one",) * 11], 2, 3.0, ["no fresh sample came", "no fresh sample came"])
    assert "2 runs were repeated, as the loop tripped: no fresh sample came." in text


def test_the_published_page_has_its_marks() -> None:
    text = (ROOT / "docs/performance.md").read_text()
    assert BEGIN_MARK in text
    assert END_MARK in text
