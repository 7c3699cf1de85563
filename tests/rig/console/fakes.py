"""A client of the live stream that tests feed, in place of one that receives by Zenoh."""

import subprocess
import threading
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.console.curves import CHANNELS
from rig.stream.answers import Answer
from rig.stream.client import StreamClient
from rig.stream.known import Snapshot, UnknownRigError, Window
from tests.waiting import until as until

RUNNING = Snapshot(
    rig="bench",
    session="s1",
    alive=True,
    age_s=0.05,
    names=("position_m", "oil_temperature_K"),
    units=("m", "K"),
    time_s=12.34,
    latest={"position_m": 0.30012, "oil_temperature_K": 313.15, "load_N": float("nan")},
    is_sampled=True,
    rate_hz=1000.0,
    campaign={
        "status": "running",
        "name": "leaks",
        "rig": "bench",
        "directory": "out",
        "begun_ns": 10**18,
        "tests": [{"name": "first", "expect": "healthy", "status": "running", "verdict": ""}],
    },
    progress={"number": 1, "count": 1, "name": "first", "time_s": 12.3, "duration_s": 40.0},
    health={"rate_hz": 1000.0, "missed": 0, "silent_s": {"loop": 0.002}, "action": "none"},
)


def start_by(monkeypatch: pytest.MonkeyPatch, popen: Callable[..., Any]) -> None:
    """Have a launcher start its processes by a function with the arguments of `Popen`."""
    names = SimpleNamespace(Popen=popen, DEVNULL=subprocess.DEVNULL, STDOUT=subprocess.STDOUT)
    monkeypatch.setattr("rig.console.launcher.subprocess", names)


class FakeClient(StreamClient):
    """A stream client whose snapshots a test sets, and which notes the commands sent by it.

    Attributes:
        shots: the snapshots by rig.
        sent: each command as (command, rig, text, test).
        persons: who gave each of them.
        answer: the answer to every command.
    """

    def __init__(self, *shots: Snapshot) -> None:
        self.shots = {shot.rig: shot for shot in shots}
        self.sent: list[tuple[Any, ...]] = []
        self.persons: list[str] = []
        self.answer = Answer(True)
        self.rows = 0
        self._closing, self._asking = threading.Event(), []
        self._lock = threading.RLock()

    def become(self, rig: str, **changed: Any) -> None:
        """Change fields of a rig's snapshot."""
        self.shots[rig] = replace(self.shots[rig], **changed)

    def rigs(self) -> tuple[str, ...]:
        return tuple(self.shots)

    def snapshots(self) -> list[Snapshot]:
        return list(self.shots.values())

    def snapshot(self, rig: str | None = None) -> Snapshot:
        if rig not in self.shots:
            raise UnknownRigError(f"rig {rig} was not heard of")
        return self.shots[rig]

    def window(self, last_s: float, names: tuple[str, ...] = (), rig: str | None = None) -> Window:
        self.rows += 20
        row = np.arange(max(0, self.rows - round(1e3 * last_s)), self.rows, dtype=np.int64)
        values = {name: np.zeros(len(row), np.float32) for name in CHANNELS}
        return Window(row, np.asarray(row * 1e-3, np.float64), np.ones(len(row), np.int64), values)

    def send(
        self,
        command: str,
        rig: str | None = None,
        text: str = "",
        timeout_s: float = 5.0,
        test: str = "",
        person: str = "",
    ) -> Answer:
        if rig not in self.shots:
            raise UnknownRigError(f"rig {rig} was not heard of")
        self.sent.append((command, rig, text, test))
        self.persons.append(person)
        return self.answer

    def close(self) -> None:
        self._closing.set()
