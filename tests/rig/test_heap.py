"""What is free within the process goes back to the system, so that a long run does not grow."""

import subprocess
import sys

import pytest

from rig import heap

FRAGMENTED = """
from pathlib import Path
from rig.heap import give_back

def anonymous_kb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("RssAnon:")))

# Of blocks that the C library allocates, every hundredth outlives the others.
blocks = [bytes(2000) for _ in range(20_000)]
kept = blocks[::100]
full = anonymous_kb()
del blocks
before = anonymous_kb()
give_back()
print(full, before, anonymous_kb())
"""


@pytest.mark.skipif(heap._trim is None, reason="this C library cannot give memory back")
def test_memory_that_is_free_between_what_is_kept_goes_back_to_the_system() -> None:
    printed = subprocess.run(
        [sys.executable, "-c", FRAGMENTED], capture_output=True, text=True, check=True
    ).stdout
    full, before, after = map(int, printed.split())
    # 20 000 blocks of 2 kB are 40 MB; without the call nearly all of it stays.
    assert before > full - 4_000
    assert after < full - 30_000


def test_a_c_library_that_cannot_do_it_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heap, "_trim", None)
    heap.give_back()
