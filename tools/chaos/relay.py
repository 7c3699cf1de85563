"""Kills one part of a campaign's run again and again, and resumes the campaign after each kill."""

import json
import random
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGKILL
from typing import Any, Final

from rig.runner.run_folder.journal import JOURNAL, Entry, read_journal

from .judge import driven, lost_s, readable, safe_at
from .records import TICK_S, finished_in, main_s, record_problems, standing_in, told_problems
from .stage import COMPILE_S, FIRST_FAULT, Stage, StageError

RIG: Final = ("supervisor", "loop", "field", "recorder", "publisher")
PARTS: Final = {
    "supervisor": ("supervisor",),
    "recorder": ("recorder",),
    "publisher": ("publisher",),
    "console": ("console",),
    "everything": RIG,
}
"""The processes that are killed for each part. The console is none of the run's: it follows it."""
OUTLIVED: Final = ("publisher", "console")
"""Parts without which a run goes on; it only reports their end."""
CAUSED: Final = {"recorder": "RECORDER_LOST"}
"""Cause of the trip by which a run ends itself after a part was killed."""
STALLS: Final = (
    "OVERRUN", "STALE_SAMPLE", "WATCHDOG_TRIPPED", "LOOP_LOST", "FIELD_LOST", "RECORDER_LOST",
    "SUPERVISOR_LOST", "BYPASS_LOST", "DRIVE_LOST", "PUMP_LOST", "EXCHANGE_LOST",
)  # fmt: skip
"""Causes of trips that are no fault of the rig: the machine stalled it or its emulated devices."""
MOST_STALLS: Final = 30
"""Number of trips by such causes that are allowed; each further one is a problem."""
CONNECTING: Final = 0.2
"""Share of kills while a run connects, arms and positions; the other kills come in a test."""
CONNECTING_S: Final = 5.0
"""A kill of the first sort comes within this time after the run has begun or resumed, s."""
TESTING_S: Final = 12.0
"""A kill in a test comes within this time after the run's first test began, s."""
AGAIN_S: Final = 4.0
"""A part that the run does without is killed again within this time, s."""
LOST_S: Final = 1.5
"""At most this much of a recording's end may be lost, s: one second, and half of one for stalls."""
SETTLED_S: Final = 1.2
"""After this time, s, the emulator's trace covers the kill; the trace is written each second."""
DURATION_S: Final = 5.0
"""Duration of a test, s: the shortest that is allowed."""
TESTS: Final = tuple(
    {
        "name": f"test {number}",
        "duration": f"{DURATION_S:g} s",
        "settle": "0.2 s",
        "setpoint": {"type": "sine", "mean": "0.3 m", "amplitude": "0.05 m", "frequency": "1 Hz"},
        "faults": [{**FIRST_FAULT, "at": "0.2 s", "until": "3 s"}],
    }
    for number in range(3)
)
_GONE_S: Final = 20.0


@dataclass
class Record:
    """The outcome of the kills of one part of a run.

    Attributes:
        kills: test and phase at each kill (`JournalState.where`); "" for a kill outside any test.
        campaigns: number of campaigns that were run to their end.
        tests: number of tests that these finished.
        attempts: number of runs of tests that were interrupted and did not count.
        stalls: causes of the trips that the machine brought about by stalling.
        lost_s: for each recording that was cut off, how much was missing at its end, s. A recording
            whose motion had hardly begun is left out.
        safe_s: for each kill that ended a run on the emulated rig, after how many s each device was
            safe; devices that were safe already are left out.
        problems: messages on what was wrong.
    """

    kills: list[str] = field(default_factory=list)
    campaigns: int = 0
    tests: int = 0
    attempts: int = 0
    stalls: list[str] = field(default_factory=list)
    lost_s: list[float] = field(default_factory=list)
    safe_s: list[dict[str, float]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


class Relay:
    """Runs campaigns on one rig until a part was killed often enough and all are finished.

    Args:
        stage: the stage, which must have been entered.
        part: the part to kill, a key of `PARTS`.
        kills: number of kills, over all campaigns.
        random_: draws the times of the kills.
        emulated: whether the stage has an emulator.
        tell: is called with a line of text for each kill and each stall of the machine.

    Attributes:
        record: the outcome so far.
    """

    def __init__(
        self,
        stage: Stage,
        part: str,
        kills: int,
        random_: random.Random,
        *,
        emulated: bool,
        tell: Callable[[str], None],
    ) -> None:
        self._stage = stage
        self._part = part
        self._wanted = kills
        self._random = random_
        self._tell = tell
        self._told = ""
        self._emulated = emulated
        self._reports: set[Path] = set()
        self._recording: str | None = None
        self._main_s = 0.0
        self._reader: subprocess.Popen[str] | None = None
        self.record = Record()

    def run(self) -> Record:
        """Run campaigns with kills until there were enough; return the outcome.

        After the last kill, its campaign is resumed until it ends. A problem in a campaign makes it
        the last one.

        Raises:
            StageError: the rig did not become safe, a run did not come to its end, or the emulator
                gave no answer.
        """
        number = 0
        while len(self.record.kills) < self._wanted and not self.record.problems:
            number += 1
            self._stage.out = self._stage.folder / f"out-{number}"
            self._campaign()
        return self.record

    def _campaign(self) -> None:
        """Run one campaign with kills, resume it until it ends, and add to the record."""
        stage, record = self._stage, self.record
        before: list[dict[int, Any]] = []
        killed_in: list[str] = []
        while True:
            stage.wait(stage.is_safe, "the safe state")
            stage.start("--resume", *([] if self._emulated else ["--pace", "real"]))
            killed = self._session(len(before) + 1)
            stage.wait(lambda: stage.run.poll() is not None, "`rig run` to end")
            self._gone()
            known = finished_in(stage.out)
            code = stage.run.returncode
            if code in (0, 1) and (not killed or len(known) == len(TESTS)):
                break
            self._interrupted(code, killed)
            if record.problems:
                return
            before.append(known)
            killed_in.append(standing_in(stage.out).where)
        problems = record_problems(stage.out, before, len(TESTS))
        problems += told_problems(stage.out, killed_in)
        record.problems += [f"{stage.out.name}: {problem}" for problem in problems]
        state = standing_in(stage.out)
        record.campaigns += 1
        record.tests += len(state.finished)
        record.attempts += sum(map(len, state.attempts.values()))

    def _session(self, number: int) -> bool:
        """Follow a run until the part is killed or the run ends; return whether a kill ended it.

        A part that the run does without is killed several times while the run goes on; the answer
        is then False.

        Args:
            number: 1 for the campaign's first run, and one more for each time it was resumed.
        """
        self._await_entries(number, "begin", "resume")
        span = CONNECTING_S
        if self._random.random() > CONNECTING:
            tests = len(self._entries("phase"))
            self._await_entries(tests + 1, "phase")
            span = TESTING_S
        while len(self.record.kills) < self._wanted:
            self._begin_to_follow()
            delay = self._random.uniform(0.0, span)
            if not self._pause(delay) or not self._can_be_killed():
                return False
            self._kill()
            if self._part not in OUTLIVED:
                return True
            span = AGAIN_S
        return False

    def _entries(self, *kinds: str) -> list[Entry]:
        """Return the journal's entries of the given kinds; none while there is no journal."""
        path = self._stage.out / JOURNAL
        read = read_journal(path) if path.exists() else []
        return [entry for entry in read if entry.kind in kinds]

    def _await_entries(self, count: int, *kinds: str) -> None:
        """Wait until the journal has `count` entries of the given kinds, or the run has ended."""
        run = self._stage.run
        self._stage.wait(
            lambda: len(self._entries(*kinds)) >= count or run.poll() is not None,
            f"the campaign to come to {kinds[0]}",
            COMPILE_S,
        )

    def _pause(self, seconds: float) -> bool:
        """Wait for a time, or until the run ends; return whether the run still goes on."""
        until = time.monotonic() + seconds
        while time.monotonic() < until and self._stage.run.poll() is None:
            time.sleep(0.005)
        return self._stage.run.poll() is None

    def _can_be_killed(self) -> bool:
        """Wait until a process of the part runs; return False if the run ends before that."""
        while self._stage.run.poll() is None:
            self._stage.find_children()
            living = self._stage.living()
            if self._part == "console" or any(part in living for part in PARTS[self._part]):
                return True
            time.sleep(0.02)
        return False

    def _kill(self) -> None:
        stage = self._stage
        state = standing_in(stage.out)
        self._recording = state.recording
        self._main_s = main_s(stage.out)
        stage.injected_ns = time.monotonic_ns()
        if self._reader is not None:
            self._reader.kill()
            self._reader.wait()
            self._reader = None
        else:
            living = stage.living()
            stage.send(SIGKILL, *(part for part in PARTS[self._part] if part in living))
        self.record.kills.append(state.where)
        self._told = f"{len(self.record.kills)}: killed in {state.where or 'no test'}"
        if self._part in OUTLIVED:
            self._tell(self._told)

    def _begin_to_follow(self) -> None:
        if self._part == "console" and self._reader is None:
            self._reader = self._stage.follow()

    def _gone(self) -> None:
        """Wait until no process of the run is left.

        Raises:
            StageError: there still is one after `_GONE_S`.
        """
        stage = self._stage
        stage.wait(lambda: not stage.living(), "its processes to end", _GONE_S)

    def _interrupted(self, code: int, killed: bool) -> None:
        """Check how a run ended that did not come to its end, and what it left on disk.

        Exit code and cause must fit the kill, or be those of a stall. The outcome is added to the
        record.

        Args:
            code: exit code of the run.
            killed: whether its part was killed.
        """
        stage, record = self._stage, self.record
        expected = code == -SIGKILL if "supervisor" in PARTS[self._part] else code == 3
        cause = self._cause()
        if not killed or not expected:
            if code == 3 and cause in STALLS and len(record.stalls) < MOST_STALLS:
                record.stalls.append(cause)
                self._tell(f"the machine stalled: {cause} ; {self._last_words()}")
            else:
                record.problems.append(f"exit code {code}, {cause}: {stage.printed[-2000:]}")
                return
        elif code == 3 and cause not in (CAUSED[self._part], *STALLS):
            record.problems.append(f"tripped by {cause} when {self._part} was killed")
        if not killed:
            return
        if self._emulated:
            stage.wait(stage.is_safe, "the safe state")
            time.sleep(SETTLED_S)
            self._look_at_devices()
        self._look_at_recording()
        self._tell(self._told)

    def _last_words(self) -> str:
        entries = read_journal(self._stage.out / JOURNAL)
        return ", ".join(str(entry["phase"] or entry.kind) for entry in entries[-4:])

    def _cause(self) -> str:
        """Return the cause in the run's newest trip report, or "no trip" if there is no new one."""
        for report in self._stage.out.glob("trip-*.json"):
            if report not in self._reports:
                self._reports.add(report)
                return str(json.loads(report.read_text())["cause"])
        return "no trip"

    def _look_at_devices(self) -> None:
        """Add to the record after which time each device was safe, by the emulator's record."""
        events = [json.loads(line) for line in self._stage.record.read_text().splitlines()]
        at_ns = self._stage.injected_ns
        before = [event for event in events if event["at_ns"] <= at_ns]
        safe = safe_at(events)
        after = {
            device: 1e-9 * (safe_ns - at_ns)
            for device in driven(before)
            if (safe_ns := safe[device]) is not None
        }
        self.record.safe_s.append(after)
        times = ", ".join(f"{device} {at_s:.2f} s" for device, at_s in after.items())
        self._told += f", safe after: {times}" if times else ", which was safe"

    def _look_at_recording(self) -> None:
        """Add to the record how much is missing at the end of the recording that was cut off.

        Nothing is added if there is no such recording, or if its motion had hardly begun.
        """
        stage, name = self._stage, self._recording
        if name is None or not (stage.out / name).exists():
            return
        copy, saved = stage.folder / "cut.mcap", stage.folder / "recovered.mcap"
        shutil.copy(stage.out / name, copy)
        saved.unlink(missing_ok=True)
        recording = readable(copy, saved)
        rows = 0 if recording is None else len(recording)
        if rows * TICK_S >= DURATION_S:
            missing = 0.0
        elif recording is None or not self._emulated:
            missing = max(0.0, min(self._main_s, DURATION_S) - rows * TICK_S)
        else:
            found = lost_s(stage.trace, stage.injected_ns, recording)
            if found is None:
                # The motion had hardly begun, so the commands cannot be found in the trace.
                return
            missing = found
        self.record.lost_s.append(missing)
        self._told += f", {missing:.2f} s of the recording lost"
        if missing > LOST_S:
            self.record.problems.append(f"{name}: its last {missing:.1f} s are lost")


def relay(
    folder: Path,
    part: str,
    kills: int,
    seed: int,
    *,
    emulated: bool,
    tell: Callable[[str], None] = lambda text: None,
) -> Record:
    """Kill one part of campaigns on one rig again and again, and return the outcome.

    If the rig does not become safe, a run does not end, or the emulator gives no answer, the
    outcome has this as a problem.

    Args:
        folder: an empty folder for all files.
        part: the part to kill, a key of `PARTS`.
        kills: number of kills, over all campaigns.
        seed: draws, together with the part's name, the times of the kills.
        emulated: whether the rig is the emulated one; otherwise it is the simulated one.
        tell: is called with a line of text for each kill and each stall of the machine.
    """
    when = random.Random(f"{part} {seed}")
    with Stage(folder, tests=TESTS, emulated=emulated) as stage:
        runs = Relay(stage, part, kills, when, emulated=emulated, tell=tell)
        try:
            return runs.run()
        except StageError as error:
            runs.record.problems.append(str(error))
            return runs.record
