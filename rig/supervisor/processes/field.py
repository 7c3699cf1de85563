"""The field process serves the slow drivers, makes the scheduled moves, and shuts the bypasses.

It writes the drivers' readings to the board, and trips if a driver that moves something fails. When
any part has tripped, or loop or supervisor is silent, it brings its drivers to their safe state in
the order of a trip: valve drive, bypass valves, pump. It keeps them there: a part that leaves its
safe state is reported as driven by another master, and brought back.

The process may be stopped at any instruction and go on seconds later, when others have tripped and
made its drivers safe. So it looks at the board before every single driver that it reads or writes,
since reading may repeat the driver's command, and it trips by itself if its own beat is too old.
"""

import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from math import nan
from multiprocessing.connection import Connection
from typing import Final

from rig.channels import BLOCKING
from rig.io import (
    BALLS,
    NEEDLES,
    SLOW_INPUTS,
    Driver,
    DriverError,
    DriverSpec,
    LoopSettings,
    TransducerCalibration,
)
from rig.loop import Board, Cause, Word
from rig.surviving import start

from .child import News, child_ends, obeyed_next, run_to_end
from .driven import Tally, departures
from .health import trip

CYCLE_S: Final = 0.01
"""Period in s at which moves, orders and drivers are looked after; drivers have their own rates."""

_TRIPS: Final = (Word.LOOP_TRIP, Word.FIELD_TRIP, Word.SUPERVISOR_TRIP)
_NULL_FIRST_S: Final = 0.2
"""Time in s for which a trip waits for the valve's null; then the bypasses are shut in any case."""

_AWAITED_S: Final = 10.0
"""Longest time in s for which this process counts as alive while a driver makes its device safe.

A bypass valve is given the time of its slowest move, 3 s unless the rig file says otherwise, which
is longer than the silence after which this process counts as lost. The supervisor waits as long for
the field process after a trip (`FIELD_WAIT_S`).
"""
_AWAITED_BEAT_S: Final = 0.02
"""Period in s of the beats in this time: a fraction of any silence that is allowed."""

_REPEAT_S: Final = 1.0
"""Time in s between two reports on the same driver, and between two attempts to make it safe."""

Outputs = Mapping[str, float]


@dataclass(frozen=True)
class OpenField:
    """The order to open the slow drivers; the answer is a tuple of their names.

    If one of them cannot be opened, the answer is its `DriverError`.

    Attributes:
        drivers: the slow drivers.
        settings: settings of the loop, with the silences after which a part counts as lost.
        calibrations: calibrations of the transducers, by which readings are corrected.
    """

    drivers: tuple[DriverSpec, ...]
    settings: LoopSettings
    calibrations: tuple[TransducerCalibration, ...] = ()


@dataclass(frozen=True)
class WriteOutputs:
    """The order to set slow outputs, name -> SI value; no answer, but the board shows feedback."""

    outputs: Outputs


@dataclass(frozen=True)
class FollowMoves:
    """The order to set slow outputs at ticks of a segment; there is no answer.

    It replaces all moves that were ordered earlier. The moves are made while the loop runs that
    segment; a trip or `MakeSafe` drops those that are left.

    Attributes:
        segment: number of the segment.
        moves: pairs of a tick of the segment and outputs (name -> SI value), in order of the ticks.
    """

    segment: int
    moves: tuple[tuple[int, Outputs], ...]


@dataclass(frozen=True)
class MakeSafe:
    """The order to bring every driver to its safe state and keep it there.

    The answer is a dict: driver -> why it is not in its safe state; empty if all are.
    """


@dataclass
class _Served:
    driver: Driver
    due: float = 0.0
    complained_at: float = -_REPEAT_S
    failure: str = ""
    """Why the driver is not in its safe state although it should be; else empty."""
    tried_at: float = 0.0

    @cached_property
    def rank(self) -> int:
        """The driver's place in the order of a trip; see `rank_of`."""
        return rank_of(self.driver.outputs)


class FieldProcess:
    """What works inside the field process of a session; `run` does it.

    It obeys the orders that come on the supervisor's pipe, and serves the slow drivers that
    `OpenField` names. After a trip it brings them to their safe state and keeps them there.

    Args:
        board: the board, to which it writes readings, its trip, confirmations and its beat.
        pipe: this process's end of the pipe to the supervisor.
    """

    def __init__(self, board: Board, pipe: Connection) -> None:
        self._board = board
        self._words = board.words
        self._pipe = pipe
        self._served: list[_Served] = []
        self._settings = LoopSettings()
        self._calibrations: dict[str, TransducerCalibration] = {}
        self._moves: list[tuple[int, Outputs]] = []
        self._moves_segment = -1
        self._safe = False
        self._tally = Tally("field", self._report)

    def run(self) -> None:
        """Serve until the pipe is closed; then bring drivers to their safe state and close them."""
        try:
            while obeyed_next(self._pipe, CYCLE_S, self._obey):
                self.cycle()
        finally:
            self._tally.report_rest()
            self._make_safe()
            for served in self._served:
                served.driver.close()

    def cycle(self) -> None:
        """Make the moves that are due, and read every driver that is due; `run` repeats this.

        If a part has tripped or is silent, it brings the drivers to their safe state. From then on
        it makes no moves; drivers that are driven or unsafe are brought back to their safe state.
        """
        now = time.monotonic()
        if not self._safe:
            self._make_moves()
        self._look()
        for served in self._served:
            # The driver before may have taken long, and reading this one may repeat its command.
            self._look()
            if self._safe and served.failure:
                if now - served.tried_at >= _REPEAT_S:
                    self._bring_to_safe_state(served)
            elif now >= served.due:
                served.due = now + 1.0 / served.driver.rate_hz
                self._read(served, now)
        self._words[Word.FIELD_BEAT] = time.monotonic_ns()

    def _look(self) -> None:
        """Bring the drivers to their safe state if they must be there, unless that was done."""
        if not self._safe and self._must_be_safe():
            self._make_safe()

    def _obey(self, order: object) -> None:
        if isinstance(order, OpenField):
            self._open(order)
        elif isinstance(order, WriteOutputs):
            self._write(order.outputs)
        elif isinstance(order, FollowMoves):
            self._moves_segment, self._moves = order.segment, list(order.moves)
        elif isinstance(order, MakeSafe):
            self._pipe.send(self._make_safe())

    def _open(self, order: OpenField) -> None:
        self._settings = order.settings
        self._calibrations = {each.channel: each for each in order.calibrations}
        try:
            for spec in order.drivers:
                driver = spec.create()
                try:
                    driver.open()
                except DriverError:
                    driver.close()
                    raise
                self._served.append(_Served(driver))
        except DriverError as error:
            self._pipe.send(error)
            return
        # Opening may take longer than the silence that is allowed once the drivers are served.
        self._words[Word.FIELD_BEAT] = time.monotonic_ns()
        self._pipe.send(tuple(spec.name for spec in order.drivers))

    def _make_moves(self) -> None:
        if self._words[Word.SEGMENT] != self._moves_segment:
            return
        while self._moves and self._words[Word.TICK] >= self._moves[0][0]:
            self._write(self._moves.pop(0)[1])

    def _write(self, outputs: Outputs) -> None:
        """Write outputs to their drivers; drop those that are left once a trip stands.

        `cycle` then brings all drivers to their safe state.
        """
        for served in self._served:
            mine = {name: value for name, value in outputs.items() if name in served.driver.outputs}
            if not mine:
                continue
            if self._must_be_safe():
                return
            self._safe, served.failure = False, ""
            if served.rank in _CONFIRMED:
                # The confirmation of the safe state is void once the driver moves again.
                self._words[_CONFIRMED[served.rank]] = 0
            try:
                served.driver.write(mine)
            except DriverError as error:
                self._complain(served, error)

    def _read(self, served: _Served, now: float) -> None:
        try:
            values = served.driver.read()
        except DriverError as error:
            values = dict.fromkeys(served.driver.inputs, nan)
            if now - served.complained_at >= _REPEAT_S:
                served.complained_at = now
                self._complain(served, error)
            if self._safe and served.driver.outputs:
                # After a failed read, only a new connection can bring it to its safe state.
                served.failure, served.tried_at = str(error), now
        self._publish(values)
        found = departures(values) if self._safe else {}
        for part, what in found.items():
            self._tally.found(part, what)
        if found:
            self._bring_to_safe_state(served)

    def _bring_to_safe_state(self, served: _Served) -> None:
        """Bring a driver to its safe state once; for bypasses and pump, confirm that on the board.

        If it fails, the reason becomes the driver's `failure`, for which `cycle` tries again every
        second. The first failure in a row is reported, and trips if the driver has outputs.
        """
        failed_before = bool(served.failure)
        try:
            with self._alive_meanwhile():
                served.driver.safe_state()
        except DriverError as error:
            served.failure, served.tried_at = str(error), time.monotonic()
            if not failed_before:
                self._complain(served, error)
            return
        served.failure = ""
        if failed_before:
            self._report(News(time.monotonic_ns(), served.driver.name, "is in its safe state now"))
        word = _CONFIRMED.get(served.rank)
        if word is not None and not self._words[word]:
            # Only the first confirmation counts: the part has been safe since then.
            self._words[word] = time.monotonic_ns()

    @contextmanager
    def _alive_meanwhile(self) -> Iterator[None]:
        """Beat while the block waits for a device, for `_AWAITED_S` at most.

        So a device that does not answer is what the driver calls it, and this process is not taken
        for the one that is lost. It is if it is stopped. Where the system grants no thread for the
        beats, the block goes on without.
        """
        done = threading.Event()
        beats = threading.Thread(target=self._beat_until, args=(done,), name="beats", daemon=True)
        with suppress(OSError):
            start(beats)
        try:
            yield
        finally:
            done.set()
            if beats.is_alive():
                beats.join()

    def _beat_until(self, done: threading.Event) -> None:
        until = time.monotonic() + _AWAITED_S
        while not done.wait(_AWAITED_BEAT_S) and time.monotonic() < until:
            self._words[Word.FIELD_BEAT] = time.monotonic_ns()

    def _publish(self, values: Mapping[str, float]) -> None:
        at = time.monotonic_ns()
        for name, value in values.items():
            index = SLOW_INPUTS.index(name)
            calibration = self._calibrations.get(name)
            indicated = value if calibration is None else calibration.corrected(value)
            self._board.slow[index] = indicated
            self._board.slow_at[index] = at

    def _complain(self, served: _Served, error: DriverError) -> None:
        """Report a driver's error to the supervisor; trip if the driver has outputs."""
        if served.driver.outputs:
            # An error may name something else, such as a register, which is no fault of a valve.
            channels = {*served.driver.inputs, *served.driver.outputs}
            faulty = channels.intersection(error.channel.split(", "))
            cause = _CAUSES[served.rank][bool(faulty)]
            if faulty and faulty <= set(BLOCKING):
                cause = Cause.BLOCKING_STUCK
            trip(self._words, "field", cause)
        self._report_error(served, error)

    def _report_error(self, served: _Served, error: DriverError) -> None:
        what = f"{error.channel}: {error.state}" if error.channel else error.state
        self._report(News(time.monotonic_ns(), served.driver.name, f"{what}; {error.action}"))

    def _must_be_safe(self) -> bool:
        """Return whether a part has tripped or is silent; trip if one is silent.

        This process counts as silent too, if its own last beat is older than `field_silence`: it
        was stopped then, and the supervisor trips and makes its drivers safe after the same time.
        """
        words, settings, now = self._words, self._settings, time.monotonic_ns()
        if any(words[word] for word in _TRIPS):
            return True
        for word, silence_s, cause in (
            (Word.LOOP_BEAT, settings.loop_silence, Cause.LOOP_LOST),
            (Word.SUPERVISOR_BEAT, settings.supervisor_silence, Cause.SUPERVISOR_LOST),
            (Word.FIELD_BEAT, settings.field_silence, Cause.FIELD_LOST),
        ):
            # A part that has never beaten has not started yet.
            if words[word] and now - words[word] > silence_s * 1e9:
                trip(self._words, "field", cause)
                return True
        return False

    def _make_safe(self) -> dict[str, str]:
        """Bring the drivers to their safe state in the order of a trip, and drop all moves.

        Return driver -> failure for the drivers that are not safe. A driver that failed less than a
        second ago is not tried again.
        """
        self._safe = True
        self._moves = []
        self._wait_for_null()
        for served in sorted(self._served, key=lambda served: served.rank):
            if served.failure and time.monotonic() - served.tried_at < _REPEAT_S:
                continue
            self._bring_to_safe_state(served)
            if not served.failure:
                try:
                    # The session may end soon, so the safe state is written to the board now.
                    self._publish(served.driver.read())
                except DriverError as error:
                    # A driver may raise this only once, and it may be the reason of the trip.
                    self._report_error(served, error)
            self._words[Word.FIELD_BEAT] = time.monotonic_ns()
        return {served.driver.name: served.failure for served in self._served if served.failure}

    def _wait_for_null(self) -> None:
        # The loop takes over also the trip of this process, with its next tick.
        if not any(self._words[word] for word in _TRIPS):
            return
        until = time.monotonic() + _NULL_FIRST_S
        while not self._words[Word.VALVE_NULL_AT] and time.monotonic() < until:
            time.sleep(1e-3)

    def _report(self, message: object) -> None:
        # If the supervisor is gone nobody takes the report, and the process goes on without.
        with suppress(OSError):
            self._pipe.send(message)


_DRIVE_RANK, _BYPASS_RANK, _PUMP_RANK, _OTHER_RANK = range(4)
_CONFIRMED: Final = {_BYPASS_RANK: Word.BYPASS_SHUT_AT, _PUMP_RANK: Word.PUMP_UNLOADED_AT}


def rank_of(outputs: Iterable[str]) -> int:
    """Return the place, from 0, that a driver with these outputs has in the order of a trip.

    The order is: valve drive, bypass valves, pump, drivers without any of these.
    """
    moved = set(outputs)
    if "drive_target" in moved:
        return _DRIVE_RANK
    if moved & {*BALLS, *NEEDLES}:
        return _BYPASS_RANK
    return _PUMP_RANK if "pump_load" in moved else _OTHER_RANK


def confirmation_of(outputs: Iterable[str]) -> Word | None:
    """Return the word for the time at which a slow driver with these outputs is confirmed safe.

    It is None for a driver of which no step of a trip waits for a confirmation.
    """
    return _CONFIRMED.get(rank_of(outputs))


_CAUSES: Final = {
    _DRIVE_RANK: (Cause.DRIVE_LOST, Cause.DRIVE_FAULT),
    _BYPASS_RANK: (Cause.BYPASS_LOST, Cause.BYPASS_STUCK),
    _PUMP_RANK: (Cause.PUMP_LOST, Cause.PUMP_FAULT),
    _OTHER_RANK: (Cause.FIELD_LOST, Cause.FIELD_LOST),
}
"""The causes of a trip by rank: for a driver that is lost, and for a channel that is faulty."""


def main() -> None:
    """Run this process as the field process of a session, until the supervisor closes the pipe."""
    run_to_end("field", lambda: FieldProcess(*child_ends()).run())
