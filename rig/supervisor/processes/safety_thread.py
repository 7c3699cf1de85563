"""The safety thread beats for the supervisor, sees what fails, and stands in for dead parts.

A thread of the supervisor. Whatever trips, it sees to it that valve, bypasses and pump are safe: it
waits for the parts that are alive to confirm, and does by connections of its own what they do not,
again and again for as long as it lives.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from rig.io import DriverError, DriverSpec, FastDriver, LoopSettings
from rig.loop import FULL, Board, Cause, Word
from rig.surviving import Surviving, failure

from .child import Child
from .driven import REPEAT_S, Driven, Tally, departures
from .field import rank_of

POLL_S: Final = 0.01
MAIN_SILENCE_S: Final = 5.0
"""How long the supervisor's own work may take without a sign of life before it stops beating."""

NULL_WAIT_S: Final = 0.5
"""How long the loop may take to have the valve's null confirmed."""

FIELD_WAIT_S: Final = 10.0
"""How long the field process may take to have bypasses shut and pump unloaded confirmed."""

TRIPS: Final = {
    "loop": (Word.LOOP_TRIP, Word.LOOP_TRIP_AT),
    "field": (Word.FIELD_TRIP, Word.FIELD_TRIP_AT),
    "supervisor": (Word.SUPERVISOR_TRIP, Word.SUPERVISOR_TRIP_AT),
}

NS: Final = 1e9
Report = Callable[[str, str], None]


@dataclass(frozen=True)
class Parts:
    """The processes of a session."""

    loop: Child
    field: Child
    recorder: Child


class SafetyThread:
    """Watches the parts of a session, from `start` to `stop`.

    Args:
        board: shared by all of them.
        parts: the processes.
        settings: after how long a silence which part counts as lost.
        drivers: as configured, to make connections of its own.
        report: called with who and what, for the trip report; from the safety thread.
        found: called with what another master drives; from the safety thread.
    """

    def __init__(
        self,
        board: Board,
        parts: Parts,
        settings: LoopSettings,
        drivers: tuple[DriverSpec, ...],
        report: Report,
        found: Callable[[Driven], None] = lambda driven: None,
    ) -> None:
        self._words = board.words
        self._parts = parts
        self._settings = settings
        self._drivers = drivers
        self._report = report
        self._survives = Surviving("the safety thread", self._failed)
        self._tally = Tally("supervisor", found)
        self._kept: dict[str, DriverSpec] = {}
        self._unsafe: set[str] = set()
        self._kept_at = 0.0
        self._alive_at = time.monotonic()
        self._stopping = threading.Event()
        self._safe = threading.Event()
        self._thread = threading.Thread(target=self._run, name="safety", daemon=True)

    def start(self) -> None:
        """Begin to beat and to watch."""
        self._thread.start()

    def stop(self) -> None:
        """End; the parts are on their own from now on."""
        self._stopping.set()
        self._thread.join()
        self._tally.report_rest()

    def alive(self) -> None:
        """Show that the supervisor's main thread goes on."""
        self._alive_at = time.monotonic()

    @property
    def tripped(self) -> bool:
        """Whether anybody has tripped."""
        return any(self._words[word] for word, _ in TRIPS.values())

    def trip(self, cause: Cause) -> None:
        """Trip, in the supervisor's name."""
        if not self._words[Word.SUPERVISOR_TRIP]:
            self._words[Word.SUPERVISOR_TRIP_AT] = time.monotonic_ns()
            self._words[Word.SUPERVISOR_TRIP] = cause

    def wait_until_safe(self, timeout_s: float = 2.0 * FIELD_WAIT_S) -> bool:
        """Return whether, after a trip, everything that could be done was done in time."""
        until = time.monotonic() + timeout_s
        while not self._safe.wait(POLL_S) and time.monotonic() < until:
            self.alive()
        return self._safe.is_set()

    def _run(self) -> None:
        while not self._stopping.wait(POLL_S):
            with self._survives:
                self._beat()
                self._look()
                if self.tripped and not self._safe.is_set():
                    self._make_safe()
                    self._kept_at = time.monotonic()
                    self._safe.set()
                elif self._kept and time.monotonic() - self._kept_at >= REPEAT_S:
                    self._keep_safe()
                    self._kept_at = time.monotonic()

    def _say(self, who: str, what: str) -> None:
        # What cannot be reported to anybody is done all the same.
        with suppress(Exception):
            self._report(who, what)

    def _failed(self, line: str) -> None:
        """Trip: who cannot watch does not let the rig move; then go on, to make it safe."""
        self.trip(Cause.CRASH)
        self._say("supervisor", line)

    def _beat(self) -> None:
        if time.monotonic() - self._alive_at < MAIN_SILENCE_S:
            self._words[Word.SUPERVISOR_BEAT] = time.monotonic_ns()

    def _look(self) -> None:
        if self.tripped:
            return
        for part, lost in (
            (self._parts.loop, Cause.LOOP_LOST),
            (self._parts.field, Cause.FIELD_LOST),
            (self._parts.recorder, Cause.RECORDER_LOST),
        ):
            if part.ended:
                full = part.exit_code in FULL
                self._say(part.name, part.ended)
                self.trip(Cause.DISK_FULL if full else lost)
                return
        for word, silence_s, lost in self._silences:
            if self._is_silent(word, silence_s):
                self.trip(lost)
                return

    @property
    def _silences(self) -> tuple[tuple[Word, float, Cause], ...]:
        settings = self._settings
        return (
            (Word.LOOP_BEAT, settings.loop_silence, Cause.LOOP_LOST),
            (Word.FIELD_BEAT, settings.field_silence, Cause.FIELD_LOST),
            (Word.RECORDER_BEAT, settings.recorder_silence, Cause.RECORDER_LOST),
        )

    def _is_silent(self, word: Word, silence_s: float) -> bool:
        # A part that never beat is not yet there.
        beat = int(self._words[word])
        return beat != 0 and time.monotonic_ns() - beat > silence_s * NS

    def _make_safe(self) -> None:
        """See to it that valve, bypasses and pump are safe, in this order, by whoever is left."""
        loop, field = self._parts.loop, self._parts.field
        if not self._confirmed((Word.VALVE_NULL_AT,), loop, Cause.LOOP_LOST, NULL_WAIT_S):
            fast = [spec for spec in self._drivers if spec.kind == "fast"]
            self._by_own_connection(fast)
        words = (Word.BYPASS_SHUT_AT, Word.PUMP_UNLOADED_AT)
        if not self._confirmed(words, field, Cause.FIELD_LOST, FIELD_WAIT_S):
            slow = [spec for spec in self._drivers if spec.kind == "slow"]
            self._by_own_connection(sorted(slow, key=lambda spec: rank_of(spec.outputs)))

    def _confirmed(self, words: tuple[Word, ...], part: Child, lost: Cause, wait_s: float) -> bool:
        """Wait for a part to confirm steps, unless it is lost; return whether it did."""
        until = time.monotonic() + wait_s
        while not all(self._words[word] for word in words) and time.monotonic() < until:
            if part.ended or any(self._words[trip] == lost for trip, _ in TRIPS.values()):
                break
            self._beat()
            time.sleep(POLL_S)
        return all(bool(self._words[word]) for word in words)

    def _by_own_connection(self, drivers: list[DriverSpec]) -> None:
        for spec in drivers:
            if not spec.outputs:
                continue
            self._kept[spec.name] = spec
            if self._is_made_safe(spec):
                self._say(spec.name, "made safe by the supervisor's own connection")

    def _is_made_safe(self, spec: DriverSpec) -> bool:
        """Bring a device to its safe state; report why it is not, unless it was not before."""
        self._beat()
        try:
            driver = spec.create()
            try:
                driver.safe_state()
            finally:
                driver.close()
        except Exception as error:  # whatever it is, the drivers after this one are made safe
            if spec.name not in self._unsafe:
                why = str(error) if isinstance(error, DriverError) else failure(error)
                self._say(spec.name, f"not confirmed safe: {why}")
            self._unsafe.add(spec.name)
            return False
        return True

    def _keep_safe(self) -> None:
        """Look at what was made safe by connections of this thread's own, and make it so again."""
        for spec in self._kept.values():
            if self._stopping.is_set():
                return
            if spec.name not in self._unsafe:
                for part, what in _found_driven(spec).items():
                    # What cannot be reported to anybody is made safe again all the same.
                    with suppress(Exception):
                        self._tally.found(part, what)
            if self._is_made_safe(spec) and spec.name in self._unsafe:
                self._unsafe.remove(spec.name)
                self._say(spec.name, "made safe by the supervisor's own connection")


def _found_driven(spec: DriverSpec) -> dict[str, str]:
    """Return what of a device is driven, by the part; nothing if the device does not report it."""
    try:
        driver = spec.create()
        try:
            if isinstance(driver, FastDriver):
                driven = driver.driven()
                return {"valve": driven} if driven else {}
            driver.open()
            return departures(driver.read())
        finally:
            driver.close()
    except Exception:  # what cannot be read is made safe all the same
        return {}


def trips_of(board: Board) -> Mapping[str, tuple[Cause, int]]:
    """Return who tripped, why, and when (CLOCK_MONOTONIC in ns)."""
    return {
        who: (Cause(int(board.words[word])), int(board.words[at]))
        for who, (word, at) in TRIPS.items()
        if board.words[word]
    }
