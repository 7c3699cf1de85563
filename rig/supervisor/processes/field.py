"""The field process: serves the slow drivers, makes the scheduled moves, shuts the bypasses.

It publishes what they read on the board, and trips if a driver that moves something fails. On
anybody's trip, or a silence of loop or supervisor, it brings its drivers to their safe state in the
order of a trip: valve drive, bypass valves, pump. It keeps them there: whatever leaves that state
is reported as driven by another master, and brought back.
"""

import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import nan
from multiprocessing.connection import Connection
from typing import Final

from rig.io import BALLS, NEEDLES, SLOW_INPUTS, Driver, DriverError, DriverSpec, LoopSettings
from rig.loop import Board, Cause, Word

from .child import News, child_ends, obeyed_next
from .driven import Tally, departures

CYCLE_S: Final = 0.01
"""Time between two looks at moves, orders and drivers; each driver is asked at its own rate."""

_NULL_FIRST_S: Final = 0.2
"""How long a trip waits for the valve's null before the bypasses are shut all the same."""

_REPEAT_S: Final = 1.0
"""Time between two complaints of the same driver, and between two attempts to make it safe."""

Outputs = Mapping[str, float]


@dataclass(frozen=True)
class OpenField:
    """Open the drivers; the answer is a tuple of their names, or the `DriverError`."""

    drivers: tuple[DriverSpec, ...]
    settings: LoopSettings


@dataclass(frozen=True)
class WriteOutputs:
    """Set outputs now; no answer: the board shows what comes of it."""

    outputs: Outputs


@dataclass(frozen=True)
class FollowMoves:
    """Outputs to set at ticks of a segment, in order; replaces what was scheduled before."""

    segment: int
    moves: tuple[tuple[int, Outputs], ...]


@dataclass(frozen=True)
class MakeSafe:
    """Bring every driver to its safe state; the answer is a `Safety`."""


@dataclass(frozen=True)
class Safety:
    """What came of a safe state: what each driver could not do, by its name."""

    failures: Mapping[str, str] = field(default_factory=dict)


@dataclass
class _Served:
    driver: Driver
    due: float = 0.0
    complained_at: float = -_REPEAT_S
    failure: str = ""
    """Why it is not in the safe state that it is meant to be in; empty if it is, or need not be."""
    tried_at: float = 0.0


class FieldProcess:
    """Serves the drivers of one session; see the module."""

    def __init__(self, board: Board, pipe: Connection) -> None:
        self._board = board
        self._words = board.words
        self._pipe = pipe
        self._served: list[_Served] = []
        self._settings = LoopSettings()
        self._moves: list[tuple[int, Outputs]] = []
        self._moves_segment = -1
        self._safe = False
        self._tally = Tally("field", self._report)

    def run(self) -> None:
        """Serve until the pipe is closed; leave everything safe."""
        try:
            while obeyed_next(self._pipe, CYCLE_S, self._obey):
                self.cycle()
        finally:
            self._tally.report_rest()
            self._make_safe()
            for served in self._served:
                served.driver.close()

    def cycle(self) -> None:
        """Make the moves that are due, and ask every driver that is due."""
        now = time.monotonic()
        if not self._safe:
            self._make_moves()
            if self._must_be_safe():
                self._make_safe()
        for served in self._served:
            if self._safe and served.failure:
                if now - served.tried_at >= _REPEAT_S:
                    self._bring_to_safe_state(served)
            elif now >= served.due:
                served.due = now + 1.0 / served.driver.rate_hz
                self._read(served, now)
        self._words[Word.FIELD_BEAT] = time.monotonic_ns()

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
        self._pipe.send(tuple(spec.name for spec in order.drivers))

    def _make_moves(self) -> None:
        if self._words[Word.SEGMENT] != self._moves_segment:
            return
        while self._moves and self._words[Word.TICK] >= self._moves[0][0]:
            self._write(self._moves.pop(0)[1])

    def _write(self, outputs: Outputs) -> None:
        for served in self._served:
            mine = {name: value for name, value in outputs.items() if name in served.driver.outputs}
            if not mine:
                continue
            self._safe, served.failure = False, ""
            word = _CONFIRMED.get(rank_of(served.driver.outputs))
            if word is not None:
                # What was confirmed before it moved says nothing of where it is afterwards.
                self._words[word] = 0
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
                # From here, only a new connection brings it to its safe state.
                served.failure, served.tried_at = str(error), now
        self._publish(values)
        found = departures(values) if self._safe else {}
        for part, what in found.items():
            self._tally.found(part, what)
        if found:
            self._bring_to_safe_state(served)

    def _bring_to_safe_state(self, served: _Served) -> None:
        """Make a driver safe, and confirm that; why it is not safe is its `failure`, reported once.

        A driver that failed is tried again from time to time, for as long as this process lives.
        """
        failed_before = bool(served.failure)
        try:
            served.driver.safe_state()
        except DriverError as error:
            served.failure, served.tried_at = str(error), time.monotonic()
            if not failed_before:
                self._complain(served, error)
            return
        served.failure = ""
        if failed_before:
            self._report(News(time.monotonic_ns(), served.driver.name, "is in its safe state now"))
        word = _CONFIRMED.get(rank_of(served.driver.outputs))
        if word is not None and not self._words[word]:
            # Once more confirms nothing anew: it has been so since the first.
            self._words[word] = time.monotonic_ns()

    def _publish(self, values: Mapping[str, float]) -> None:
        at = time.monotonic_ns()
        for name, value in values.items():
            index = SLOW_INPUTS.index(name)
            self._board.slow[index] = value
            self._board.slow_at[index] = at

    def _complain(self, served: _Served, error: DriverError) -> None:
        """Report to the supervisor; trip if the driver moves something."""
        moves = bool(served.driver.outputs)
        if moves and not self._words[Word.FIELD_TRIP]:
            self._trip(_cause_of(served.driver, error))
        self._report_error(served, error)

    def _report_error(self, served: _Served, error: DriverError) -> None:
        what = f"{error.channel}: {error.state}" if error.channel else error.state
        self._report(News(time.monotonic_ns(), served.driver.name, f"{what}; {error.action}"))

    def _trip(self, cause: Cause) -> None:
        self._words[Word.FIELD_TRIP_AT] = time.monotonic_ns()
        self._words[Word.FIELD_TRIP] = cause

    def _must_be_safe(self) -> bool:
        words, settings, now = self._words, self._settings, time.monotonic_ns()
        tripped = (Word.LOOP_TRIP, Word.FIELD_TRIP, Word.SUPERVISOR_TRIP)
        if any(words[word] for word in tripped):
            return True
        for word, silence_s, cause in (
            (Word.LOOP_BEAT, settings.loop_silence, Cause.LOOP_LOST),
            (Word.SUPERVISOR_BEAT, settings.supervisor_silence, Cause.SUPERVISOR_LOST),
        ):
            # A part that never beat is not yet there.
            if words[word] and now - words[word] > silence_s * 1e9:
                self._trip(cause)
                return True
        return False

    def _make_safe(self) -> Safety:
        """Bring the drivers to their safe state in the order of a trip."""
        self._safe = True
        self._moves = []
        self._wait_for_null()
        for served in sorted(self._served, key=lambda served: rank_of(served.driver.outputs)):
            if served.failure and time.monotonic() - served.tried_at < _REPEAT_S:
                continue
            self._bring_to_safe_state(served)
            if not served.failure:
                try:
                    # Whoever asked for it may end soon: the board shows the safe state before.
                    self._publish(served.driver.read())
                except DriverError as error:
                    # It may be raised once only, and say why the rig had to be made safe.
                    self._report_error(served, error)
            self._words[Word.FIELD_BEAT] = time.monotonic_ns()
        return Safety(
            {served.driver.name: served.failure for served in self._served if served.failure}
        )

    def _wait_for_null(self) -> None:
        if not self._words[Word.LOOP_TRIP] and not self._words[Word.SUPERVISOR_TRIP]:
            return
        until = time.monotonic() + _NULL_FIRST_S
        while not self._words[Word.VALVE_NULL_AT] and time.monotonic() < until:
            time.sleep(1e-3)

    def _report(self, message: object) -> None:
        # Without a supervisor there is nobody to report to; what it would have done is done here.
        with suppress(OSError):
            self._pipe.send(message)


_DRIVE_RANK, _BYPASS_RANK, _PUMP_RANK, _OTHER_RANK = range(4)
_CONFIRMED: Final = {_BYPASS_RANK: Word.BYPASS_SHUT_AT, _PUMP_RANK: Word.PUMP_UNLOADED_AT}


def rank_of(outputs: Iterable[str]) -> int:
    """Return the place of a driver with these outputs in the order of a trip."""
    moved = set(outputs)
    if "drive_target" in moved:
        return _DRIVE_RANK
    if moved & {*BALLS, *NEEDLES}:
        return _BYPASS_RANK
    return _PUMP_RANK if "pump_load" in moved else _OTHER_RANK


_CAUSES: Final = {
    _DRIVE_RANK: (Cause.DRIVE_LOST, Cause.DRIVE_FAULT),
    _BYPASS_RANK: (Cause.BYPASS_LOST, Cause.BYPASS_STUCK),
    _PUMP_RANK: (Cause.PUMP_LOST, Cause.PUMP_FAULT),
    _OTHER_RANK: (Cause.FIELD_LOST, Cause.FIELD_LOST),
}


def _cause_of(driver: Driver, error: DriverError) -> Cause:
    """Return whether the driver is lost, or a channel of it does not do what it should."""
    # What a device refuses by another name, such as a register, is no fault of a valve.
    channels = {*driver.inputs, *driver.outputs}
    return _CAUSES[rank_of(driver.outputs)][not channels.isdisjoint(error.channel.split(", "))]


def main() -> None:
    """Run as the field process of a session."""
    board, pipe = child_ends()
    FieldProcess(board, pipe).run()
