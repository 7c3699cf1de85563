"""The supervisor's side of a test on the wire: it orders segments, and takes rows as they come."""

import time
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from control import Guide, moving_guide, raised_cosine
from rig.loop.atomic import load_acquire, store_release
from rig.loop.board import DECISIONS_KEPT, Board, RingReader, Word
from rig.loop.interlocks import (
    Action,
    Cause,
    LoopStoppedError,
    PassingReader,
    RungPassed,
    TripError,
    channel_name,
)

from .following import skip_order
from .layout import Drive, wire_channels
from .orders import ChangeControl, Segment

Array = NDArray[np.float64]

_NAP_S: Final = 2e-3
_RECENT_ROWS: Final = 200
"""Number of latest rows in which the newest position is looked for."""


class LoopProcess(Protocol):
    """The methods of the loop process that a test needs."""

    def send(self, order: object) -> None:
        """Send an order, an object of a class of `rig.loop.wire.orders`."""

    def answer(self, timeout_s: float) -> Any:
        """Wait up to `timeout_s` for the next answer of the loop process, and return it.

        An answer that is an exception is raised.

        Raises:
            ChildError: no answer came in time, it cannot be read, or the process has ended.
            TripError: the loop's thread has ended by itself.
        """


ANSWER_S: Final = 5.0
"""Longest time in s to get ready for a segment, and again to switch to it, for the loop process."""


def post_decision(board: Board, segment: int, row: Array) -> None:
    """Post a decision on a segment, a row of `DECIDED`; other segments ignore it.

    Decisions have a ring of their own on the board. A decision is written before the word that
    counts it (`store_release`). The loop never waits: it copies the newest decision, and then
    checks by the count whether its place can have been written again meanwhile, which takes
    seconds. If so, the loop ignores the copy and tries again at the next tick.
    """
    number = int(board.words[Word.DECISIONS]) + 1
    place = board.decisions[number % DECISIONS_KEPT]
    place[0], place[1:] = segment, row
    store_release(board.words, Word.DECISIONS.value, number)


@dataclass(eq=False, repr=False)
class WireLoop:
    """One test on a real rig, with the same methods as `SimulatedLoop`.

    Args:
        board: the board that is shared with the loop process.
        process: the loop process, which runs a segment.
        test: the test's segment, without its number, which this class chooses.
        start_position: position to which the ram is brought before, m; None leaves it where it is.
        settle_ticks: number of ticks in which it is brought there.
        silence_s: silence of the loop process after which it counts as lost.

    Attributes:
        channels: names of the rows' columns.
        number: number of the test's segment, which its rows carry; 0 before `ready` orders it.
    """

    board: Board
    process: LoopProcess
    test: Segment
    _: KW_ONLY
    start_position: float | None
    settle_ticks: int
    silence_s: float

    def __post_init__(self) -> None:
        self._words = self.board.words
        self._ring = RingReader(self.board)
        self.number = 0
        self._rows: list[Array] = []
        self._waiting = 0
        self._done = self._lead = 0
        self._passings = PassingReader(self.board.passing_log)
        self._stopped: LoopStoppedError | None = None
        self.channels = wire_channels(self.test.memory.filter.states, self.test.open_loop)
        self._segment_column = self.channels.index("segment")
        self._position_column = self.channels.index("position_m")

    @property
    def ticks_left(self) -> int:
        """Number of ticks of the test whose rows are still to come."""
        return self.test.setpoint.size - self._lead - self._done

    def position(self) -> None:
        """Bring the ram to its start position by the position loop, along a raised cosine.

        It returns when the ram should be there; without start position, nothing is done.

        Raises:
            LoopStoppedError: the loop stopped the motion, is silent, or knows no position.
            TripError: the loop did not switch to the motion within `ANSWER_S`.
            ChildError: the loop did not take the order.
        """
        if self.start_position is None:
            return
        here = self._measured_position()
        setpoint = raised_cosine(here, self.start_position, self.settle_ticks)
        moving = replace(
            self.test,
            drive=Drive.TRACK,
            open_loop=False,
            setpoint=setpoint,
            guide=moving_guide(self.test.guide.law, self.test.basis, setpoint),
            limits=(),
        )
        self._switch_to(moving)
        while self._words[Word.TICK] < setpoint.size:
            self._check()
            time.sleep(_NAP_S)

    def ready(self) -> int:
        """Order the test's segment, unless that was done; return its number, for the recorder.

        It waits up to `ANSWER_S` until the loop is ready to switch to the segment. The first call
        of `advance` then makes it switch.

        Raises:
            ChildError: the loop did not take the order.
        """
        if not self.number:
            self.number = self._order(self.test)
        return self.number

    def advance(self, ticks: int) -> Array:
        """Wait for the next `ticks` ticks, or those left; return their rows (n, len(channels)).

        The first call begins the test. Fewer rows are returned if the loop ends the test.

        Raises:
            LoopStoppedError: the loop ended the test, or is silent, or rows were lost; earlier
                calls have returned the rows up to then.
            ChildError: the loop did not take the order of the test.
        """
        if not self._done and self._words[Word.SWITCH] != self.ready():
            self._ring.skip_to_end()
            self._words[Word.SWITCH] = self.number
        wanted = min(ticks, self.ticks_left)
        while self._waiting < wanted and self._stopped is None:
            try:
                self._check()
            except LoopStoppedError as error:
                self._stopped = error
            self._take()
            if self._waiting < wanted:
                time.sleep(_NAP_S)
        if self._stopped is not None and not self._waiting:
            raise self._stopped
        wanted = min(wanted, self._waiting)
        rows = np.concatenate(self._rows) if self._rows else np.empty((0, len(self.channels)))
        self._rows, self._waiting = [rows[wanted:]], len(rows) - wanted
        self._done += wanted
        return rows[:wanted]

    def change(self, gain: float, guide: Guide) -> int | None:
        """Give the running test another control; return the number of the tick from which it holds.

        It waits up to `ANSWER_S` until the loop has prepared the change, and again until it has
        taken it, between two ticks. The ram is held by the new gain after the test, too. The result
        is None if the loop stopped the motion or fell silent meanwhile, which `advance` raises.

        Args:
            gain: gain of the position loop, V/m.
            guide: what the position loop adds to gain times error.

        Raises:
            TripError: the loop did not take the change in time.
            ChildError: the loop process did not take the order.
        """
        number = int(self._words[Word.CHANGE]) + 1
        self.process.send(ChangeControl(number, self.number, gain, guide))
        self.process.answer(ANSWER_S)
        self._words[Word.CHANGE] = number
        until = time.monotonic() + ANSWER_S
        while self._words[Word.CHANGED] != number:
            try:
                self._check()
            except LoopStoppedError:
                return None
            if time.monotonic() >= until:
                raise TripError(
                    f"the loop has not taken another control within {ANSWER_S:g} s after the "
                    "order; end what else loads this computer, then begin anew"
                )
            time.sleep(_NAP_S)
        self.test = replace(self.test, gain=gain, guide=guide)
        return int(self._words[Word.CHANGED_AT])

    def decided(self, row: Array) -> None:
        """Post a decision on the test, a row of `DECIDED`, which later rows of the loop contain."""
        post_decision(self.board, self.number, row)

    def passed(self) -> list[RungPassed]:
        """Return the limits that the loop found passed in the test since the last call."""
        return [each for each in self._passings.take() if each.segment == self.number]

    def skip_to(self, place: int, blend_ticks: int) -> int | None:
        """Have the test go on at a later place of its setpoints; wait until the loop does.

        Args:
            place: index of that setpoint; the number of setpoints to end the test.
            blend_ticks: number of ticks in which the setpoint goes over to those from there on.

        Returns:
            The tick of the test at which it went on there; None if it was there already.

        Raises:
            LoopStoppedError: the loop has stopped the motion, or is silent.
            TripError: the loop did not look at the order within `ANSWER_S`.
        """
        words, order = self._words, skip_order(self.number, place, blend_ticks)
        store_release(words, Word.SKIP.value, order)
        until = time.monotonic() + ANSWER_S
        while load_acquire(words, Word.SKIPPED.value) != order:
            self._check()
            if time.monotonic() >= until:
                raise TripError(
                    f"the loop did not skip to setpoint {place} within {ANSWER_S:g} s of the "
                    "order; end what else loads this computer, then begin anew"
                )
            time.sleep(_NAP_S)
        before, self._lead = self._lead, int(words[Word.LEAD])
        return None if self._lead == before else place - self._lead

    def safe_state(self) -> None:
        """Order the loop to hold the ram where it is; wait up to `ANSWER_S` until it does.

        Nothing is done after a trip, when the valve stays at null, nor if the loop is silent. After
        an error the ram may still move, so the caller must bring it to rest in another way.

        Raises:
            LoopStoppedError: the loop stops the motion, or falls silent.
            TripError: the loop did not begin to hold the ram within `ANSWER_S`.
            ChildError: the loop did not take the order.
        """
        if self._words[Word.LOOP_TRIP] == 0 and not self._is_silent():
            holding = replace(
                self.test, drive=Drive.HOLD, open_loop=False, setpoint=np.empty(0), limits=()
            )
            self._switch_to(holding)

    def _take(self) -> None:
        rows = self._ring.take()
        if self._ring.lost:
            # This process was stopped for longer than the ring holds rows.
            self._stopped = LoopStoppedError(Action.HOLD, Cause.SUPERVISOR_LOST)
        mine = rows[rows[:, self._segment_column] == self.number]
        if len(mine):
            self._rows.append(mine)
            self._waiting += len(mine)

    def _order(self, segment: Segment) -> int:
        number = int(self._words[Word.SWITCH]) + 1
        self.process.send(replace(segment, number=number))
        self.process.answer(ANSWER_S)
        return number

    def _switch_to(self, segment: Segment) -> None:
        number = self._order(segment)
        self._words[Word.SWITCH] = number
        until = time.monotonic() + ANSWER_S
        while (runs := int(self._words[Word.SEGMENT])) != number:
            self._check()
            if time.monotonic() >= until:
                raise TripError(
                    f"the loop still runs segment {runs}, {ANSWER_S:g} s after the order to switch "
                    f"to segment {number}; end what else loads this computer, then begin anew"
                )
            time.sleep(_NAP_S)

    def _measured_position(self) -> float:
        positions = self._ring.latest(_RECENT_ROWS)[:, self._position_column]
        known = positions[np.isfinite(positions)]
        if not known.size:
            raise LoopStoppedError(Action.HOLD, Cause.STALE_SAMPLE)
        return float(known[-1])

    def _check(self) -> None:
        """Raise `LoopStoppedError` if the loop has stopped the motion, or is silent."""
        words = self._words
        action = Action.TRIP if words[Word.LOOP_TRIP] else Action(int(words[Word.ACTION]))
        if action >= Action.HOLD:
            cause = Cause(int(words[Word.LOOP_TRIP]) or int(words[Word.ACTION_CAUSE]))
            channel = channel_name(int(words[Word.ACTION_CHANNEL]))
            raise LoopStoppedError(action, cause, channel)
        if self._is_silent():
            raise LoopStoppedError(Action.TRIP, Cause.LOOP_LOST)

    def _is_silent(self) -> bool:
        return bool(time.monotonic_ns() - self._words[Word.LOOP_BEAT] > round(1e9 * self.silence_s))
