"""The publisher sends rows from the ring to the live stream, in a process of its own.

It reads the ring as the recorder does, and disturbs neither the recorder nor the loop: rows that it
has no time for, and messages that a reader does not take, are dropped, the oldest first, and
readers can count them. If it is killed, it is started again (`rig.supervisor.processes.streaming`),
and goes on with the rows that are still in the ring.
"""

import itertools
import os
import queue
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isnan
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np
import zenoh

from rig.control_socket import remark_of
from rig.loop import Board, RingReader, Word
from rig.plain_output import shown_line
from rig.recording import unit_of
from rig.stream import (
    LARGEST_COMMAND,
    Batches,
    Command,
    Refused,
    Samples,
    StreamSender,
    StreamSettings,
    asked_digest,
    command_key,
    fingerprint,
    finite,
    gate_of,
    publisher_session,
    said,
    voice_of,
)
from rig.surviving import Surviving, threads_granted

from .child import News, child_ends, obeyed_next, run_to_end
from .health import Health

POLL_S: Final = 0.005
HEALTH_S: Final = 1.0
MOST_ROWS: Final = 500
"""Most rows that are sent in one turn, so that orders and heartbeats are never late."""
MOST_WAITING: Final = 10_000
"""Most rows that may wait to be sent; if there are more, all but the newest 500 are dropped."""
FLUSH_S: Final = 0.1
"""Time in s after which a batch is sent even if it is not full, for rigs with slow rows."""
COMMANDS_WAITING: Final = 32
ANSWER_S: Final = 3.0
"""Time in s within which the supervisor must answer whether it obeys a command."""
REFUSALS_REPORTED: Final = 5
"""Most refusals that are reported one by one within a second; further ones are only counted."""
NICENESS: Final = 5
UNHOMED: Final = {"position_m": "encoder_m", "setpoint_m": "homing_setpoint"}
"""Names under which two columns are published while the encoder's zero is not known.

The position is then what the encoder has counted since it was switched on, and the setpoint is
counted from there too, or is the command in V by which the ram is homed. Nobody can take them for a
position in the cylinder.
"""


@dataclass(frozen=True)
class Open:
    """The order to open the stream; the answer is None, or a `ValueError` if it cannot be opened.

    Attributes:
        settings: the profile.
        rig: the rig's id.
        channels: names of the rows' columns, in segments for which no `Columns` was sent.
        note: text of an event to send at once, such as that the publisher was started again; empty
            for none.
    """

    settings: StreamSettings
    rig: str
    channels: tuple[str, ...]
    note: str = ""


@dataclass(frozen=True)
class Columns:
    """The order that gives the names of the columns of a segment's rows, and its test's number."""

    segment: int
    channels: tuple[str, ...]
    test: int


@dataclass(frozen=True)
class Send:
    """The order to send a message of a kind with this content, NaN and infinity as None."""

    kind: str
    content: Mapping[str, Any]


@dataclass(frozen=True)
class Obeyed:
    """The supervisor's answer to a command.

    Attributes:
        number: number of the command.
        refusal: why the command is not obeyed; empty if it is.
    """

    number: int
    refusal: str


@dataclass(frozen=True)
class Asked(News):
    """The report of a command that came by the stream and has passed the gate."""

    command: Command


class Publisher:
    """What works inside the publisher's process: it publishes one live stream while `serve` runs.

    Args:
        board: the board with the ring of rows.
        pipe: this end of the pipe to the supervisor.
        order: the order to open the stream.
        session: an open session of the order's profile.
    """

    def __init__(self, board: Board, pipe: Connection, order: Open, session: zenoh.Session) -> None:
        self._board = board
        self._pipe = pipe
        self._ring = RingReader(board)
        self._ring.go_on_from(int(board.words[Word.PUBLISHED]))
        self._health = Health(board, order.channels)
        self._settings = order.settings
        self._default = Columns(-1, order.channels, 0)
        self._columns: dict[int, Columns] = {}
        self._segment_column = order.channels.index("segment")
        self._segment: int | None = None
        self._batches = Batches(order.settings.batch, order.settings.channels)
        self._commands: queue.Queue[zenoh.Query] = queue.Queue(COMMANDS_WAITING)
        self._waiting: dict[int, tuple[zenoh.Query, Command, float]] = {}
        """By number, commands for whose answers the supervisor has until a monotonic time in s."""
        self._late: dict[int, Command] = {}
        """By number, commands for which that time has passed; they may be obeyed still."""
        self._overrun = 0
        self._failures: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._survives = Surviving("the publisher", self._failures.put)
        self._refused: list[float] = []
        self._refused_silently = 0
        self._heartbeat_at = self._health_at = self._flushed_at = 0.0
        history_s = order.settings.history_s
        self._voice = voice_of(order.settings)
        self._sender = StreamSender(session, order.rig, history_s, self._failures.put, self._voice)
        self._gate = gate_of(order.settings, order.rig, self._sender.name)
        keys = command_key(order.rig, "*")
        with threads_granted():
            self._queryable = session.declare_queryable(keys, self._command_came)
            self._puts = session.declare_subscriber(keys, self._put_came)
        self._started = time.monotonic()
        if order.note:
            self._event("stream", order.note)

    def serve(self) -> None:
        """Obey orders, send rows and take commands until the supervisor closes its end of the pipe.

        The stream is ended then.
        """
        while obeyed_next(self._pipe, POLL_S, self._obey_all):
            self._take_turn()
        self._sender.close()

    def _take_turn(self) -> None:
        """Send rows and whatever else is due, and take commands, once."""
        self._take_rows()
        self._take_commands()
        self._send_due()
        # What was taken and not sent is taken again by the publisher that follows this one.
        self._board.words[Word.PUBLISHED] = self._ring.next_row - self._batches.waiting
        self._board.words[Word.PUBLISHER_BEAT] = time.monotonic_ns()

    def _obey_all(self, order: object) -> None:
        """Obey an order, and all others that have come."""
        self._obey(order)
        while self._pipe.poll():
            self._obey(self._pipe.recv())

    def _obey(self, order: object) -> None:
        with self._survives:
            if isinstance(order, Columns):
                self._columns[order.segment] = order
                # A session may last for weeks, and only the last segments are still needed.
                while len(self._columns) > 100:
                    del self._columns[min(self._columns)]
            elif isinstance(order, Send):
                self._sender.send(order.kind, finite(order.content))
            elif isinstance(order, Obeyed) and order.number in self._late:
                self._tell_of(self._late.pop(order.number), order.refusal, " late")
            elif isinstance(order, Obeyed) and order.number in self._waiting:
                query, command, _ = self._waiting.pop(order.number)
                self._reply(query, order.refusal)
                # Heartbeats come twenty times a second; only a refused one is an event.
                if command.name != "beat" or order.refusal:
                    self._tell_of(command, order.refusal)

    def _take_rows(self) -> None:
        if self._ring.waiting > MOST_WAITING:
            self._ring.take(self._ring.waiting - MOST_ROWS)
        rows = self._ring.take(MOST_ROWS)
        self._ring.lost = 0
        if not len(rows):
            return
        # The loop's beat shows when the newest row was written.
        beat_ns = int(self._board.words[Word.LOOP_BEAT])
        newest_ns = time.time_ns() - (time.monotonic_ns() - beat_ns if beat_ns else 0)
        self._health.take(rows)
        numbers = np.arange(self._ring.next_row - len(rows), self._ring.next_row, dtype=float)
        if "row" in self._default.channels:
            numbers = rows[:, self._default.channels.index("row")]
        segments = rows[:, self._segment_column]
        breaks = np.flatnonzero((np.diff(segments) != 0.0) | (np.diff(numbers) != 1)) + 1
        for begin, end in itertools.pairwise((0, *breaks.tolist(), len(rows))):
            if segments[begin] != self._segment:
                self._begin_segment(float(segments[begin]))
            self._send(self._batches.add(int(numbers[begin]), rows[begin:end], newest_ns))

    def _begin_segment(self, segment: float) -> None:
        self._send(self._batches.flush())
        self._segment = -1 if isnan(segment) else int(segment)
        columns = self._columns.get(self._segment, self._default)
        names = tuple(name for name in columns.channels if name != "row")
        if not self._board.words[Word.HOMED]:
            names = tuple(UNHOMED.get(name, name) for name in names)
        if self._batches.set_columns(names, [unit_of(name) for name in names], columns.test):
            self._sender.send("channels", self._batches.channels.content())

    def _send(self, batches: list[Samples]) -> None:
        for batch in batches:
            self._sender.send("samples", batch.content())
            self._flushed_at = time.monotonic()

    def _send_due(self) -> None:
        now = time.monotonic()
        if now - self._flushed_at > FLUSH_S:
            self._send(self._batches.flush())
            self._flushed_at = now
        if now - self._health_at >= HEALTH_S:
            self._health_at = now
            self._sender.send("health", finite(self._health.content()))
            if self._refused_silently:
                count, self._refused_silently = self._refused_silently, 0
                self._event("refused", f"{count} more commands refused")
            while not self._failures.empty():
                self._report("error", self._failures.get())
        if now - self._heartbeat_at >= self._settings.heartbeat_s:
            self._heartbeat_at = now
            content = {
                "heartbeat_s": self._settings.heartbeat_s,
                "up_s": now - self._started,
                "rows": self._ring.next_row,
                "sequences": dict(self._sender.sequences),
                "commands": bool(self._settings.operators),
            }
            self._sender.send("heartbeat", content)
        for number, (query, command, until) in list(self._waiting.items()):
            if now > until:
                del self._waiting[number]
                self._reply(query, "the supervisor does not answer")
                if command.name == "beat":
                    continue
                self._late[number] = command
                while len(self._late) > COMMANDS_WAITING:
                    del self._late[next(iter(self._late))]
                late = f"not answered within {ANSWER_S:g} s, and may be obeyed later"
                self._event("command", self._described(command, late))

    def _command_came(self, query: zenoh.Query) -> None:
        """Queue a command, or count it to be refused if too many wait; Zenoh's thread calls it."""
        try:
            self._commands.put_nowait(query)
        except queue.Full:
            self._overrun += 1

    def _put_came(self, sample: zenoh.Sample) -> None:
        """Count a command that was put instead of asked: it cannot be answered, and is refused."""
        self._overrun += 1

    def _take_commands(self) -> None:
        if self._overrun:
            count, self._overrun = self._overrun, 0
            self._refuse(f"unanswerable: {count} that are too many, or no queries", "", b"")
        for _ in range(self._commands.qsize()):
            with self._survives:
                self._judge(self._commands.get_nowait())

    def _judge(self, query: zenoh.Query) -> None:
        name = str(query.key_expr).rpartition("/")[2]
        payload = b""
        if query.payload is not None:
            # An oversized payload is not copied, as the gate only looks at its length.
            size = len(query.payload)
            payload = bytes(query.payload) if size <= LARGEST_COMMAND else bytes(size)
        try:
            command = self._gate.judge(name, payload)
        except Refused as refused:
            self._refuse(str(refused), refused.by, payload)
            self._reply(query, str(refused))
            return
        self._waiting[command.number] = (query, command, time.monotonic() + ANSWER_S)
        asked_for = self._described(command, "asked for")
        self._pipe.send(Asked(time.monotonic_ns(), "stream", asked_for, command))

    def _tell_of(self, command: Command, refusal: str, when: str = "") -> None:
        """Send the one event of a command: what came of it."""
        state = f"not obeyed{when}: {refusal}" if refusal else f"obeyed{when}"
        self._event("command", self._described(command, state))

    def _described(self, command: Command, state: str) -> str:
        remark = remark_of(command.text, command.person)
        who = f"{command.person} ({command.by})" if command.person else command.by
        return f"{command.name} by {who} {state}{f': {remark}' if remark else ''}"

    def _refuse(self, text: str, by: str, payload: bytes) -> None:
        """Report a refusal; after too many within a second, only count it."""
        now = time.monotonic()
        self._refused = [at for at in self._refused if now - at < 1.0]
        if len(self._refused) >= REFUSALS_REPORTED:
            self._refused_silently += 1
            return
        self._refused.append(now)
        claimed = "".join(c if c.isprintable() else "?" for c in by) or "unknown"
        line = f"command refused, {text} (from {claimed}, {fingerprint(payload)})"
        self._report("refused", line)

    def _report(self, kind: str, line: str) -> None:
        """Report a line in the session's log and as an event."""
        self._event(kind, line)
        with suppress(OSError):
            stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            os.write(
                sys.stderr.fileno(),
                f"{stamp} stream: {shown_line(line)}\n".encode(errors="replace"),
            )

    def _reply(self, query: zenoh.Query, refusal: str) -> None:
        with suppress(zenoh.ZError), query:
            key = str(query.key_expr)
            # The answer to a command to all rigs at once (`rig/*/...`) is this rig's only.
            asked = b"" if query.payload is None else bytes(query.payload)
            answer = {"accepted": not refusal, "reason": refusal, "to": asked_digest(asked)}
            query.reply(key, said(answer, key, self._voice))

    def _event(self, kind: str, text: str) -> None:
        self._sender.send("event", event_content("stream", kind, text))


def event_content(who: str, kind: str, text: str, time_s: float | None = None) -> dict[str, Any]:
    """Return the content of a message `event` with the present wall-clock time.

    Args:
        who: who caused the event.
        kind: kind of event, such as `trip`.
        text: what happened.
        time_s: time within the present test, s; None if it has none.
    """
    return {"at_ns": time.time_ns(), "time_s": time_s, "who": who, "kind": kind, "text": text}


def main() -> None:
    """Run this process as a publisher: await the order `Open`, then publish until the pipe closes.

    If the stream cannot be opened, the supervisor is sent the `ValueError`, and the process ends.
    After an error of the operating system the exit code is its `errno`.
    """
    run_to_end("stream", _publish)


def _publish() -> None:
    board, pipe = child_ends()
    # The recorder has precedence, however much this process's readers ask of it.
    os.nice(NICENESS)
    order: Open = pipe.recv()
    try:
        with publisher_session(order.settings) as session:
            publisher = Publisher(board, pipe, order, session)
            pipe.send(None)
            publisher.serve()
    except ValueError as error:
        pipe.send(error)
