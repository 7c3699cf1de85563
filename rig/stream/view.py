"""A view collects what a reader knows of one rig: newest messages, last samples, what is missing.

It does not use Zenoh: received messages are given to it, and it returns snapshots and windows.
"""

import threading
from collections import deque
from contextlib import AbstractContextManager
from dataclasses import replace
from operator import itemgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .known import DEAD_AFTER, Content, Gap, Snapshot, Window
from .messages import KEPT, LASTING, Channels, MessageError, Samples, read
from .received import Received, period_s

EVENTS_SHOWN: Final = 100
VERDICTS_SHOWN: Final = 50
GAPS_SHOWN: Final = 50
CHANNELS_KEPT: Final = 100
"""Most messages `channels` of all sessions that are stored; a run has one for each kind of test."""
SESSIONS_KEPT: Final = 8
"""Former sessions that are remembered: one that comes back after another has begun is a second
voice, as a publisher that is started again has a new session."""
HOLES_KEPT: Final = 1000
"""Most gaps between rows that are stored, which past rows may still fill."""
ASKED_AGAIN: Final = frozenset((*LASTING, *KEPT)) - {"health", "progress", "heartbeat"}
"""Kinds whose lost messages are asked for again; the others come again within a second."""

_SHOWN: Final = ("decision", "health", "campaign", "progress", "state")
"""Kinds of messages whose newest one is in a snapshot as it came."""
_numbered: Final = itemgetter("session", "sequence")
"""Returns what tells a message from all others of its kind."""
_sent: Final = itemgetter("sent_ns", "sequence")
"""Returns what orders messages by the time of their sending."""


class RigView:
    """A collector of one rig's messages, which gives snapshots and windows of what they say.

    It is not thread-safe.

    Args:
        rig: the rig's id.
        window_s: how long in s samples are stored after their arrival.

    Attributes:
        rig: the rig's id.
        session: name of the publisher's present session, for commands; empty if unknown.
        has_token: whether the rig's liveliness token is there.
        asked_again_at: monotonic time in s before which it is asked for no lost messages again.
        turn: lock that is held while a command to the rig is signed and handed to Zenoh.
    """

    def __init__(self, rig: str, window_s: float = 30.0) -> None:
        self.rig = rig
        self.has_token = False
        self.asked_again_at = 0.0
        self.turn: AbstractContextManager[object] = threading.Lock()
        self._window_ns = round(1e9 * window_s)
        self._begin()

    def _begin(self) -> None:
        """Begin with nothing known."""
        self.session = ""
        self._known = Snapshot(self.rig)
        """What is known but for samples, life and `_lasting`; replaced when it changes."""
        self._last_ns: int | None = None
        self._session_ns: int | None = None
        """Arrival of the first message of this session that was not asked for; None before it."""
        self._heartbeat_s = 0.5
        self._sequences: dict[str, int] = {}
        self._next_row: int | None = None
        self._is_begun = self._is_sampled = False
        self._sent_ns = 0
        self._holes: deque[tuple[int, int]] = deque(maxlen=HOLES_KEPT)
        self._channels: dict[tuple[str, int], Channels] = {}
        self._batches: deque[Received] = deque()
        self._lasting: dict[str, Content] = {}
        self._is_new = True
        self._former: deque[str] = deque(maxlen=SESSIONS_KEPT)
        self._lost_kinds: set[str] = set()
        self._lost_since_ns = 0

    def refuse(self, why: str) -> None:
        """Count a payload on the rig's keys that was not a valid message, with the reason."""
        self._known = replace(self._known, refused=self._known.refused + 1, refusal=why)

    def admit(self, content: Content, received_ns: int, *, is_proven: bool) -> None:
        """Check that a message may be the rig's: once it is proven, only what it has signed is.

        With the first message that is signed all that was said before is dropped. A signed message
        of another session is refused while the present one is heard, if it was sent before: then
        somebody repeats what the rig said once.

        Args:
            content: content of the message, from `unpack`.
            received_ns: time of its arrival by the reader's `SteadyClock`, ns since 1970.
            is_proven: whether the rig has signed it.

        Raises:
            MessageError: it is not to be taken.
        """
        if not is_proven:
            if self._known.proven:
                raise MessageError("not signed by the rig: another program speaks in its name")
            return
        if not self._known.proven:
            self._forget()
            return
        if content["session"] == self.session or content["sent_ns"] >= self._sent_ns:
            return
        if self._last_ns is not None and not self.is_silent(received_ns):
            raise MessageError("of an earlier session: another program repeats what the rig said")

    @property
    def is_proven(self) -> bool:
        """Whether the rig has proven to be this user's."""
        return self._known.proven

    @property
    def heard_ns(self) -> int:
        """Time of its last message by the reader's clock, ns since 1970; 0 if none came."""
        return self._last_ns or 0

    def is_silent(self, now_ns: int) -> bool:
        """Return whether no message has come for so long that the stream counts as dead."""
        return now_ns - self.heard_ns >= self._silence_ns

    def _newest(self, kind: str) -> int:
        """Number of the newest message of a kind in `LASTING` in this session; -1 if none is known.

        It is -1 for other kinds too, whose messages are told apart when they are stored.
        """
        return int(self._lasting.get(kind, {}).get("sequence", -1))

    @property
    def _silence_ns(self) -> float:
        """Time in ns without a message after which the stream counts as dead."""
        return 1e9 * DEAD_AFTER * self._heartbeat_s

    def _forget(self) -> None:
        """Drop all that was said before the rig was proven; it may have been anybody's."""
        refused, refusal = self._known.refused, self._known.refusal
        self._begin()
        self._known = replace(self._known, proven=True, refused=refused, refusal=refusal)

    def take(self, kind: str, content: Content, received_ns: int) -> None:
        """Store a message that the rig has just sent, and note which ones before it did not come.

        Samples are stored only if the message `channels` that names their columns came before. With
        the first message of another session that session begins: decision, health and the other
        kinds in `LASTING` of the former one are dropped.

        Args:
            kind: kind of the message.
            content: its content, from `unpack`.
            received_ns: time of its arrival by the reader's `SteadyClock`, ns since 1970.

        Raises:
            MessageError: the content is not valid for its kind; nothing of it is used.
        """
        held, sequence = read(kind, content), content["sequence"]
        if content["session"] != self.session:
            self._begin_session(content["session"])
        elif self._known.proven and sequence < self._newest(kind):
            raise MessageError("an earlier one again: another program repeats what the rig said")
        self._sent_ns = content["sent_ns"]
        self._session_ns = self._session_ns or received_ns
        self._miss_up_to(kind, sequence - 1, received_ns)
        self._sequences[kind] = max(sequence, self._sequences.get(kind, -1))
        if isinstance(held, Samples):
            self._append(held, received_ns)
        elif kind == "event":
            self._add_event(content)
        else:
            self._file(kind, held, content, received_ns)
        self._last_ns = received_ns

    def take_past(self, kind: str, content: Content, received_ns: int) -> None:
        """Store a past message that was asked for, unless it is known, superseded or too old.

        Too old is one of another session that was sent before the last message here; with one that
        was sent later, its session begins. Past samples fill gaps, and are stored only if the
        message `channels` that names their columns came before.

        Args:
            kind: kind of the message.
            content: its content, from `unpack`.
            received_ns: time of its arrival by the reader's `SteadyClock`, ns since 1970.

        Raises:
            MessageError: the content is not valid for its kind; nothing of it is used.
        """
        held = read(kind, content)
        if content["session"] != self.session:
            # The answer may be the first message that comes from a publisher that has restarted.
            if content["sent_ns"] < self._sent_ns:
                return
            self._begin_session(content["session"])
            self._sent_ns = content["sent_ns"]
        if isinstance(held, Samples):
            self._insert(held, received_ns)
        elif kind == "event":
            self._add_event(content, is_past=True)
        elif content["sequence"] >= self._lasting.get(kind, {"sequence": -1})["sequence"]:
            self._file(kind, held, content, received_ns)

    def to_ask_again(self) -> tuple[frozenset[str], int]:
        """Return the kinds of which messages were lost since the last call, and since when.

        The time is that of the last message before the first loss, as `received_ns`. Samples whose
        channels are not known are lost, and so is the message that names these.
        """
        kinds, self._lost_kinds = frozenset(self._lost_kinds), set()
        return kinds, self._lost_since_ns

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return what is known of the rig from all messages so far.

        Args:
            now_ns: the present time of the clock that gave `received_ns`, ns since 1970. The
                age of the last message, whether the rig is alive, and the rate follow from it; a
                past time does not bring back what was known then.
        """
        since_ns, last_ns = self._session_ns, self._last_ns
        age_s = None if since_ns is None or last_ns is None else 1e-9 * (now_ns - last_ns)
        # Both are needed, as a publisher that hangs keeps its token but sends no heartbeat.
        is_heard = age_s is not None and not self.is_silent(now_ns)
        newer_ns = now_ns - 10**9 if since_ns is None else max(now_ns - 10**9, since_ns - 1)
        recent = (batch for batch in self._batches if batch.received_ns > newer_ns)
        shown: dict[str, Any] = {kind: self._lasting.get(kind, {}) for kind in _SHOWN}
        if self._batches:
            samples, channels = self._batches[-1].samples, self._batches[-1].channels
            shown |= {"names": channels.names, "units": channels.units, "test": samples.test}
            shown["time_s"] = float(samples.time_s[-1])
            shown["latest"] = dict(zip(channels.names, _newest(samples.values), strict=True))
        return replace(
            self._known,
            session=self.session,
            alive=self.has_token and is_heard,
            age_s=age_s,
            is_sampled=self._is_sampled,
            rate_hz=float(sum(len(batch.samples.time_s) for batch in recent if not batch.is_past)),
            **shown,
        )

    def window(self, last_s: float, names: tuple[str, ...] = ()) -> Window:
        """Return the stored samples of the last seconds of rig time; all channels if none is named.

        The window may cover several tests, and has up to a batch more than asked for. Time between
        tests and gaps does not count. A channel is NaN in batches that do not have it.
        """
        batches = self._last_batches(last_s)
        if not names:
            names = tuple(dict.fromkeys(n for b in batches for n in b.channels.names))
        rows = [
            np.arange(len(b.samples.time_s), dtype=np.int64) + b.samples.first_row for b in batches
        ]
        sizes = [len(batch.samples.time_s) for batch in batches]
        return Window(
            row=np.concatenate([np.empty(0, np.int64), *rows]),
            time_s=np.concatenate([np.empty(0), *(b.samples.time_s for b in batches)]),
            test=np.repeat(np.array([b.samples.test for b in batches], np.int64), sizes),
            values={
                name: np.concatenate([np.empty(0, np.float32), *(b.column(name) for b in batches)])
                for name in names
            },
        )

    def _last_batches(self, last_s: float) -> list[Received]:
        """Return as few of the newest batches as together last `last_s` or longer, oldest first.

        If all stored batches together last less, all are returned.
        """
        chosen: list[Received] = []
        lasted = 0.0
        for batch in reversed(self._batches):
            if lasted >= last_s:
                break
            chosen.append(batch)
            lasted += len(batch.samples.time_s) * period_s(batch.samples)
        return chosen[::-1]

    def _begin_session(self, name: str) -> None:
        if self.session:
            self._known = replace(self._known, restarts=self._known.restarts + 1)
            self._former.append(self.session)
        if name in self._former:
            self.refuse("two programs speak in this rig's name in turn, and neither is proven")
        self.session, self._session_ns = name, None
        self._is_begun = self._is_sampled = False
        # The channels of the earlier session stay: if a stranger has sent this message, the rig's
        # next samples still need them.
        self._sequences.clear()
        # Test, verdict and trips of an earlier session are out of date, and its sequence numbers
        # cannot be compared with those of the new one.
        self._lasting.clear()

    def _miss_up_to(self, kind: str, sequence: int, received_ns: int) -> None:
        """Record as missing the messages of a kind after the last known one, up to `sequence`.

        The message with the number `sequence` is included. Nothing is recorded of a kind of which
        no message was received in this session.
        """
        last = self._sequences.get(kind, sequence)
        if sequence > last:
            self._lost(kind, sequence - last, received_ns)
            self._sequences[kind] = sequence

    def _lost(self, kind: str, missing: int, received_ns: int) -> None:
        known = self._known
        gaps = (*known.gaps, Gap(received_ns, kind, missing))[-GAPS_SHOWN:]
        counts = {**known.missing, kind: known.missing.get(kind, 0) + missing}
        self._known = replace(known, gaps=gaps, missing=counts)
        self._note_lost(kind, received_ns)

    def _note_lost(self, kind: str, received_ns: int) -> None:
        """Note that messages of a kind that came before this time are to be asked for again."""
        if kind in ASKED_AGAIN:
            if not self._lost_kinds:
                self._lost_since_ns = received_ns if self._last_ns is None else self._last_ns
            self._lost_kinds.add(kind)

    def _file(
        self, kind: str, held: Channels | Content, content: Content, received_ns: int
    ) -> None:
        """Store a message of a kind in `LASTING` as the newest of its kind.

        Channels are also stored by their number, a heartbeat shows which messages are missing, and
        a decision is added to the verdicts if verdict or test changed, or a run began.
        """
        if isinstance(held, Channels):
            self._channels[content["session"], held.number] = held
            while len(self._channels) > CHANNELS_KEPT:
                del self._channels[next(iter(self._channels))]
        elif kind == "heartbeat":
            self._heartbeat(content, received_ns)
        elif kind == "campaign":
            # The first verdict of a run is listed even if the run before ended with the same one.
            self._is_new |= content.get("begun_ns") != self._lasting.get(kind, {}).get("begun_ns")
        elif kind == "decision":
            verdicts, named = self._known.verdicts, ("verdict", "test")
            before = verdicts[-1] if verdicts else {}
            if self._is_new or any(before.get(name) != content.get(name) for name in named):
                self._known = replace(self._known, verdicts=(*verdicts, content)[-VERDICTS_SHOWN:])
            self._is_new = False
        self._lasting[kind] = content

    def _add_event(self, content: Content, *, is_past: bool = False) -> None:
        """Add an event that is not there yet: a new one at the end, a past one by its time."""
        events = self._known.events
        if all(_numbered(event) != _numbered(content) for event in events):
            events = (*events, content)
            events = tuple(sorted(events, key=_sent)) if is_past else events
            self._known = replace(self._known, events=events[-EVENTS_SHOWN:])

    def _has_rows(self, samples: Samples) -> bool:
        return any(samples.first_row == batch.samples.first_row for batch in self._batches)

    def _heartbeat(self, content: Content, received_ns: int) -> None:
        """Store a heartbeat's period, and record the messages that are missing by its numbers.

        Messages that were sent before the heartbeat and have not come by now are lost.
        """
        self._heartbeat_s = float(content["heartbeat_s"])
        for kind, sequence in content["sequences"].items():
            if kind != "heartbeat":
                self._miss_up_to(kind, sequence, received_ns)

    def _begin_rows(self, samples: Samples) -> None:
        """Drop all stored rows if a session's first batch does not come after them.

        They are of an earlier run then: a publisher that restarts within a run continues the row
        numbers. Later batches of the session drop nothing.
        """
        if not self._is_begun and samples.first_row < (self._next_row or 0):
            self._batches.clear()
            self._holes.clear()
            self._next_row = None
        self._is_begun = True

    def _append(self, samples: Samples, received_ns: int) -> None:
        self._begin_rows(samples)
        if samples.first_row < (self._next_row or 0) and self._has_rows(samples):
            return  # the answer to a question has brought these rows already
        end = samples.first_row + len(samples.time_s)
        if self._next_row is not None and samples.first_row > self._next_row:
            self._miss_rows(self._next_row, samples.first_row, received_ns)
        self._next_row = end
        channels = self._channels.get((self.session, samples.channels_id))
        if channels is None or len(channels.names) != samples.values.shape[1]:
            self._miss_rows(samples.first_row, end, received_ns)
            self._note_lost("channels", received_ns)
            self._note_lost("samples", received_ns)
            return
        self._is_sampled = True
        self._batches.append(Received(samples, channels, received_ns))
        while self._batches[0].received_ns < received_ns - self._window_ns:
            self._batches.popleft()

    def _miss_rows(self, begin: int, end: int, received_ns: int) -> None:
        """Record rows from `begin` to before `end` as missing, until past samples bring them."""
        self._lost("rows", end - begin, received_ns)
        self._holes.append((begin, end))

    def _insert(self, samples: Samples, received_ns: int) -> None:
        """Insert a past batch among the stored ones by row number, and fill the gaps with it.

        It is ignored if its rows are stored already, or if its channels are not known.
        """
        channels = self._channels.get((self.session, samples.channels_id))
        if channels is None or len(channels.names) != samples.values.shape[1]:
            return
        self._begin_rows(samples)
        if self._has_rows(samples):
            return
        self._fill(samples.first_row, samples.first_row + len(samples.time_s))
        self._is_sampled = True
        self._batches.append(Received(samples, channels, received_ns, is_past=True))
        ordered = sorted(self._batches, key=lambda batch: batch.samples.first_row)
        self._batches = deque(ordered)
        self._next_row = max(self._next_row or 0, samples.first_row + len(samples.time_s))

    def _fill(self, begin: int, end: int) -> None:
        """Take rows, from `begin` to before `end`, out of the gaps and out of the missing ones."""
        left: list[tuple[int, int]] = []
        missing = dict(self._known.missing)
        for first, last in self._holes:
            found = min(end, last) - max(begin, first)
            if found <= 0:
                left.append((first, last))
                continue
            missing["rows"] -= found
            left += [(first, begin)] * (first < begin) + [(end, last)] * (end < last)
        self._holes = deque(left, maxlen=HOLES_KEPT)
        if not missing.get("rows", 1):
            del missing["rows"]
        self._known = replace(self._known, missing=missing)


def _newest(values: NDArray[np.float32]) -> list[float]:
    """Return the newest value of each column (rows, columns); NaN for one without any."""
    there = ~np.isnan(values)
    rows = len(values) - 1 - np.argmax(there[::-1], axis=0)
    return [float(value) for value in values[rows, np.arange(values.shape[1])]]
