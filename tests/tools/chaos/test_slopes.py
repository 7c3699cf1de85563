"""What is called a leak: growth whose whole interval lies above the stated bound."""

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tools.chaos.slopes import DESCRIPTORS, MEMORY, RESOURCES, is_leak, slope
from tools.chaos.soak import memory_mb, planned_tests, rows, unbounded_descriptors

TIMES = np.arange(1800.0)
HOURS = TIMES / 3600.0


def test_a_slope_is_found_with_an_interval_that_holds_it() -> None:
    rng = np.random.default_rng(1)
    found = slope(TIMES, 50.0 + 20.0 * HOURS + 0.1 * rng.standard_normal(TIMES.size))
    assert found.low < 20.0 < found.high
    assert found.per_h == pytest.approx(20.0, abs=0.5)
    assert is_leak(found, MEMORY)


def test_what_is_taken_and_given_back_is_no_leak() -> None:
    saw = 30.0 * ((TIMES % 60.0) / 60.0)
    assert not is_leak(slope(TIMES, 100.0 + saw), MEMORY)
    assert not is_leak(slope(TIMES, np.full(TIMES.size, 40.0)), DESCRIPTORS)


def test_what_a_process_takes_as_it_begins_is_no_leak() -> None:
    assert not is_leak(slope(TIMES, np.minimum(80.0, 0.5 * TIMES)), MEMORY)


def test_a_growth_below_the_bound_is_none_and_a_few_samples_are_refused() -> None:
    assert not is_leak(slope(TIMES, 0.9 * MEMORY.bound * HOURS), MEMORY)
    assert is_leak(slope(TIMES, 1.1 * MEMORY.bound * HOURS), MEMORY)
    with pytest.raises(ValueError, match="soak longer"):
        slope(TIMES[:20], HOURS[:20])


def test_a_series_is_told_with_its_bound_and_judgement() -> None:
    series = {
        ("loop", "memory"): (list(TIMES), list(20.0 * HOURS)),
        ("loop", "descriptors"): (list(TIMES[:9]), list(HOURS[:9])),
    }
    (few, first), (leak, second) = rows("emulated", series)
    assert (first, second) == (False, True)
    assert "soak longer" in few[-1]
    assert leak == (
        "emulated: loop", "memory", "+20.00 MB", "+20.00 to +20.00", "6.0", "**leak**",
    )  # fmt: skip
    assert all(resource.why for resource in RESOURCES)


def test_a_process_has_memory_and_one_that_ended_is_not_there() -> None:
    assert 1.0 < memory_mb(os.getpid()) < 10_000.0
    with pytest.raises(FileNotFoundError):
        memory_mb(2**22 + 1)


def test_the_tests_of_a_soak_inject_and_end_a_leak_each() -> None:
    first, second = planned_tests(2, 60.0)
    assert first["name"] != second["name"]
    assert (first["faults"][0]["at"], first["faults"][0]["until"]) == ("6 s", "30 s")


def test_a_file_of_the_run_that_is_held_once_is_no_growth_but_a_second_descriptor_is(
    tmp_path: Path,
) -> None:
    def others() -> int:
        return unbounded_descriptors(os.getpid(), tmp_path)

    before = others()
    with ExitStack() as held:
        for name in ("journal", "recording", "recording"):
            (tmp_path / name).unlink(missing_ok=True)
            held.enter_context((tmp_path / name).open("w"))
        assert others() == before
        held.enter_context((tmp_path / "journal").open())
        assert others() == before + 1
