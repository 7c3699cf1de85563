import numpy as np
from hypothesis import given, strategies as st

from estimator.filters.registry import FilterRun, start_memory
from estimator.leaks.detection import Decision
from estimator.leaks.oil_account import Samples
from rig.loop.cycle import row_channels
from rig.plant import Model
from rig.runner.campaign.judging import Judge

CHANNELS = row_channels(start_memory("thesis-6", Model()).filter.states, open_loop=False)


class Noting:
    """A detector that notes the stretches it is given."""

    def __init__(self) -> None:
        self.stretches: list[tuple[float, float, int]] = []

    def update(self, samples: Samples, run: FilterRun) -> None:
        times = samples.time_s
        assert np.array_equal(times, run.time_s)
        assert samples.position[0] == times[0] + CHANNELS.index("position_m")
        self.stretches.append((float(times[0]), float(times[-1]), times.size))

    def decide(self) -> Decision:
        return Decision("internal_leakage" if len(self.stretches) > 2 else "healthy")


def rows(ticks: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.arange(ticks, dtype=np.float64)[:, None] + np.arange(len(CHANNELS))


def judged(ticks: int, batches: list[int]) -> tuple[Noting, Judge]:
    detector = Noting()
    judge = Judge(detector, start_memory("thesis-6", Model()), CHANNELS)
    table, done, number = rows(ticks), 0, 0
    while done < ticks:
        count = min(batches[number % len(batches)], judge.ticks_due, ticks - done)
        judge.take(table[done : done + count])
        done += count
        number += 1
    judge.finish()
    return detector, judge


@given(ticks=st.integers(1, 2600), batches=st.lists(st.integers(1, 700), min_size=1, max_size=5))
def test_however_the_rows_come_the_detector_sees_the_same_blocks(
    ticks: int, batches: list[int]
) -> None:
    one, in_one_go = judged(ticks, [10_000])
    other, in_batches = judged(ticks, batches)
    assert one.stretches == other.stretches
    assert in_one_go.history == in_batches.history
    assert sum(count for _, _, count in one.stretches) == ticks
    assert all(count <= 501 for _, _, count in one.stretches)


def test_a_verdict_counts_as_detected_from_when_it_was_first_held() -> None:
    _, judge = judged(2100, [50])
    assert [time for time, _ in judge.history] == [500.0, 1000.0, 1500.0, 2000.0, 2099.0]
    assert judge.detected_at_s == 1500.0


def test_before_the_first_block_nothing_is_held() -> None:
    judge = Judge(Noting(), start_memory("thesis-6", Model()), CHANNELS)
    judge.take(rows(10))
    assert judge.decision is None
    assert judge.detected_at_s is None
