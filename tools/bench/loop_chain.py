"""Runs the whole chain of a loop for benchmarks: emulated rig, loop process and recorder."""

import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings, Sine, guide_of
from estimator.filters.registry import start_memory
from rig.configuration.rigs.rig import Rig
from rig.io.registry import DriverSpec
from rig.io.settings import HomingSettings
from rig.loop.board import RING_ROWS, Board, RingReader, Word
from rig.loop.interlocks.check_tolerances import Tolerances, tolerances
from rig.loop.interlocks.ladder import Cause, explain, limit_table
from rig.loop.wire.layout import Drive, wire_channels
from rig.loop.wire.orders import Close, Open, Segment
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.recording.formats.mcap_reader import read_mcap
from rig.supervisor.processes.child import Child
from rig.supervisor.processes.recorder import BeginRecording, FinishRecording

Array = NDArray[np.float64]

CPU: Final = 1
PRIORITY: Final = 80
MODEL: Final = Model()
CHANNELS: Final = wire_channels(start_memory("product", MODEL).filter.states, open_loop=False)
PROPORTIONAL: Final = ControlSettings()
AMPLITUDE_M: Final = 0.01
FREQUENCY_HZ: Final = 1.0
TEST: Final = 3
"""Number of the segment that is recorded."""

_PATIENCE_S: Final = 180.0
"""s that the loop may take to start; it may have to be compiled first."""
_POLL_S: Final = 0.01


class TrippedError(Exception):
    """The loop tripped, or this benchmark was too late to read a row; the message says which."""


class Chain:
    """A context manager in which a loop follows a sine on an emulated rig and is recorded.

    It is entered once the motion has begun. Its end ends all processes and deletes the recording.

    Args:
        rig: the emulated rig, as configured.
        seconds: length of the motion, s.
        control: what the position loop adds to gain times error.

    Attributes:
        board: the board that loop and recorder share.
        recording: file of the recording.
    """

    def __init__(self, rig: Rig, seconds: float, control: ControlSettings = PROPORTIONAL) -> None:
        self._rig = rig
        self._control = control
        self._ticks = round(seconds / TICK)
        self._ends = ExitStack()
        self._begun = 0

    def __enter__(self) -> Self:
        with self._ends:
            folder = Path(self._ends.enter_context(tempfile.TemporaryDirectory()))
            port = self._ends.enter_context(_emulated())
            self.recording = folder / "bench.mcap"
            self.board = Board.create(len(CHANNELS))
            log = folder / "log"
            self._loop = Child(
                "loop", "rig.supervisor.processes.loop_process", self.board, log, lambda news: None
            )
            self._ends.callback(self._loop.end)
            self._recorder = Child(
                "recorder", "rig.supervisor.processes.recorder", self.board, log, lambda news: None
            )
            self._ends.callback(self._recorder.end)
            self._drive(port)
            self._ends = self._ends.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ends.close()

    @property
    def ticks(self) -> int:
        """The number of ticks of the motion so far; 0 before it has begun."""
        words = self.board.words
        return int(words[Word.TICK]) if words[Word.SEGMENT] == TEST else 0

    def rows(self, count: int) -> Array:
        """Wait for the next `count` rows and return them, (count, columns) as in `CHANNELS`.

        Rows that were made before the call are not among them.

        Raises:
            TrippedError: the loop tripped, or rows were written over before they could be read.
        """
        reader = RingReader(self.board)
        found: list[Array] = []
        while sum(map(len, found)) < count:
            time.sleep(0.2)
            found.append(reader.take())
            self.check()
        if reader.lost:
            raise TrippedError(f"this benchmark itself was late, by {reader.lost} rows")
        return np.concatenate(found)[:count]

    def check(self) -> None:
        """Raise unless the loop goes on.

        Raises:
            TrippedError: the loop has tripped.
        """
        trip = int(self.board.words[Word.LOOP_TRIP])
        if trip:
            raise TrippedError(explain(Cause(trip)).sentence)

    def finish(self) -> int:
        """End recording and loop; return how many rows are missing in the recording.

        It is the largest of four counts: rows that were not recorded, recorded rows that are not in
        the file, holes in its time, and losses that the recorder reported. No further rows come.
        """
        due = int(self.board.words[Word.ROWS]) - self._begun
        self._recorder.send(FinishRecording(due))
        recorded = int(self._recorder.answer(_PATIENCE_S))
        self._loop.send(Close())
        self._loop.answer(_PATIENCE_S)
        table = read_mcap(str(self.recording))
        lost = [event.text for event in table.events if event.kind == "lost"]
        # The number of rows alone could hide a missing row behind one that is there twice.
        ticks = np.round(table.columns["time_s"] / TICK)
        holes = int(np.count_nonzero(np.diff(ticks) != 1.0))
        return max(due - recorded, recorded - len(table), holes, len(lost))

    def _drive(self, port: int) -> None:
        """Open the device at `port`, enable the valve, and begin the recording and the motion."""
        rig, board, words, loop = self._rig, self.board, self.board.words, self._loop
        spec = fast(rig)
        spec = dataclasses.replace(spec, options=dataclasses.replace(spec.options, port=port))
        words[Word.SWITCH] = 1
        first = Segment(1, Drive.NULL, start_memory("product", MODEL), MODEL.parameters)
        settings = dataclasses.replace(rig.loop, cpu=CPU, priority=PRIORITY)
        loop.send(Open(spec, settings, limit_table((), TICK), wire_tolerances(rig, spec), first))
        loop.answer(_PATIENCE_S)
        armed = dataclasses.replace(
            first, number=2, valve_enable=True, reset_lamp=True, rearm=True, reset=True
        )
        self._switch(armed)
        column = CHANNELS.index("valve_enabled")
        self._wait(lambda: board.ring[int(words[Word.ROWS]) - 1, column] == 1.0)
        here = board.ring[int(words[Word.ROWS]) - 1, CHANNELS.index("position_m")]
        sine = Sine(float(here), AMPLITUDE_M, FREQUENCY_HZ, 0.0)
        motion = sine.sample(np.arange(self._ticks) * TICK)
        guide = guide_of(
            sine, motion, self._control, MODEL.parameters, rig.sensors, first.gain, first.limit
        )
        test = dataclasses.replace(
            first, number=TEST, drive=Drive.TRACK, setpoint=motion, guide=guide, valve_enable=True
        )
        self._recorder.send(BeginRecording(TEST, self.recording, CHANNELS, {}, time.time_ns()))
        self._recorder.answer(_PATIENCE_S)
        self._switch(test)
        self._wait(lambda: self.ticks > 0)
        # Rows of earlier segments are not recorded, so the first row of the test is looked for.
        end = int(words[Word.ROWS])
        known = np.arange(max(end - RING_ROWS // 2, 0), end)
        segments = board.ring[known % RING_ROWS, CHANNELS.index("segment")]
        self._begun = int(known[np.argmax(segments == TEST)])

    def _switch(self, segment: Segment) -> None:
        self._loop.send(segment)
        self._loop.answer(_PATIENCE_S)
        self.board.words[Word.SWITCH] = segment.number

    def _wait(self, done: Callable[[], bool]) -> None:
        until = time.monotonic() + _PATIENCE_S
        while not done():
            self.check()
            if time.monotonic() > until:
                raise RuntimeError("the emulated rig was not enabled in time")
            time.sleep(_POLL_S)


def fast(rig: Rig) -> DriverSpec:
    """Return the specification of the rig's fast driver, which exchanges samples in the loop."""
    return next(spec for spec in rig.drivers if spec.kind == "fast")


def wire_tolerances(rig: Rig, spec: DriverSpec) -> Tolerances:
    """Return the tolerances of the plausibility checks at 1 kHz, for a rig and its fast driver."""
    return tolerances(
        MODEL.parameters, rig.sensors, frozenset(spec.inputs), TICK, rig.loop.stale_limit,
        rig.homing or HomingSettings(),
    )  # fmt: skip


@contextmanager
def _emulated() -> Iterator[int]:
    """Start the emulated rig in a process of its own, yield the port of its DAQ, and end it."""
    command = [str(Path(sys.executable).with_name("rig")), "emulate", "emulated", "--json"]
    for driver in ("daq", "bypass"):
        command += ["--set-port", f"{driver}=0"]
    emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert emulator.stdout is not None
    try:
        yield int(json.loads(emulator.stdout.readline())["ports"]["daq"])
    finally:
        emulator.terminate()
        emulator.wait()
        emulator.stdout.close()
