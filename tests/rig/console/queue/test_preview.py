"""What a start would do is told by a check in a process of its own, which nobody waits for long."""

import subprocess
import threading
from collections.abc import Sequence
from typing import Any

import pytest

from rig.console import preview
from rig.console.preview import PENDING, Preview, checked
from tests.waiting import until


@pytest.mark.parametrize(
    ("script", "found"),
    [
        ("echo '[{\"name\": \"a\"}]'", {"plan": {"name": "a"}}),
        ("echo rig.yaml:1 >&2; echo rig.yaml:2 >&2; exit 2",
         {"problems": ["rig.yaml:1", "rig.yaml:2"]}),
        ("exit 9", {"problems": ["the check gives no reason"]}),
        ("echo nonsense", {"problems": ["the check gives no reason"]}),
        ("sleep 20", {"problems": ["the check took more than 0.2 s"]}),
    ],
)  # fmt: skip
def test_a_check_gives_the_plan_or_all_that_is_wrong(
    monkeypatch: pytest.MonkeyPatch, script: str, found: dict[str, Any]
) -> None:
    plain = subprocess.Popen
    monkeypatch.setattr(preview, "CHECK_S", 0.2 if "sleep" in script else 30.0)
    monkeypatch.setattr(
        subprocess, "Popen", lambda words, **more: plain(["sh", "-c", script], **more)
    )
    assert checked(["a"]) == found


def test_a_check_that_takes_long_is_asked_for_again_and_made_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gate, made = threading.Event(), []

    def check(words: Sequence[str]) -> dict[str, Any]:
        made.append(list(words))
        gate.wait(30.0)
        return {"problems": [words[0]]}

    monkeypatch.setattr(preview, "checked", check)
    monkeypatch.setattr(preview, "WAIT_S", 0.01)
    previews = Preview()
    assert previews.of(["a"]) is PENDING
    assert previews.of(["b"]) is PENDING  # one at a time
    gate.set()
    until(lambda: previews.of(["a"]) == {"problems": ["a"]}, "the check of a")
    until(lambda: previews.of(["b"]) == {"problems": ["b"]}, "the check of b")
    assert made == [["a"], ["b"]]
