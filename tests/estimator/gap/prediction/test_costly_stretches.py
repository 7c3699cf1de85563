"""The excerpts that disturbances are sought in hold the costliest, and something of each record."""

import numpy as np

from estimator.gap.plant.records import Record, made_of
from estimator.gap.prediction.costly_stretches import MOST_BLOCKS, STRETCH, excerpts
from tests.estimator.gap.wheel import wheel

BLOCKS = 32
PERIOD = 1e-3


def records(count: int) -> list[Record]:
    samples = 500 * (BLOCKS + 1)
    rows = np.zeros((samples, 1))
    return [made_of(str(number), rows, rows, wheel()) for number in range(count)]


def test_a_record_that_costs_little_is_in_the_excerpts_too() -> None:
    costs = np.concatenate([np.full(BLOCKS, 100.0), np.full(BLOCKS, 1.0), np.full(BLOCKS, 10.0)])
    found = excerpts(records(3), PERIOD, costs)
    assert [len(each.blocks) for each in found] == [2 * STRETCH] * 3


def test_of_each_record_the_costliest_stretches_are_taken_and_then_the_costliest_of_all() -> None:
    costs = np.ones(2 * BLOCKS)
    costs[: 2 * STRETCH] = 50.0
    costs[BLOCKS + STRETCH : BLOCKS + 2 * STRETCH] = 5.0
    costs[2 * STRETCH : 4 * STRETCH] = 20.0
    first, second = excerpts(records(2), PERIOD, costs)
    assert list(first.places) == list(range(BLOCKS))
    assert set(range(BLOCKS + STRETCH, BLOCKS + 2 * STRETCH)) <= set(second.places)
    assert len(first.blocks) + len(second.blocks) == MOST_BLOCKS


def test_of_more_records_than_there_is_room_for_the_costliest_are_taken() -> None:
    costs = np.repeat(np.arange(8.0), BLOCKS)
    found = excerpts(records(8), PERIOD, costs)
    assert [len(each.blocks) for each in found] == [0, 0] + [STRETCH] * 6
