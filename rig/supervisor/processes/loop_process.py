"""The loop process owns the fast driver, and runs segments on it in a thread of its own.

The thread is almost always in one compiled function (`rig.loop.wire.cycle`), without the
interpreter's lock; the main thread receives orders and signals. However the process ends (by an
order, SIGTERM, the supervisor's end, a trip that was not confirmed, a crash), it brings the device
to its safe state.
"""

import contextlib
import signal
import threading
import time
import traceback
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Final

import numpy as np

from estimator.filters import compiled_filter
from rig.compile_cache import telling_of_compiling
from rig.io import DriverError, FastDriver, corrections_of
from rig.loop import (
    FULL,
    Board,
    Cause,
    ChangeControl,
    Close,
    Closed,
    Count,
    Course,
    Found,
    Grant,
    Integers,
    Interlock,
    Left,
    Open,
    Opened,
    Pace,
    RealTime,
    Segment,
    SetAhead,
    TripError,
    Word,
    changed_course,
    control_in,
    course,
    interlock,
    limit_table,
    locked_tolerances,
    pace,
    passed_on,
    prepared,
    set_ahead,
    wire_memory,
    wire_ticks,
    with_limits,
)
from rig.surviving import start

from .child import Compiling, News, child_ends, run_to_end
from .driven import Tally
from .health import trip

_POLL_S: Final = 0.05
"""Period in s at which the main thread looks for signals and for the end of the loop's thread."""

_REPEAT_S: Final = 1.0
"""Time in s between two attempts to reach a device that did not confirm its safe state."""

_LOOK_S: Final = 0.1
"""Time in s between two checks, by connections of their own, of a valve that the loop has left."""

_LEFT: Final = (
    "the loop has left its connection, which did not confirm that the valve is at null; "
    "end this session and start another"
)
"""The answer to orders after the loop has ended by itself."""

_NEVER: Final = -1
"""Number of a segment that is never switched to: the loop returns from it at once."""


class LoopProcess:
    """What works inside the loop process of a session; `run` does it.

    It obeys the orders that come on the supervisor's pipe (`rig.loop.wire.orders`), and runs
    segments on the fast driver in a thread of its own.

    Args:
        board: the board, to which it writes the rows and the loop's words.
        pipe: this process's end of the pipe to the supervisor.
    """

    def __init__(self, board: Board, pipe: Connection) -> None:
        self._board = board
        self._words = board.words
        self._pipe = pipe
        self._driver: FastDriver
        self._is_open = False
        self._pace: Pace
        self._interlock: Interlock
        self._memory = wire_memory()
        self._offset_m = 0.0
        self._segments: dict[int, Segment] = {}
        self._changes: dict[int, ChangeControl] = {}
        self._laid_out = np.empty(0), np.empty(0)
        self._thread: threading.Thread | None = None
        self._running = threading.Event()
        self._grants: tuple[Grant, ...] = ()
        self._terminated = False
        self._tally = Tally("loop", self._send)
        self._nulled_at = -_REPEAT_S

    def run(self) -> None:
        """Obey the orders on the pipe until the session ends, then leave the device safe.

        The session ends when a `Close` comes, when the supervisor is gone, after `terminate`, or by
        an exception. A loop thread that ends by itself does not end it: the valve is then held at
        null. At the end the loop is stopped, the driver is put into its safe state and closed, and
        the supervisor is sent `Closed`, which says why the safe state was not confirmed.
        """
        cause = Cause.CRASH
        try:
            cause = self._serve()
        except OSError as error:
            # What the system refuses is no failure of the software; the log has what it was.
            cause = Cause.DISK_FULL if error.errno in FULL else Cause.LOOP_LOST
            raise
        finally:
            failure = self._end(cause)
            with contextlib.suppress(OSError):
                self._pipe.send(Closed(failure))

    def terminate(self) -> None:
        """Make `run` end soon, with the device in its safe state; signal handlers may call this."""
        self._terminated = True

    def _serve(self) -> Cause:
        """Obey orders until the session ends; return the cause of that, NONE after a `Close`."""
        for order in self._orders():
            if isinstance(order, Open):
                self._open(order)
            elif isinstance(order, Segment):
                self._segments[order.number] = order
                self._pipe.send(order.number)
            elif isinstance(order, ChangeControl):
                self._changes[order.number] = prepared(order)
                self._pipe.send(order.number)
            elif isinstance(order, SetAhead):
                self._pipe.send(set_ahead(order, *self._laid_out, self._words))
            self._tend_null()
            if self._thread is not None and not self._thread.is_alive():
                return self._rescue()
        return self._ended_by

    def _orders(self) -> Iterator[object]:
        """Yield the orders that come, and None where none came for `_POLL_S`.

        The iteration ends with a `Close`, with the supervisor, or after `terminate`; `_ended_by`
        is then the cause, NONE for a `Close`.
        """
        self._ended_by = Cause.OPERATOR_STOP
        while not self._terminated:
            try:
                order = self._pipe.recv() if self._pipe.poll(_POLL_S) else None
            except (EOFError, ConnectionError):
                self._ended_by = Cause.SUPERVISOR_LOST
                return
            if isinstance(order, Close):
                self._ended_by = Cause.NONE
                return
            yield order

    def _open(self, order: Open) -> None:
        driver = order.driver.create_fast()
        try:
            driver.open()
        except DriverError as error:
            driver.close()
            self._pipe.send(error)
            return
        self._driver, self._is_open = driver, True
        self._pace = pace(order.settings, driver.rate_hz)
        judging = interlock(order.limits, order.tolerances)
        self._interlock = judging._replace(log=self._board.passing_log)
        corrections = corrections_of(order.calibrations, order.wiring)
        self._memory = self._memory._replace(corrections=corrections)
        self._segments[order.first.number] = order.first
        # This compiles or loads the loop's function before its time matters.
        with telling_of_compiling(self._compiles, lambda: self._send(Compiling(""))):
            self._run_segment(_NEVER, order.first)
        arguments = (order.settings.cpu, order.settings.priority)
        thread = threading.Thread(target=self._loop, args=arguments, name="loop")
        # The way out waits for a thread that was started only, and makes the device safe after it.
        try:
            start(thread)
        except OSError as error:
            self._pipe.send(error)
            return
        self._thread = thread
        self._running.wait()
        self._pipe.send(Opened(self._grants, driver.rate_hz))

    def _loop(self, cpu: int | None, priority: int) -> None:
        """Run one segment after another, as the supervisor switches to them; the loop's thread."""
        try:
            with RealTime(cpu, priority) as real_time:
                self._grants = real_time.grants
                self._running.set()
                left = Left.SWITCHED
                while left == Left.SWITCHED:
                    number = int(self._words[Word.SWITCH])
                    left = self._run_segment(number, self._segments.pop(number))
        except Exception:
            self._report(traceback.format_exc())
        finally:
            self._running.set()

    def _run_segment(self, number: int, segment: Segment) -> Left:
        if segment.reset:
            self._interlock.memory.clear()
            self._memory.found[:] = 0
            for word in (Word.LOOP_TRIP, Word.LOOP_TRIP_AT, Word.VALVE_NULL_AT, Word.ACTION,
                         Word.ACTION_CAUSE):  # fmt: skip
                self._words[word] = 0
        elif segment.offset_m != self._offset_m and not self._words[Word.LOOP_TRIP]:
            # A new offset makes the position jump, which the interlock must not take for a fault.
            self._interlock.memory.clear()
        self._offset_m = segment.offset_m
        if segment.homed is not None:
            self._words[Word.HOMED] = segment.homed
        period_s = 1e-9 * self._pace.period_ns
        judging = with_limits(self._interlock, limit_table(segment.limits, period_s))
        if segment.locked:
            judging = judging._replace(tolerances=locked_tolerances(judging.tolerances))
        planned = course(replace(segment, number=number))
        planned = planned._replace(change=int(self._words[Word.CHANGE]))
        self._laid_out = planned.setpoint, planned.feedforward
        earlier, filt = control_in(planned), compiled_filter(segment.memory, segment.assumed)
        while True:
            left = Left(
                wire_ticks(
                    planned,
                    earlier,
                    filt,
                    judging,
                    self._pace,
                    self._driver.fileno(),
                    self._driver.plan(),
                    self._driver.look_plan(),
                    self._memory,
                    self._board,
                )
            )
            if left is not Left.CHANGED:
                break
            earlier, planned = control_in(planned), self._with_other_control(planned)
        passed_on(judging, self._interlock)
        return left

    def _with_other_control(self, now: Course) -> Course:
        """Return the course of a segment that was left for a change of control, with that control.

        The loop waits meanwhile, so that all that takes time was done when the order came.
        """
        number = int(self._words[Word.CHANGE])
        change = self._changes.pop(number, None)
        if change is None or change.segment != now.number:
            return now._replace(change=number, goes_on=True)
        self._memory.change.state[0] = 1.0
        return changed_course(now, change)._replace(change=number)

    def _rescue(self) -> Cause:
        """Trip, and keep the valve of a loop that ended by itself at null until the session ends.

        Orders are answered by an error meanwhile. Return the cause of the session's end, NONE after
        a `Close`.
        """
        trip(self._words, "loop", Cause.CRASH)
        self._tend_null()
        failure = self._safe_state()
        self._report(
            "the loop's connection does not confirm that the valve is at null; by another one: "
            + (failure or "it is")
        )
        looked_at = time.monotonic()
        for order in self._orders():
            if order is not None:
                self._pipe.send(TripError(_LEFT))
            if time.monotonic() - looked_at > (_REPEAT_S if failure else _LOOK_S):
                failure = self._look_again(failure)
                looked_at = time.monotonic()
        return self._ended_by

    def _look_again(self, failure: str) -> str:
        """Check a valve that the loop has left, and bring it back to null if needed.

        Args:
            failure: why it was not confirmed at null at the last check; empty if it was.

        Returns:
            Why it is not confirmed at null now; empty if it is.
        """
        try:
            driven = self._driver.driven()
            if driven and not failure:
                self._tally.found("valve", driven)
        except (DriverError, OSError) as error:
            driven = str(error)
        if not (driven or failure):
            return ""
        found = self._safe_state()
        if found and not failure:
            self._report(f"nobody knows whether the valve is at null any more: {found}")
        elif failure and not found:
            self._report("the valve is at null")
        return found

    def _tend_null(self) -> None:
        """If another master drives the valve, report that, and make the device latch its null.

        The loop itself nulls the valve at its next tick. A device that has latched its null accepts
        no command afterwards.
        """
        found = self._memory.found.copy()
        if found[Found.TIMES] == 0:
            return
        first_ns, last_ns = int(found[Found.FIRST_NS]), int(found[Found.LAST_NS])
        self._tally.counted("valve", _in_words(found), int(found[Found.TIMES]), first_ns, last_ns)
        now = time.monotonic()
        if 1e-9 * last_ns > self._nulled_at and now - self._nulled_at > _REPEAT_S:
            self._nulled_at = now
            failure = self._safe_state()
            if failure:
                self._report(f"the valve is not latched at null: {failure}")

    def _end(self, cause: Cause) -> str:
        """End the loop and close the driver in its safe state.

        Return why the safe state was not confirmed; empty if it was. Trip with `cause`, unless it
        is NONE.
        """
        if cause != Cause.NONE:
            trip(self._words, "loop", cause)
        self._memory.counts[Count.LEAVE] = 1
        if self._thread is not None:
            self._thread.join()
        if not self._is_open:
            return ""
        self._tend_null()
        self._tally.report_rest()
        failure = self._safe_state()
        self._driver.close()
        return failure

    def _safe_state(self) -> str:
        try:
            self._driver.safe_state()
        except (DriverError, OSError) as error:
            return str(error)
        if self._words[Word.LOOP_TRIP] and not self._words[Word.VALVE_NULL_AT]:
            self._words[Word.VALVE_NULL_AT] = time.monotonic_ns()
        return ""

    def _report(self, text: str) -> None:
        self._send(News(time.monotonic_ns(), "loop", text))

    def _compiles(self, name: str) -> None:
        self._report(f"compiles {name}")
        self._send(Compiling(name))

    def _send(self, news: News | Compiling) -> None:
        with contextlib.suppress(OSError):
            self._pipe.send(news)


def _in_words(found: Integers) -> str:
    """Return in words what another master did to the valve; `found` is indexed by `Found`."""
    parts = []
    if found[Found.ENABLED]:
        parts.append("enabled")
    if found[Found.OUTPUT_UV]:
        parts.append(f"output at {1e-6 * found[Found.OUTPUT_UV]:.2f} V")
    if found[Found.SPOOL_NM]:
        parts.append(f"spool {1e-3 * found[Found.SPOOL_NM]:.0f} um off null")
    return ", ".join(parts)


def main() -> None:
    """Run this process as the loop process of a session, until that ends or SIGTERM comes."""
    run_to_end("loop", _drive)


def _drive() -> None:
    process = LoopProcess(*child_ends())
    signal.signal(signal.SIGTERM, lambda number, frame: process.terminate())
    process.run()
