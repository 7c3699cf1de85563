"""The safety thread beats for the supervisor, watches the other parts, and acts for dead ones.

It is a thread of the supervisor. After any trip it ensures that valve, bypasses and pump are safe:
it waits until the living parts confirm that, and makes the rest safe by connections of its own,
which it repeats for as long as it lives.
"""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rig.configuration import Rig
from rig.io import DriverError, DriverSpec, FastDriver
from rig.loop import FULL, Board, Cause, Word
from rig.reserves import Reserve
from rig.surviving import Surviving, failure, start

from .child import Child, News
from .driven import REPEAT_S, Driven, Tally, departures
from .field import confirmation_of, rank_of
from .health import STEPS, TRIPS, trip

POLL_S: Final = 0.01
MAIN_SILENCE_S: Final = 5.0
"""Time in s without a sign of life of the main thread, after which this thread beats no more."""

NULL_WAIT_S: Final = 0.5
"""Time in s within which the loop must confirm that the valve is at null."""

FIELD_WAIT_S: Final = 10.0
"""Time in s within which the field process must confirm bypasses shut and pump unloaded."""

Report = Callable[[str, str], None]


_MODULES: Final = {"loop": "loop_process", "field": "field", "recorder": "recorder"}
"""Module that each part runs, in the order of the fields of `Parts`."""


@dataclass(frozen=True)
class Parts:
    """The processes that the safety thread watches: loop, field and recorder."""

    loop: Child
    field: Child
    recorder: Child

    @classmethod
    def start(
        cls, board: Board, log: Path, heard: Callable[[News], None], kept: Sequence[int] = ()
    ) -> "Parts":
        """Start the three processes; if one cannot be started, end those that were.

        Args:
            board: the memory that they share.
            log: file to which their stdout and stderr are appended.
            heard: is called with what they tell without being asked.
            kept: further descriptors that stay open for as long as one of them lives.

        Raises:
            OSError: a process cannot be started.
        """
        started: list[Child] = []
        try:
            for name, module in _MODULES.items():
                program = f"rig.supervisor.processes.{module}"
                started.append(Child(name, program, board, log, heard, kept))
        except BaseException:
            for child in started:
                child.end()
            raise
        return cls(*started)


class SafetyThread:
    """The safety thread of a session, which watches its parts from `start` to `stand_down`.

    Args:
        board: the memory that all parts share.
        parts: the processes.
        rig: gives the silences after which a part counts as lost, and the drivers by which the
            thread makes connections of its own.
        report: is called, from the safety thread, with who and what they did, for a trip report.
        found: is called, from the safety thread, with each report on another master.
        reserve: descriptors that are given back at a trip.
    """

    def __init__(
        self,
        board: Board,
        parts: Parts,
        rig: Rig,
        report: Report,
        found: Callable[[Driven], None],
        reserve: Reserve | None = None,
    ) -> None:
        settings = rig.loop
        self._words = board.words
        self._loop, self._field = parts.loop, parts.field
        self._watched = (
            (parts.loop, Word.LOOP_BEAT, settings.loop_silence, Cause.LOOP_LOST),
            (parts.field, Word.FIELD_BEAT, settings.field_silence, Cause.FIELD_LOST),
            (parts.recorder, Word.RECORDER_BEAT, settings.recorder_silence, Cause.RECORDER_LOST),
        )
        self._drivers = rig.drivers
        self._report = report
        self._reserve = reserve or Reserve()
        self._survives = Surviving("the safety thread", self._failed)
        self._tally = Tally("supervisor", found)
        self._kept: dict[str, DriverSpec] = {}
        self._unsafe: set[str] = set()
        self._safe_since: dict[str, int] = {}
        self._kept_at = 0.0
        self._alive_at = time.monotonic()
        self._stopping = threading.Event()
        self._standing_down = threading.Event()
        self._stood_down = threading.Event()
        self._safe = threading.Event()
        self._thread = threading.Thread(target=self._run, name="safety", daemon=True)

    def start(self) -> None:
        """Start the thread, which beats for the supervisor and watches the parts from then on.

        Raises:
            OSError: the system grants no further thread.
        """
        start(self._thread)

    def stand_down(self) -> None:
        """Let the thread stop watching the parts, which are ended now, and wait for that.

        It goes on beating, so that no part trips for a silent supervisor while it is ended.
        """
        self.alive()
        self._standing_down.set()
        while self._thread.is_alive() and not self._stood_down.wait(POLL_S):
            pass

    @contextmanager
    def standing_down(self, end: Callable[[], None]) -> Iterator[None]:
        """Let the block close the parts, unwatched; then `end` them and the thread, in any case."""
        self.stand_down()
        try:
            yield
        finally:
            end()
            self.stop()

    def stop(self) -> None:
        """End the thread and wait for that; nobody watches the parts any more."""
        self._stopping.set()
        self._thread.join()
        self._tally.report_rest()

    def alive(self) -> None:
        """Record a sign of life of the supervisor's main thread, which must call this every 5 s."""
        self._alive_at = time.monotonic()

    @property
    def tripped(self) -> bool:
        """Whether loop, field process or supervisor has tripped."""
        return any(self._words[word] for word, _ in TRIPS.values())

    @property
    def made_safe(self) -> Mapping[str, int]:
        """Step of a trip -> when its devices confirmed it to this thread, by its own connections.

        Times are CLOCK_MONOTONIC in ns. A step is left out if one of its devices has not confirmed
        it to this thread.
        """
        times, found = dict(self._safe_since), {}
        for step, word in STEPS.items():
            names = [spec.name for spec in self._drivers if _confirmation_of(spec) == word]
            if names and times.keys() >= set(names):
                found[step] = max(times[name] for name in names)
        return found

    def trip(self, cause: Cause) -> None:
        """Trip in the name of the supervisor, unless the supervisor has tripped already."""
        trip(self._words, "supervisor", cause)

    def wait_until_safe(self, timeout_s: float = 2.0 * FIELD_WAIT_S) -> bool:
        """Wait, after a trip, until the thread has made safe what it can; return whether in time.

        A part that could not be made safe does not change the result. A thread that has stood down
        has nothing left to do.
        """
        until = time.monotonic() + timeout_s
        while not self._has_done_all(POLL_S) and time.monotonic() < until:
            self.alive()
        return self._has_done_all(0.0)

    def _has_done_all(self, wait_s: float) -> bool:
        return self._stood_down.is_set() or self._safe.wait(wait_s)

    def _run(self) -> None:
        while not self._stopping.wait(POLL_S):
            with self._survives:
                self._beat()
                if self._standing_down.is_set():
                    self._stood_down.set()
                    continue
                self._look()
                if self.tripped and not self._safe.is_set():
                    self._reserve.release()
                    self._make_safe()
                    self._kept_at = time.monotonic()
                    self._safe.set()
                elif self._kept and time.monotonic() - self._kept_at >= REPEAT_S:
                    self._keep_safe()
                    self._kept_at = time.monotonic()

    def _say(self, who: str, what: str) -> None:
        # An error of the report must not keep the thread from its work.
        with suppress(Exception):
            self._report(who, what)

    def _failed(self, line: str) -> None:
        """Trip after an error of this thread, as the rig must not move unwatched; report the error.

        The thread goes on, and makes the rig safe.
        """
        self.trip(Cause.CRASH)
        self._say("supervisor", line)

    def _beat(self) -> None:
        if time.monotonic() - self._alive_at < MAIN_SILENCE_S:
            self._words[Word.SUPERVISOR_BEAT] = time.monotonic_ns()

    def _look(self) -> None:
        if self.tripped:
            return
        for part, _, _, lost in self._watched:
            if part.ended:
                self._say(part.name, part.ended)
                self.trip(Cause.DISK_FULL if part.exit_code in FULL else lost)
                return
        for _, word, silence_s, lost in self._watched:
            if self._is_silent(word, silence_s):
                self.trip(lost)
                return

    def _is_silent(self, word: Word, silence_s: float) -> bool:
        # A part that has never beaten has not started yet.
        beat = int(self._words[word])
        return beat != 0 and time.monotonic_ns() - beat > silence_s * 1e9

    def _make_safe(self) -> None:
        """Ensure that valve, bypasses and pump are safe, in this order.

        The loop and the field process make them safe; for what they do not confirm in time, this
        thread does it by connections of its own.
        """
        if not self._confirmed((Word.VALVE_NULL_AT,), self._loop, Cause.LOOP_LOST, NULL_WAIT_S):
            self._by_own_connection("fast")
        words = (Word.BYPASS_SHUT_AT, Word.PUMP_UNLOADED_AT)
        if not self._confirmed(words, self._field, Cause.FIELD_LOST, FIELD_WAIT_S):
            self._by_own_connection("slow")

    def _confirmed(self, words: tuple[Word, ...], part: Child, lost: Cause, wait_s: float) -> bool:
        """Wait up to `wait_s` until a part has confirmed steps; return whether all are confirmed.

        The wait ends at once if the part has ended or counts as `lost`.
        """
        until = time.monotonic() + wait_s
        while not all(self._words[word] for word in words) and time.monotonic() < until:
            if part.ended or any(self._words[trip] == lost for trip, _ in TRIPS.values()):
                break
            self._beat()
            time.sleep(POLL_S)
        return all(bool(self._words[word]) for word in words)

    def _by_own_connection(self, kind: str) -> None:
        """Bring all devices of a `kind`, "fast" or "slow", that move something to their safe state.

        `_keep_safe` looks after them from then on.
        """
        drivers = [spec for spec in self._drivers if spec.kind == kind and spec.outputs]
        for spec in sorted(drivers, key=lambda spec: rank_of(spec.outputs)):
            self._kept[spec.name] = spec
            self._make_one_safe(spec, is_news=True)

    def _make_one_safe(self, spec: DriverSpec, is_news: bool) -> None:
        """Bring a device to its safe state by a new connection; raise no error if that fails.

        A failure is reported, unless the last attempt failed too. A success is reported if the last
        attempt failed, or if `is_news`.
        """
        self._beat()
        try:
            with closing(spec.create()) as driver:
                driver.safe_state()
        except Exception as error:  # after any error the next drivers must still be made safe
            if spec.name not in self._unsafe:
                why = str(error) if isinstance(error, DriverError) else failure(error)
                self._say(spec.name, f"not confirmed safe: {why}")
            self._unsafe.add(spec.name)
            self._safe_since.pop(spec.name, None)
            return
        self._safe_since.setdefault(spec.name, time.monotonic_ns())
        if is_news or spec.name in self._unsafe:
            self._say(spec.name, "made safe by the supervisor's own connection")
        self._unsafe.discard(spec.name)

    def _keep_safe(self) -> None:
        """Check the devices that this thread made safe itself, and make each of them safe again.

        Devices that another master has driven meanwhile are counted.
        """
        for spec in self._kept.values():
            if self._stopping.is_set():
                return
            if spec.name not in self._unsafe:
                for part, what in _found_driven(spec).items():
                    # An error of the report must not keep the device from being made safe.
                    with suppress(Exception):
                        self._tally.found(part, what)
            self._make_one_safe(spec, is_news=False)


def _confirmation_of(spec: DriverSpec) -> Word | None:
    """Return the word for the time at which a device is confirmed safe.

    It is None for a device of which no step of a trip waits for a confirmation.
    """
    if not spec.outputs:
        return None
    return Word.VALVE_NULL_AT if spec.kind == "fast" else confirmation_of(spec.outputs)


def _found_driven(spec: DriverSpec) -> dict[str, str]:
    """Return part -> state for each part of a device that another master drives.

    {} if nothing is driven, or the device cannot be read.
    """
    try:
        with closing(spec.create()) as driver:
            if isinstance(driver, FastDriver):
                driven = driver.driven()
                return {"valve": driven} if driven else {}
            driver.open()
            return departures(driver.read())
    except Exception:  # the caller makes a device safe even if it cannot be read
        return {}
