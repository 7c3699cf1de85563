"""A play of all failures that was broken off goes on with those that were not tried."""

from pathlib import Path

from tools.failing.results import Results
from tools.failing.trying import Tried

CAME = Tried("thread at a.py:1", "thread", "loop", 3, None, "told", ("it hung, and was killed",))


def never() -> Tried | None:
    raise AssertionError("a failure was tried again")


def test_what_was_tried_before_a_break_is_known_after_it(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    before = Results(path)
    assert before.of("emulated", CAME.name, lambda: CAME) == CAME
    assert before.of("emulated", "not reached", lambda: None) is None
    with path.open("a") as file:
        file.write('["emulated", "cut')
    after = Results(path)
    assert after.of("emulated", CAME.name, never) == CAME
    assert after.of("emulated", "not reached", never) is None
    assert after.of("simulated", CAME.name, lambda: None) is None
    assert Results(path).of("simulated", CAME.name, never) is None


def test_without_a_file_nothing_is_kept() -> None:
    assert Results(None).of("emulated", CAME.name, lambda: CAME) == CAME
    assert Results(None).of("emulated", CAME.name, lambda: None) is None
