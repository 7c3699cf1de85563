"""Works out the outcome of a scenario, and compares it with what the scenario claims.

It reads the emulator's record and trace, the files of the run, and how `rig run` ended.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.loop.interlocks.ladder import EXPLANATIONS, Cause
from rig.recording import RecordingError, recover
from rig.recording.formats.mcap_reader import read_mcap
from rig.recording.recording import Table

from .scenario import Scenario
from .stage import Stage

Array = NDArray[np.float64]

LOST_S: Final = 5.0
"""s of data that may be lost: the recorder flushes each second, but the machine may stall."""
TICK_NS: Final = 1e6
_BLOCK: Final = 20
"""How many successive commands of a recording are looked for together in the emulator's trace."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a scenario. Times are in s after the scenario's last step.

    Attributes:
        exit_code: exit code of `rig run`.
        cause: first-out cause in the trip report. If there is no report, the cause in the recording
            or in what was printed; if there is none either, why the run was stopped. Empty if the
            run came to its end.
        valve_s: when the valve was disabled with its output at 0 V; None if it was not.
        bypass_s: when all balls of the bypass valves were shut; None if they were not.
        pump_s: when the pump was unloaded; None if it was not.
        lost_s: how much of the time before the last step is missing on disk, s; None if no row is
            readable or none can be found in the emulator's trace.
        report: the trip report as text; empty if there is none.
        printed: what `rig run` printed, followed by the log of its processes.
        unfinished: names of the files that were left half written.
    """

    exit_code: int
    cause: str
    valve_s: float | None
    bypass_s: float | None
    pump_s: float | None
    lost_s: float | None
    report: str
    printed: str
    unfinished: tuple[str, ...]

    @property
    def times(self) -> dict[str, float | None]:
        """When each device was safe (s, None if never), in the order in which a trip does it."""
        return {"valve": self.valve_s, "bypass": self.bypass_s, "pump": self.pump_s}


def judge(stage: Stage) -> Outcome:
    """Return the outcome of a scenario whose processes have all ended."""
    events = [json.loads(line) for line in stage.record.read_text().splitlines()]
    log = stage.out / "session.log"
    report = stage.out / "trip-1.txt"
    recording = readable(stage.out / "leaks.mcap", stage.out / "recovered.mcap")
    return Outcome(
        exit_code=stage.run.returncode,
        cause=cause_of(stage.out, recording, stage.printed),
        **{f"{part}_s": _after(stage, at) for part, at in safe_at(events).items()},
        lost_s=None if recording is None else lost_s(stage.trace, stage.injected_ns, recording),
        report=report.read_text() if report.exists() else "",
        printed=stage.printed + (log.read_text() if log.exists() else ""),
        unfinished=tuple(path.name for path in stage.out.glob(".*.partial")),
    )


def problems(scenario: Scenario, outcome: Outcome) -> list[str]:
    """Return a message for each point in which the outcome differs from the scenario's claims.

    In no scenario may more than `LOST_S` of data be lost, a traceback be printed, or a file be left
    half written. `null_ms` is not checked.
    """
    found = []
    if outcome.cause not in (scenario.causes or ("",)):
        found.append(
            f"cause {outcome.cause or 'none'}, not {' or '.join(scenario.causes) or 'none'}"
        )
    if outcome.exit_code != scenario.exit_code:
        found.append(f"exit code {outcome.exit_code}, not {scenario.exit_code}")
    for part, at_s in outcome.times.items():
        if (at_s is None) != (part in scenario.unsafe):
            found.append(f"{part} is {'not ' if at_s is None else ''}safe")
    order = [at_s for at_s in outcome.times.values() if at_s is not None]
    if scenario.causes and scenario.ordered and order != sorted(order):
        found.append("not in the order valve, bypass, pump")
    if outcome.lost_s is None or outcome.lost_s > LOST_S:
        found.append(f"lost {outcome.lost_s} s of data")
    if "Traceback" in outcome.printed:
        found.append("a traceback")
    found += [
        f"{text!r} is not in the trip report"
        for text in scenario.mentions
        if text not in outcome.report
    ]
    found += [f"{name} is left half written" for name in outcome.unfinished]
    return found


def safe_at(events: list[dict[str, Any]]) -> dict[str, int | None]:
    """Return since when (ns) each device has been safe without a break, by the record's end.

    The devices are `valve` (disabled), `bypass` (all balls that were ordered to move are shut) and
    `pump` (unloaded). None means that the device is not safe, or is not in the record.

    Args:
        events: the emulator's record, of which `at_ns` is the time.
    """
    valve = pump = None
    balls: dict[str, int | None] = {}
    opened: set[str] = set()
    for event in sorted(events, key=lambda event: event["at_ns"]):
        bypass = event.get("bypass", "")
        match event["event"]:
            case "valve_enabled" | "valve_disabled":
                valve = event["at_ns"] if event["event"] == "valve_disabled" else None
            case "pump_loaded" | "pump_unloaded":
                pump = event["at_ns"] if event["event"] == "pump_unloaded" else None
            case "ball_ordered" if event["opened"]:
                balls[bypass] = None
            case "ball_ordered" if bypass not in opened:
                # This ball was not open and need not move; one on its way will still arrive.
                balls[bypass] = balls.get(bypass) or event["at_ns"]
            case "ball_arrived" if event["opened"]:
                opened.add(bypass)
            case "ball_arrived":
                opened.discard(bypass)
                balls[bypass] = event["at_ns"]
    shut = [at for at in balls.values() if at is not None]
    all_shut = max(shut) if shut and len(shut) == len(balls) else None
    return {"valve": valve, "bypass": all_shut, "pump": pump}


def driven(events: list[dict[str, Any]]) -> list[str]:
    """Return the devices that were enabled, opened or loaded, and not safe at a record's end."""
    moved = {
        "valve": any(event["event"] == "valve_enabled" for event in events),
        "bypass": any(event["event"] == "ball_ordered" and event["opened"] for event in events),
        "pump": any(event["event"] == "pump_loaded" for event in events),
    }
    return [device for device, at_ns in safe_at(events).items() if at_ns is None and moved[device]]


def _after(stage: Stage, at_ns: int | None) -> float | None:
    return None if at_ns is None else 1e-9 * (at_ns - stage.injected_ns)


def cause_of(out: Path, recording: Table | None, printed: str) -> str:
    """Return the first-out cause of a run's trip, or why the run was stopped.

    It is empty if the run came to its end, or if nothing that is left of it tells a cause.

    Args:
        out: the run's folder.
        recording: its recording, if one can be read.
        printed: what the run printed.
    """
    report = out / "trip-1.json"
    if report.exists():
        return str(json.loads(report.read_text())["cause"])
    for event in recording.events if recording else ():
        name = event.text.partition(":")[0]
        if event.kind == "trip" and name in Cause.__members__:
            return name
    for cause, (sentence, _) in EXPLANATIONS.items():
        # What stands for a channel in the sentence is the channel's name where it is printed.
        told = r"(?:a channel|\w+)".join(map(re.escape, sentence.split("{channel}")))
        if sentence and re.search(rf"tripped(?: by the \w+)?: {told}", printed):
            return cause.name
    results = out / "results.json"
    if not results.exists():
        return ""
    (test,) = json.loads(results.read_text())["tests"]
    return str(test["message"])


def readable(path: Path, saved: Path) -> Table | None:
    """Return the rows of the recording at `path`; None if it is missing or no row is readable.

    If the file was cut off, its rows are recovered to the file `saved` first.
    """
    try:
        return read_mcap(str(path))
    except RecordingError:
        pass
    try:
        recover(path, saved)
    except RecordingError:
        return None
    return read_mcap(str(saved))


def lost_s(trace: Path, at_ns: int, recording: Table) -> float | None:
    """Return how long (s) before a moment the last row of a recording was made.

    Rows have no time of the emulator's clock, so stretches of 20 commands in them are looked for
    in the emulator's trace, which states when it received each command. Rows after the last
    stretch that is found are counted as 1 ms each.

    Args:
        trace: CSV file with the time (ns) and value (V) of each command received.
        at_ns: the moment, CLOCK_MONOTONIC.
        recording: the rows on disk.

    Returns:
        The time in s, 0 if the last row is later than `at_ns`; None if no stretch of the
        recording's commands occurs exactly once in the trace.
    """
    commands = recording.columns["command_V"].astype(np.float32)
    # If the emulator was killed, the last line of its trace may be cut off.
    whole = trace.read_text().rpartition("\n")[0].splitlines()
    received = np.loadtxt(whole, delimiter=",", skiprows=1, usecols=(0, 1), ndmin=2)
    times_ns, traced = received[_BLOCK - 1 :, 0], received[:, 1].astype(np.float32)
    stretches = np.lib.stride_tricks.sliding_window_view(traced, _BLOCK)
    for end in range(len(commands), _BLOCK, -_BLOCK):
        block = commands[end - _BLOCK : end]
        found = np.flatnonzero((stretches == block).all(axis=1))
        # A stretch of constant 0 V occurs at many places and says nothing about the time.
        if len(found) == 1:
            last_ns = float(times_ns[found[0]]) + (len(commands) - end) * TICK_NS
            return max(0.0, 1e-9 * (at_ns - last_ns))
    return None
