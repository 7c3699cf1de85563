"""The lab of a station: an emulated rig that can home, and the programs that are started on it."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import yaml

from .stage import COMPILE_S, PATIENCE_S, ROOT, Stage

SAFE_S: Final = 5.0
"""Time in s within which valve, bypasses and pump must be safe after something was killed.

The slowest of docs/safety.md is a field process that was stopped: the loop misses its beat for 1 s,
and the bypass valves' own watchdog shuts them after another second; their balls travel for 0.5 s.
The rest is for a machine that stalls.
"""
STREAMED: Final = ("--stream", "stream.yaml")
HOME: Final = ("home", "--rig", "rig.yaml", *STREAMED)
CALIBRATE: Final = ("calibrate", "valves", "--rig", "rig.yaml", "--points", "2", *STREAMED)
RUN: Final = ("run", "campaign.yaml", "--out", "out", "--by", "Bo", *STREAMED)
JOG: Final = ("jog", "rig.yaml", *STREAMED)
_LONGEST: Final = {
    # The loop uses another processor than a loop of the chaos suite that runs beside it.
    "loop": {
        "cpu": 0, "stale_limit": "10 s", "slow_stale_limit": "60 s", "loop_silence": "60 s",
        "field_silence": "60 s", "supervisor_silence": "60 s", "recorder_silence": "600 s",
    },
    "daq": {"watchdog": "1 s", "timeout": "60 s"},
    "bypass": {"timeout": "2 s", "watchdog": "60 s", "margin": "60 s"},
    "drive": {"silence": "60 s", "open_timeout": "60 s", "step_timeout": "60 s", "watchdog": "0 s"},
    "pump": {"silence": "60 s", "load_timeout": "60 s"},
    "meters": {"stale": "10 s"},
}  # fmt: skip
"""The longest time limits that a rig file may have, by section of the file."""
_ENDS: Final = ("returned", "died", "left")
"""Kinds of the lines by which a lease ends in a station's log (`rig.runner.station`)."""


class Lab:
    """An emulated rig on a stage, and the programs that are started on it.

    Args:
        stage: the stage; its context has been entered.

    Attributes:
        stage: the stage given.
        started: the programs that were started, in that order.
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.started: list[subprocess.Popen[str]] = []
        shipped = yaml.safe_load((ROOT / "config" / "rigs" / "emulated.yaml").read_text())
        file = stage.folder / "rig.yaml"
        rig = yaml.safe_load(file.read_text()) | {"homing": shipped["homing"]}
        file.write_text(yaml.safe_dump(rig))

    def rig(self, *arguments: str, folder: Path | None = None) -> "subprocess.Popen[str]":
        """Start a `rig` command in the stage's folder or another one, with pipes to and from it."""
        program = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", *arguments],
            cwd=folder or self.stage.folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
            env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        self.started.append(program)
        return program

    def station(self) -> "subprocess.Popen[str]":
        """Start the station, and return once it reads the rig."""
        before = len(self.kept("found"))
        station = self.rig("station", "rig.yaml", *STREAMED)
        self.stage.wait(lambda: len(self.kept("found")) > before, "the station", COMPILE_S)
        return station

    @property
    def log(self) -> list[dict[str, Any]]:
        """The lines of the station's log."""
        found = yaml.safe_load((self.stage.folder / "rig.yaml").read_text())["name"]
        path = self.stage.folder / "runs" / f"station-{found}" / "station.jsonl"
        lines = path.read_text().splitlines() if path.exists() else []
        return [json.loads(line) for line in lines]

    def kept(self, kind: str) -> list[str]:
        """Return the texts of all lines of a kind in the station's log."""
        return [entry["text"] for entry in self.log if entry["kind"] == kind]

    def driver(self) -> int | None:
        """Return the process that has the rig by the station's log; None if nobody has it."""
        pid = None
        for entry in self.log:
            if entry["kind"] == "lent":
                found = re.search(r"\(process (\d+)\)$", entry["text"])
                pid = int(found[1]) if found else None
            elif entry["kind"] in _ENDS:
                pid = None
        return pid

    def lease_of(self, pid: int) -> list[str]:
        """Return the kinds of lines that the station has kept of the lease of a process.

        They are "lent", and "returned", "died" or "left" if it has ended; [] if it got none.
        """
        log, lent = self.log, f"(process {pid})"
        for number, entry in enumerate(log):
            if entry["kind"] == "lent" and entry["text"].endswith(lent):
                kinds = [later["kind"] for later in log[number + 1 :]]
                return ["lent", *[kind for kind in kinds if kind in _ENDS][:1]]
        return []

    def status(self) -> Any:
        """Return what the station tells of itself."""
        asked = self.rig("station", "rig.yaml", "--status", "--json")
        return json.loads(asked.communicate(timeout=PATIENCE_S)[0])

    def lends(self, *arguments: str) -> "subprocess.Popen[str]":
        """Start a client, and return once the station has left the rig to it."""
        client = self.rig(*arguments)
        self.stage.wait(
            lambda: self.driver() == client.pid or client.poll() is not None, "lease", COMPILE_S
        )
        return client

    def is_idle(self) -> bool:
        """Return whether the station has read the rig since the last client had it, by its log."""
        kinds = [entry["kind"] for entry in self.log if entry["kind"] != "told"]
        return bool(kinds) and kinds[-1] == "found"

    def found_again(self, before: int) -> None:
        """Wait until a station has read the rig more often than `before`."""
        self.stage.wait(lambda: len(self.kept("found")) > before, "the station to read the rig")

    def safe_after(self, at: float) -> float:
        """Wait until the rig is safe; return how long that took from `at`, s."""
        self.stage.wait(self.stage.is_safe, "valve at null, bypass shut, pump unloaded", SAFE_S)
        return time.monotonic() - at


def patient(rig: dict[str, Any]) -> dict[str, Any]:
    """Give a rig file the longest time limits, so that a busy machine trips no rig; return it."""
    for section, longest in _LONGEST.items():
        (rig if section == "loop" else rig["drivers"])[section] |= longest
    return rig


@contextmanager
def lab_in(folder: Path) -> Iterator[Lab]:
    """Yield a lab in an empty folder; end its programs and its emulator afterwards."""
    with Stage(folder) as stage:
        lab = Lab(stage)
        try:
            yield lab
        finally:
            end(lab.started)


def end(programs: list["subprocess.Popen[str]"]) -> None:
    """End programs by SIGTERM, the newest first; kill those that do not end in time."""
    for program in reversed(programs):
        if program.poll() is None:
            program.terminate()
    for program in programs:
        try:
            program.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            program.kill()
            program.communicate()
        except ValueError:
            # Its pipes were closed already, as somebody has read what it printed.
            program.wait()


def parts_of(pid: int) -> dict[str, int]:
    """Return the parts of a session that a process has started: process ids by module's name."""
    found: dict[str, int] = {}
    for thread in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in thread.read_text().split():
            try:
                command = Path(f"/proc/{child}/cmdline").read_text()
            except OSError:
                continue
            named = re.search(r"from rig\.supervisor\.processes\.(\w+) import", command)
            if named:
                found[named[1]] = int(child)
    return found
