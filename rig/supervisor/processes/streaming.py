"""The supervisor's end of the live stream: starts the publisher, watches it, hands it what happens.

Nothing here waits for the publisher. What is sent to it goes through a queue of bounded length, and
rows through shared memory; if it dies or hangs it is killed and started again.
"""

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.loop import RING_ROWS, Board, Word
from rig.stream import LASTING, Command, StreamSettings, UnreachableError
from rig.surviving import Surviving, failure

from .child import Child, ChildError, News
from .publisher import Asked, Columns, Obeyed, Open, Send

Array = NDArray[np.float64]

OPEN_S: Final = 30.0
"""How long the publisher may take to open its stream."""
SILENCE_S: Final = 5.0
"""How long a publisher may give no sign of life before it is killed."""
POLL_S: Final = 0.1
RESTART_S: Final = (0.2, 1.0, 5.0, 30.0)
"""Time before a publisher is started again: longer each time, unless it worked for a while."""
WORKED_S: Final = 60.0
ORDERS_KEPT: Final = 2000
"""Orders that may wait for the publisher; the oldest go first."""
END_S: Final = 1.0
"""How long the last messages may take to be sent."""

OnCommand = Callable[[Command], str]


class Stream:
    """A rig's live stream, from `attach` to `close`; every method returns at once.

    Args:
        settings: the profile.
        rig: the rig's id.
        log: file that the publisher's stderr is appended to.
        say: shows a line to the operator; is called from any thread.
        on_command: is called with a command that is genuine and allowed, from a thread of its own;
            returns why it is not obeyed, or an empty text.
    """

    def __init__(
        self,
        settings: StreamSettings,
        rig: str,
        log: Path,
        say: Callable[[str], None],
        on_command: OnCommand,
    ) -> None:
        self._settings = settings
        self._rig = rig
        self._log = log
        self._say = say
        self._on_command = on_command
        self._survives = Surviving("the live stream", say)
        self._board: Board | None = None
        self._channels: tuple[str, ...] = ()
        self._orders: deque[object] = deque(maxlen=ORDERS_KEPT)
        self._wanted = threading.Event()
        self._columns: deque[Columns] = deque(maxlen=20)
        self._lasting: dict[str, Send] = {}
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._closing = threading.Event()
        self._sender: threading.Thread | None = None
        self._watch: threading.Thread | None = None
        self._starts = 0

    @property
    def pid(self) -> int | None:
        """Process id of the publisher; None while there is none."""
        child = self._child
        return None if child is None else child.pid

    def attach(self, board: Board, channels: tuple[str, ...]) -> None:
        """Begin to publish a board's rows; they have these columns if `columns` names no others."""
        self._board = Board.attach(os.dup(board.fd))
        self._channels = channels
        self._board.words[Word.PUBLISHED] = self._board.words[Word.ROWS]
        self._watch = threading.Thread(target=self._keep_running, name="stream watch", daemon=True)
        self._sender = threading.Thread(target=self._send_orders, name="stream", daemon=True)
        self._watch.start()
        self._sender.start()

    def columns(self, segment: int, channels: tuple[str, ...], test: int) -> None:
        """Say what the columns of a segment's rows are, and of which test they are."""
        columns = Columns(segment, channels, test)
        self._columns.append(columns)
        self._order(columns)

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message of a kind, plain values in it."""
        order = Send(kind, content)
        if kind in LASTING:
            with self._lock:
                self._lasting[kind] = order
        self._order(order)

    def event(self, who: str, kind: str, text: str, time_s: float | None = None) -> None:
        """Send an event, at a time of the present test if it has one."""
        content = {"at_ns": time.time_ns(), "time_s": time_s, "who": who, "kind": kind}
        self.send("event", {**content, "text": text})

    def close(self) -> None:
        """Send what is still to be sent, within a second, and end the publisher."""
        until = time.monotonic() + END_S
        while self._orders and self._child is not None and time.monotonic() < until:
            time.sleep(POLL_S / 10)
        self._closing.set()
        self._wanted.set()
        if self._watch is not None:
            self._watch.join()
        child, self._child = self._child, None
        if child is not None:
            _end(child)
        if self._sender is not None:
            self._sender.join()
        if self._board is not None:
            os.close(self._board.fd)

    def _order(self, order: object) -> None:
        self._orders.append(order)
        self._wanted.set()

    def _send_orders(self) -> None:
        """Hand over orders as they come. This thread may be held up: nobody waits for it."""
        while not self._closing.is_set():
            self._wanted.wait()
            self._wanted.clear()
            while self._orders and not self._closing.is_set():
                child = self._child
                if child is None:
                    break
                # An order that cannot be sent is dropped and reported; the next one is sent.
                with self._survives, suppress(ChildError, IndexError):
                    child.send(self._orders.popleft())

    def _keep_running(self) -> None:
        failures = 0
        note = ""
        while not self._closing.is_set():
            started = time.monotonic()
            try:
                child = self._start(note)
            except (ChildError, OSError, UnreachableError) as error:
                ended = str(error)
            except ValueError as error:
                # What is configured cannot be opened: again would be no better.
                self._say(f"stream: {error}; the run goes on without")
                return
            except Exception as error:  # whatever it is, it may not be so the next time
                ended = failure(error)
            else:
                ended = self._until_ended(child)
            if self._closing.is_set():
                return
            failures = 0 if time.monotonic() - started > WORKED_S else failures + 1
            wait_s = RESTART_S[min(failures, len(RESTART_S)) - 1] if failures else RESTART_S[0]
            note = f"{ended}; started again"
            with self._survives:
                self._say(f"stream: {ended}; to be started again in {wait_s:g} s")
            self._closing.wait(wait_s)

    def _start(self, note: str) -> Child:
        """Return a publisher that publishes.

        Raises:
            ChildError: it does not.
            ValueError: the stream cannot be opened as configured.
        """
        assert self._board is not None
        self._board.words[Word.PUBLISHER_BEAT] = 0
        child = Child(
            "stream", "rig.supervisor.processes.publisher", self._board, self._log, self._news
        )
        try:
            child.send(Open(self._settings, self._rig, self._channels, note))
            until = time.monotonic() + OPEN_S
            while True:
                try:
                    child.answer(POLL_S)
                    break
                except ChildError:
                    if child.ended or self._closing.is_set() or time.monotonic() > until:
                        raise
            with self._lock:
                before = [*self._columns, *self._lasting.values()]
            if note:
                for order in before:
                    child.send(order)
        except BaseException:
            _end(child)
            raise
        self._child = child
        self._wanted.set()
        return child

    def _until_ended(self, child: Child) -> str:
        """Wait for a publisher to end, or to hang; return how it ended."""
        assert self._board is not None
        while not self._closing.wait(POLL_S):
            beat = int(self._board.words[Word.PUBLISHER_BEAT])
            ended = f"publisher {child.ended}" if child.ended else ""
            if not ended and beat and time.monotonic_ns() - beat > 1e9 * SILENCE_S:
                ended = f"publisher hung for {SILENCE_S:g} s"
            if ended:
                self._child = None
                _end(child)
                return ended
        return ""

    def _news(self, news: News) -> None:
        if isinstance(news, Asked):
            self._order(Obeyed(news.command.number, self._refusal_of(news.command)))
        self._say(f"{news.who}: {news.text}")

    def _refusal_of(self, command: Command) -> str:
        """Have a command obeyed; return why it was not, empty if it was."""
        try:
            return self._on_command(command)
        except Exception as error:
            self._survives.note(error)
            return f"it failed: {failure(error)}"


def _end(child: Child) -> None:
    """End a publisher. One that hangs is killed: nothing is lost with it."""
    if not child.ended:
        patience = threading.Timer(END_S, _kill, (child.pid,))
        patience.start()
        child.end()
        patience.cancel()
        patience.join()
    else:
        child.end()


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


class RowFeed:
    """Rows of a simulated rig, which has no ring, for the stream.

    A rig that goes as fast as it can makes more rows than anybody can look at: of these, a sample
    is sent now and then, and the others are counted as missing.

    Args:
        stream: not attached yet.
        channels: the rows' columns.
        live: whether rows come at the wall clock, and all are sent.
    """

    EVERY_S: Final = 0.02
    MOST: Final = 200

    def __init__(self, stream: Stream, channels: tuple[str, ...], *, live: bool) -> None:
        self._live = live
        self._board = Board.create(len(channels) + 2)
        self._row = 0
        self._given_at = 0.0
        stream.attach(self._board, (*channels, "segment", "row"))

    def close(self) -> None:
        """Give up the memory; the stream has its own hold of it."""
        os.close(self._board.fd)

    def add(self, rows: Array, segment: int) -> None:
        """Add rows, float64 (n, channels), of a segment."""
        first, self._row = self._row, self._row + len(rows)
        now = time.monotonic()
        if not self._live:
            if now - self._given_at < self.EVERY_S:
                return
            first += max(len(rows) - self.MOST, 0)
            rows = rows[-self.MOST :]
        self._given_at = now
        words, ring = self._board.words, self._board.ring
        count = len(rows)
        if rows.shape[1] != ring.shape[1] - 2:
            return
        at = int(words[Word.ROWS])
        places = np.arange(at, at + count) % RING_ROWS
        ring[places, :-2] = rows
        ring[places, -2] = segment
        ring[places, -1] = np.arange(first, first + count)
        words[Word.ROWS] = at + count
