"""Rates of a sweep count each process from when it ran its first case."""

import pytest

from rig.sweep.run_cases import Judged
from rig.sweep.running import Timing


def judged(worker: str, wall_s: float) -> Judged:
    return Judged(0, {}, 0.5 * wall_s, wall_s, "", worker)


def test_the_start_of_no_process_counts() -> None:
    timing = Timing()
    timing.add(judged("first", 1.0), 16, 960.0, received_s=5.0)  # ready at 4 s
    timing.add(judged("second", 1.0), 16, 960.0, received_s=7.0)  # at 6 s
    timing.add(judged("first", 1.5), 16, 960.0, received_s=8.0)
    timing.elapsed_s = 8.0
    plain = timing.plain()
    assert (plain["cases"], plain["processes"], plain["start_s"]) == (48, 2, 4.0)
    rates = plain["rig_seconds_per_second"]
    assert rates["of_process_after_start"] == pytest.approx(2880.0 / (4.0 + 2.0))
    assert rates["of_process"] == pytest.approx(2880.0 / 3.5)
    assert rates["of_processor"] == pytest.approx(2880.0 / 1.75)
