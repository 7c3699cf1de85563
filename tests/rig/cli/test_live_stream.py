"""What is done with a rig beside campaigns is stopped by anybody who may command on its stream."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.cli import live_stream
from rig.cli.live_stream import motion_streamed, session_streamed
from rig.configuration import load_rig, load_stream
from rig.runner import Observer, StopFlag
from rig.stream import Command
from rig.supervisor import Onlooker


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return what the stream is opened with, once it is; no stream is opened."""
    kept: dict[str, Any] = {}

    @contextmanager
    def streamed(observer: Observer, *_: Any, **more: Any) -> Iterator[Observer]:
        kept.update(obey=_[3], **more)
        yield observer

    monkeypatch.setattr(live_stream, "streamed", streamed)
    return kept


def command(name: str, text: str = "") -> Command:
    return Command(name, "local", text, 1)


def test_abort_is_obeyed_and_names_who_asked(given: dict[str, Any], tmp_path: Path) -> None:
    stop, rig = StopFlag(), load_rig("emulated")
    with motion_streamed(Observer(), load_stream("loopback"), rig, tmp_path, stop, "homing"):
        assert given["activity"] == "homing"
        assert given["obey"](command("hold")) == "homing obeys abort only"
        assert not stop.requested
        assert given["obey"](command("abort", "Ben: smoke")) == ""
    assert stop.reason == "local: Ben: smoke"


@pytest.mark.parametrize(
    ("text", "reason"), [("Eve", "Eve"), ("Eve: smoke", "Eve: smoke"), ("", "Eve")]
)
def test_a_person_who_stops_from_the_console_is_named_once(
    given: dict[str, Any], tmp_path: Path, text: str, reason: str
) -> None:
    stop, rig = StopFlag(), load_rig("emulated")
    with motion_streamed(Observer(), load_stream("loopback"), rig, tmp_path, stop, "homing"):
        given["obey"](replace(command("abort", text), person="Eve"))
    assert stop.reason == reason


def test_without_a_stream_lines_are_shown_here(tmp_path: Path) -> None:
    said: list[str] = []
    with session_streamed(
        None, load_rig("emulated"), tmp_path, StopFlag(), "homing", said.append
    ) as (say, onlooker):
        say("waiting")
        assert type(onlooker) is Onlooker
    assert said == ["waiting"]
