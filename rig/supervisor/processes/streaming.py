"""The supervisor's end of the live stream starts the publisher, watches it, and sends it orders.

The session never waits for the publisher: orders go through a queue of bounded length, and rows
through shared memory. If the publisher dies or hangs, it is killed and started again.
"""

import os
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
from rig.reserves import refusal
from rig.stream import LASTING, Command, StreamSettings, UnreachableError
from rig.surviving import Surviving, failure, start

from .child import Child, ChildError, News
from .publisher import Asked, Columns, Obeyed, Open, Send, event_content

OPEN_S: Final = 30.0
"""Time in s within which the publisher must open its stream."""
SILENCE_S: Final = 5.0
"""Time in s without a beat after which a publisher is killed."""
POLL_S: Final = 0.1
RESTART_S: Final = (0.2, 1.0, 5.0, 30.0)
"""Times in s before a publisher is started again, for the first, second, ... failure in a row.

A failure after `WORKED_S` of work counts as the first again.
"""
WORKED_S: Final = 60.0
ORDERS_KEPT: Final = 2000
"""Most orders that may wait for the publisher; if there are more, the oldest are dropped."""
END_S: Final = 1.0
"""Time in s within which the last messages must be sent at the end, and then the publisher end.

It is killed afterwards, as nothing is lost with it.
"""


class Stream:
    """A rig's live stream, which is published from `attach` to `close`.

    Every method but `close` returns at once. Messages that are too many to wait, or that the
    publisher cannot take, are dropped.

    Args:
        settings: the profile.
        rig: the rig's id.
        log: file to which the publisher's stderr is appended.
        say: shows a line to the operator; it is called from any thread.
        on_command: is called, from another thread, with each command that has passed the gate;
            returns why it is not obeyed, or an empty text if it is.
    """

    _board: Board
    _channels: tuple[str, ...]

    def __init__(
        self,
        settings: StreamSettings,
        rig: str,
        log: Path,
        say: Callable[[str], None],
        on_command: Callable[[Command], str],
    ) -> None:
        self._settings = settings
        self._rig = rig
        self._log = log
        self._say = say
        self._on_command = on_command
        self._survives = Surviving("the live stream", say)
        self._orders: deque[object] = deque(maxlen=ORDERS_KEPT)
        self._wanted = threading.Event()
        self._columns: deque[Columns] = deque(maxlen=20)
        self._lasting: dict[str, Send] = {}
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []

    def attach(self, board: Board, channels: tuple[str, ...]) -> None:
        """Start the publisher, and publish the rows that are written to a board from now on.

        If the system refuses what that needs, the operator is told, and nothing is published.

        Args:
            board: the board with the ring of rows.
            channels: names of the rows' columns, in segments for which `columns` was not called.
        """
        try:
            self._board = Board.attach(os.dup(board.fd))
            self._channels = channels
            self._board.words[Word.PUBLISHED] = self._board.words[Word.ROWS]
            for work, name in ((self._keep_running, "stream watch"), (self._send_orders, "stream")):
                thread = threading.Thread(target=work, name=name, daemon=True)
                start(thread)
                self._threads.append(thread)
        except OSError as error:
            self._closing.set()
            self._say(f"stream: {refusal(error)}; the run goes on without")

    def columns(self, segment: int, channels: tuple[str, ...], test: int) -> None:
        """Tell the publisher which columns the rows of a segment have, and their test's number."""
        columns = Columns(segment, channels, test)
        self._columns.append(columns)
        self._order(columns)

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message of a kind, whose content holds texts, numbers, lists and maps only.

        The last one of a kind in `LASTING` is sent again by a publisher that is started again.
        """
        order = Send(kind, content)
        if kind in LASTING:
            with self._lock:
                self._lasting[kind] = order
        self._order(order)

    def event(self, who: str, kind: str, text: str, time_s: float | None = None) -> None:
        """Send an event.

        Args:
            who: who caused it.
            kind: kind of event, such as `trip`.
            text: what happened.
            time_s: time within the present test, s; None if it has none.
        """
        self.send("event", event_content(who, kind, text, time_s))

    def close(self) -> None:
        """Wait until waiting messages are sent, for at most a second; then end the publisher."""
        until = time.monotonic() + END_S
        while self._orders and self._child is not None and time.monotonic() < until:
            time.sleep(POLL_S / 10)
        self._closing.set()
        self._wanted.set()
        for thread in self._threads:
            thread.join()
        if self._threads:
            os.close(self._board.fd)

    def _order(self, order: object) -> None:
        self._orders.append(order)
        self._wanted.set()

    def _send_orders(self) -> None:
        """Send orders to the publisher as they come, in a thread for which nobody waits."""
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
                ended = self._publish(note)
            except (ChildError, OSError, UnreachableError) as error:
                ended = str(error)
            except ValueError as error:
                # The stream cannot be opened as configured, so trying again is of no use.
                self._say(f"stream: {error}; the run goes on without")
                return
            except Exception as error:  # any other error may not occur at the next attempt
                ended = failure(error)
            if self._closing.is_set():
                return
            failures = 0 if time.monotonic() - started > WORKED_S else failures + 1
            wait_s = RESTART_S[min(failures, len(RESTART_S)) - 1] if failures else RESTART_S[0]
            note = f"{ended}; started again"
            with self._survives:
                self._say(f"stream: {ended}; to be started again in {wait_s:g} s")
            self._closing.wait(wait_s)

    def _publish(self, note: str) -> str:
        """Start a publisher, and wait until it ends or hangs, or the stream is closed; then end it.

        A publisher that is started again first gets the columns and the lasting messages so far.

        Args:
            note: text of an event that it sends at once; empty at the first start.

        Returns:
            A text on how it ended; empty if the stream was closed before.

        Raises:
            ChildError: the publisher ended, did not open its stream in time, or its answer cannot
                be read.
            ValueError: the stream cannot be opened as configured.
        """
        self._board.words[Word.PUBLISHER_BEAT] = 0
        child = Child(
            "stream", "rig.supervisor.processes.publisher", self._board, self._log, self._news
        )
        try:
            order = Open(self._settings, self._rig, self._channels, note)
            child.ask_patiently(order, OPEN_S, POLL_S, self._heed_close)
            with self._lock:
                before = [*self._columns, *self._lasting.values()]
            for earlier in before if note else []:
                child.send(earlier)
            self._child = child
            self._wanted.set()
            ended = ""
            while not ended and not self._closing.wait(POLL_S):
                beat = int(self._board.words[Word.PUBLISHER_BEAT])
                if child.ended:
                    ended = f"publisher {child.ended}"
                elif beat and time.monotonic_ns() - beat > 1e9 * SILENCE_S:
                    ended = f"publisher hung for {SILENCE_S:g} s"
            return ended
        finally:
            self._child = None
            child.end(END_S)

    def _heed_close(self) -> None:
        """Raise `ChildError` if the stream is closed, so that no publisher is awaited any more."""
        if self._closing.is_set():
            raise ChildError("the stream is closed")

    def _news(self, news: News) -> None:
        """Show news of the publisher to the operator.

        If the news is a command (`Asked`), `on_command` is called first, and the publisher is sent
        the answer.
        """
        if isinstance(news, Asked):
            try:
                refusal = self._on_command(news.command)
            except Exception as error:
                self._survives.note(error)
                refusal = f"it failed: {failure(error)}"
            self._order(Obeyed(news.command.number, refusal))
            if news.command.name == "beat":
                return
        self._say(f"{news.who}: {news.text}")


class RowFeed:
    """A feed of rows to the stream for a simulated rig, which has no ring itself.

    A rig that runs as fast as it can makes more rows than anybody can look at. Of these, at most
    `MOST` rows are sent every `EVERY_S` seconds, and readers count the others as missing.

    Args:
        stream: the stream, which must not be attached yet; it is attached here.
        channels: names of the rows' columns.
        live: whether rows come at the wall clock; then all are sent.
    """

    EVERY_S: Final = 0.02
    MOST: Final = 200

    def __init__(self, stream: Stream, channels: tuple[str, ...], *, live: bool) -> None:
        self._live = live
        self._board = Board.create(len(channels) + 2)
        # A simulated rig knows where its ram is.
        self._board.words[Word.HOMED] = 1
        self._row = 0
        self._given_at = 0.0
        stream.attach(self._board, (*channels, "segment", "row"))

    def close(self) -> None:
        """Close this feed's handle of the ring's memory; the stream has a handle of its own."""
        os.close(self._board.fd)

    def add(self, rows: NDArray[np.float64], segment: int) -> None:
        """Add rows, float64 (n, channels), of a segment; if not live, some may be left out.

        Rows with another number of columns than the feed's channels are dropped.
        """
        first, self._row = self._row, self._row + len(rows)
        now = time.monotonic()
        if not self._live:
            if now - self._given_at < self.EVERY_S:
                return
            first += max(len(rows) - self.MOST, 0)
            rows = rows[-self.MOST :]
        self._given_at = now
        words, ring = self._board.words, self._board.ring
        numbers = np.arange(first, first + len(rows))
        table = np.column_stack([rows, np.full(len(rows), segment), numbers])
        if table.shape[1] == ring.shape[1]:
            at = int(words[Word.ROWS])
            ring[np.arange(at, at + len(rows)) % RING_ROWS] = table
            words[Word.ROWS] = at + len(rows)
