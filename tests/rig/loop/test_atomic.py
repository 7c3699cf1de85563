"""Words that processes share are stored and loaded in order."""

import threading

import numpy as np

from rig.io.libc import monotonic_ns
from rig.loop.atomic import load_acquire, store_release
from rig.loop.clock import sleep_until


def test_what_is_stored_is_loaded() -> None:
    words = np.zeros(4, np.int64)
    store_release(words, 2, 2**62)
    assert words.tolist() == [0, 0, 2**62, 0]
    assert load_acquire(words, 2) == 2**62


def test_whoever_sees_the_index_sees_the_row() -> None:
    words, rows = np.zeros(1, np.int64), np.zeros(20_001)

    def write() -> None:
        for number in range(1, len(rows)):
            rows[number] = number
            store_release(words, 0, number)

    writer = threading.Thread(target=write)
    writer.start()
    seen = 0
    while seen < len(rows) - 1:
        seen = load_acquire(words, 0)
        assert rows[seen] == seen
    writer.join()


def test_sleeping_lasts_until_the_time_and_not_at_all_when_it_is_past() -> None:
    wanted = monotonic_ns() + 1_000_000
    sleep_until(wanted)
    assert monotonic_ns() >= wanted
    sleep_until(0)
