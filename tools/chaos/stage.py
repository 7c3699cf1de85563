"""The stage of a scenario: an emulated rig, and `rig run` on it, as processes of their own."""

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

import yaml

ROOT: Final = Path(__file__).parents[2]
PATIENCE_S: Final = 60.0
"""s: how long is waited for anything; only a failure takes so long."""
COMPILE_S: Final = 300.0
"""s: how long a session may take to begin; its loop may have to be compiled first."""
POLL_S: Final = 0.02
"""s between two looks at a condition that is waited for."""

MODULES: Final = {
    "loop": "rig.supervisor.processes.loop_process",
    "field": "rig.supervisor.processes.field",
    "recorder": "rig.supervisor.processes.recorder",
    "publisher": "rig.supervisor.processes.publisher",
}
"""Modules of the processes that `rig run`, which is the supervisor, starts."""

MID_STROKE_COUNTS: Final = 10_116
"""Encoder counts of 0.03 mm from the stroke's end to the ram when the emulator starts.

The encoder starts counting from there.
"""

FIRST_LEAK: Final = "internal_leakage"
SECOND_LEAK: Final = "external_leakage_1"
FIRST_FAULT: Final = {
    "type": FIRST_LEAK, "at": "0.5 s", "flow": "0.5 L/min", "pressure": "2.5 MPa",
}  # fmt: skip
TEST: Final = {
    "duration": "12 s",
    "settle": "0.5 s",
    "setpoint": {"type": "sine", "mean": "0.3 m", "amplitude": "0.2 m", "frequency": "0.5 Hz"},
    "faults": [
        FIRST_FAULT,
        {"type": SECOND_LEAK, "at": "6 s", "flow": "0.5 L/min", "pressure": "6.9 MPa"},
    ],
    "expect": SECOND_LEAK,
}


class StageError(Exception):
    """The scenario could not be played; the message says why."""


class NotBegunError(StageError):
    """The run ended before its test began, for example because the machine stalled."""


class Stage:
    """An emulator and the runs of one campaign on it, as a context manager.

    Args:
        folder: an empty folder, for the rig file, the campaign, the emulator's record and the runs.
        prefix: prefix of the command that runs the campaign, such as `setpriv ...`.
        tests: tests of the campaign, as in its file.
        emulated: whether there is an emulator; without it, the campaign runs on the simulated rig.
        plain_report: whether the runs write their report without plots, which take 12 s of
            processor time (hooks/sitecustomize.py).

    Attributes:
        folder: the folder given.
        out: folder of the run; it may be set before the next `start`.
        stream: file with the profile of the live stream.
        record, trace: files that the emulator writes: its events, and the commands it receives.
        run: process of `rig run` that `start` started last; missing before.
        injected_ns: when a fault was last started, a signal (but SIGCONT) sent, or file sizes
            limited, CLOCK_MONOTONIC; 0 before.
        children: process ids of the run's processes by part, as `find_children` last found them.
    """

    def __init__(
        self,
        folder: Path,
        prefix: Sequence[str] = (),
        tests: Sequence[Mapping[str, Any]] = ({"name": "leaks", **TEST},),
        *,
        emulated: bool = True,
        plain_report: bool = False,
    ) -> None:
        self.folder = folder
        self.out = folder / "out"
        self.stream = folder / "stream.yaml"
        self.record = folder / "record.jsonl"
        self.trace = folder / "trace.csv"
        self.injected_ns = 0
        self._printed = folder / "printed.txt"
        self.children: dict[str, int] = {}
        self._prefix = tuple(prefix)
        self._tests = tests
        self._emulated = emulated
        self._plain_report = plain_report
        self._ends = ExitStack()

    def __enter__(self) -> Self:
        """Write the files of the stage and start the emulator.

        Raises:
            StageError: the emulator does not start.
        """
        _write_rig(self.folder, emulated=self._emulated)
        _write_stream(self.stream)
        _write_campaign(self.folder, self._tests)
        with self._ends:
            if self._emulated:
                self._start_emulator()
            self._ends = self._ends.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End all processes of the stage that are left, by SIGKILL if need be; wait until ended."""
        self._ends.close()

    def _start_emulator(self) -> None:
        files = ["--record", str(self.record), "--trace", str(self.trace)]
        arguments = ("rig.yaml", *files, "--control", "0", "--json")
        self._emulator = self._python("emulate", *arguments, output=subprocess.PIPE)
        self._ends.callback(_end, self._emulator, signal.SIGTERM)
        assert self._emulator.stdout is not None
        ready = self._emulator.stdout.readline()
        if not ready.startswith("{"):
            raise StageError(f"the emulator did not start: {ready}")
        address = ("127.0.0.1", int(json.loads(ready)["ports"]["control"]))
        line = self._ends.enter_context(socket.create_connection(address, timeout=PATIENCE_S))
        self._control = line.makefile("rw")
        self._ends.callback(_close, self._control)
        # This makes the encoder read the true position, so that no homing run is needed.
        self.ask(do="inject", fault="lost_counts", counts=-MID_STROKE_COUNTS)

    def begin(self) -> None:
        """Start the campaign's run, and return once the ball of the test's first leak is open.

        Needs an emulator.

        Raises:
            NotBegunError: the run ended before that.
            StageError: the ball was not open within `COMPILE_S`.
        """
        self.start()
        self.wait(self._is_leaking, "the test to run", COMPILE_S)
        self.find_children()

    def start(self, *options: str) -> None:
        """Start `rig run` on the campaign, with further options of the command; do not wait for it.

        `children` is emptied, and `printed` begins anew.
        """
        # What it prints goes through a pipe, so that a limit on its file sizes does not silence it.
        with self._printed.open("w") as file:
            copy = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=file, text=True)
        self._ends.callback(copy.wait)
        assert copy.stdin is not None
        given = ("--out", self.out.name, "--stream", self.stream.name, *options)
        with copy.stdin as pipe:
            self.run = self._python("run", "campaign.yaml", *given, output=pipe)
        self._ends.callback(_end, self.run, signal.SIGKILL)
        self._ends.callback(self._kill_children)
        self.children = {}

    def follow(self) -> "subprocess.Popen[str]":
        """Start a console that follows the run; return its process once it serves its page.

        Raises:
            StageError: the console does not start.
        """
        (port,) = free_ports(1)
        given = ("--listen", f"127.0.0.1:{port}", "--profile", self.stream.name)
        console = self._python("console", *given, output=subprocess.PIPE)
        self._ends.callback(_end, console, signal.SIGKILL)
        assert console.stdout is not None
        line = console.stdout.readline()
        if not line.startswith("console: http"):
            raise StageError(f"the console did not start: {line}")
        return console

    def _python(
        self, command: str, *arguments: str, output: int | IO[str]
    ) -> subprocess.Popen[str]:
        paths = [str(ROOT / "tools" / "chaos" / "hooks"), str(ROOT)]
        prefix = self._prefix if command == "run" else ()
        plain = {"RIG_CHAOS_PLAIN_REPORT": "yes"} if self._plain_report else {}
        return subprocess.Popen(
            [*prefix, sys.executable, "-m", "rig.cli", command, *arguments],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | plain,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request, given by its fields, to the emulator's control port; return the answer.

        Raises:
            StageError: the emulator refuses the request, gives no answer within `PATIENCE_S`, or
                has ended.
        """
        try:
            self._control.write(json.dumps(request) + "\n")
            self._control.flush()
            reply: dict[str, Any] = json.loads(self._control.readline())
        except (OSError, ValueError) as error:
            raise StageError(f"the emulator gave no answer to {request}: {error}") from error
        if not reply["ok"]:
            raise StageError(f"{request}: {reply['problems']}")
        return reply

    def inject(self, **fault: Any) -> None:
        """Start a fault of the emulator, given by its fields; note the time in `injected_ns`.

        Raises:
            StageError: the emulator refuses the fault, or gives no answer.
        """
        self.injected_ns = time.monotonic_ns()
        self.ask(do="inject", **fault)

    def send(self, number: signal.Signals, *parts: str) -> None:
        """Send a signal to parts; note the time in `injected_ns` unless the signal is SIGCONT.

        Parts are supervisor, loop, field, recorder, publisher and emulator.

        Raises:
            KeyError: `find_children` has found no process of a part.
        """
        if number != signal.SIGCONT:
            self.injected_ns = time.monotonic_ns()
        for part in parts:
            os.kill(self.pid(part), number)

    def limit_files(self, *parts: str) -> None:
        """Set the limit on file sizes of these parts (`send`) to 0; note the time."""
        self.injected_ns = time.monotonic_ns()
        for part in parts:
            resource.prlimit(self.pid(part), resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))

    def pid(self, part: str) -> int:
        """Return the process id of a part (`send`), even if its process has ended.

        Raises:
            KeyError: `find_children` has found no such process.
        """
        if part == "emulator":
            return self._emulator.pid
        return self.run.pid if part == "supervisor" else self.children[part]

    @property
    def emulator_lives(self) -> bool:
        """Whether the emulator's process still runs."""
        return self._emulator.poll() is None

    @property
    def printed(self) -> str:
        """What `rig run`, as it was started last, has printed so far; "" if it was not started."""
        return self._printed.read_text() if self._printed.exists() else ""

    def wait(self, done: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
        """Wait until `done()` returns True.

        Args:
            done: the condition to wait for.
            what: what is waited for, for the message.
            patience_s: how long to wait at most, s.

        Raises:
            StageError: `done()` was not True in time, or raised this.
        """
        until = time.monotonic() + patience_s
        while not done():
            if time.monotonic() > until:
                raise StageError(f"waited {patience_s:g} s for {what}; it printed: {self.printed}")
            time.sleep(POLL_S)

    def is_safe(self) -> bool:
        """Return whether valve is at null and disabled, balls are shut and pump is unloaded.

        The valve in the return line is not looked at. On the simulated rig, which has no devices,
        this is always True.

        Raises:
            StageError: the emulator gives no answer.
        """
        if not self._emulated:
            return True
        status = self.ask(do="status")
        daq, balls = status["daq"], self._balls(status)
        null = not daq["valve_enabled"] and daq["output_V"] == 0.0
        return null and not any(balls.values()) and not status["can"]["pump_loaded"]

    def living(self) -> list[str]:
        """Return the supervisor and those parts in `children` whose processes have not ended."""
        parts = {"supervisor": self.run.pid, **self.children}
        self.run.poll()
        return [part for part, pid in parts.items() if _lives(pid)]

    def _is_leaking(self) -> bool:
        if self.run.poll() is not None:
            raise NotBegunError(f"ended before the test: {self.printed}")
        return self._balls(self.ask(do="status"))[FIRST_LEAK] == 1.0

    def _balls(self, status: dict[str, Any]) -> dict[str, float]:
        positions = status["bypass"]["positions"].items()
        return {bypass: ball for bypass, (ball, _) in positions if bypass != "return_blockage"}

    def find_children(self) -> None:
        """Add the processes that `rig run` has at present to `children`, by their part.

        If `rig run` has ended, nothing changes. Processes that have ended stay in `children`.
        """
        if self.run.poll() is not None:
            return
        # The system lists, for each thread, the processes that it started.
        threads = Path(f"/proc/{self.run.pid}/task").glob("*/children")
        pids = [int(pid) for thread in threads for pid in _text_of(thread).split()]
        commands = {pid: _text_of(Path(f"/proc/{pid}/cmdline")) for pid in pids}
        self.children |= {
            part: pid
            for part, module in MODULES.items()
            for pid, command in commands.items()
            if f"from {module} import" in command
        }

    def _kill_children(self) -> None:
        for part in self.living():
            os.kill(self.pid(part), signal.SIGKILL)


def _text_of(path: Path) -> str:
    """Return the text of a file under /proc; "" if its process has ended."""
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


def _lives(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def _close(line: IO[str]) -> None:
    """Close the line to the emulator; what an emulator that has ended did not take is dropped."""
    with suppress(OSError):
        line.close()


def _end(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """End a process by a signal, or by SIGKILL if it does not end in time, for example stopped."""
    process.send_signal(number)
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _write_rig(folder: Path, *, emulated: bool) -> None:
    """Write the file of the shipped rig, with free addresses and, if emulated, without homing."""
    name = "emulated" if emulated else "simulated"
    rig = yaml.safe_load((ROOT / "config" / "rigs" / f"{name}.yaml").read_text())
    if emulated:
        daq, bypass, bus = free_ports(3)
        rig["drivers"]["daq"]["port"] = daq
        rig["drivers"]["bypass"]["port"] = bypass
        rig["drivers"]["meters"]["port"] = str(folder / "meters")
        for node in ("drive", "pump"):
            rig["drivers"][node] |= {"channel": "239.74.163.99", "port": bus}
        del rig["homing"]
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))


def _write_stream(path: Path) -> None:
    """Write the shipped profile of the live stream, `loopback`, with a free port."""
    profile = yaml.safe_load((ROOT / "config" / "stream" / "loopback.yaml").read_text())
    (port,) = free_ports(1)
    path.write_text(yaml.safe_dump({**profile, "listen": [f"tcp/127.0.0.1:{port}"]}))


def _write_campaign(folder: Path, tests: Sequence[Mapping[str, Any]]) -> None:
    campaign = {"name": "chaos", "rig": "rig.yaml", "model": "nominal"}
    detector = {"filter": "product", "false_alarms_per_day": 1}
    content = campaign | {"detector": detector, "tests": [dict(test) for test in tests]}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content))


def free_ports(count: int) -> list[int]:
    """Return so many TCP ports of this machine that nobody listens at."""
    with ExitStack() as sockets:
        opened = [sockets.enter_context(socket.socket()) for _ in range(count)]
        for each in opened:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in opened]
