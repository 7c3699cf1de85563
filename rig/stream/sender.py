"""Sends a rig's messages: numbered, kept for late joiners, and never waiting for a reader."""

import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from rig.surviving import Surviving

from .messages import KEPT, LASTING, VERSION, alive_key, key, pack

QUESTIONS_KEPT: Final = 64
"""Late joiners' questions that may wait; more are not answered, and ask again."""
MESSAGES_KEPT: Final = 10_000
"""Messages that are kept of either kind of `KEPT`: samples of minutes, and more events than a rig
has in a day."""

_BEFORE_ALL: Final = -1


class StreamSender:
    """The sending end of one rig's stream, from its making to `close`.

    Args:
        session: opened; is not closed.
        rig: the rig's id.
        history_s: how long samples are kept for late joiners.
        on_failure: is called, from another thread, with a line on an answer to a late joiner that
            failed; the next one is answered.

    Attributes:
        name: of this session of the stream, new with every publisher.
        sequences: number of the newest message of each kind.
    """

    def __init__(
        self,
        session: zenoh.Session,
        rig: str,
        history_s: float,
        on_failure: Callable[[str], object] = lambda line: None,
    ) -> None:
        self.name = secrets.token_hex(8)
        self.sequences: dict[str, int] = {}
        self._rig = rig
        self._session = session
        self._history_ns = round(1e9 * history_s)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._lasting: dict[str, bytes] = {}
        self._kept: dict[str, deque[tuple[int, bytes]]] = {kind: deque() for kind in KEPT}
        self._lock = threading.Lock()
        self._questions: queue.Queue[zenoh.Query | None] = queue.Queue(QUESTIONS_KEPT)
        self._survives = Surviving("answering late joiners", on_failure)
        self._answering = threading.Thread(target=self._answer, name="history", daemon=True)
        self._answering.start()
        self._token = session.liveliness().declare_token(alive_key(rig))
        self._queryable = session.declare_queryable(key(rig, "*"), self._asked)

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message; it is dropped for readers that do not keep up."""
        sequence = self.sequences.get(kind, _BEFORE_ALL) + 1
        self.sequences[kind] = sequence
        now_ns = time.time_ns()
        header = {"version": VERSION, "session": self.name, "sequence": sequence, "sent_ns": now_ns}
        payload = pack({**header, **content})
        self._keep(kind, now_ns, payload)
        self._publisher(kind).put(payload)

    def close(self) -> None:
        """End the stream: readers see at once that the rig is no longer there."""
        self._queryable.undeclare()
        self._token.undeclare()
        with suppress(queue.Full):
            self._questions.put_nowait(None)
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _publisher(self, kind: str) -> zenoh.Publisher:
        if kind not in self._publishers:
            # All of one priority: a heartbeat then arrives after what it says was sent before it.
            self._publishers[kind] = self._session.declare_publisher(
                key(self._rig, kind),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA,
            )
        return self._publishers[kind]

    def _keep(self, kind: str, now_ns: int, payload: bytes) -> None:
        with self._lock:
            if kind in LASTING:
                self._lasting[kind] = payload
            elif kind in self._kept:
                kept = self._kept[kind]
                kept.append((now_ns, payload))
                oldest_ns = now_ns - self._history_ns
                while (kind == "samples" and kept[0][0] < oldest_ns) or len(kept) > MESSAGES_KEPT:
                    kept.popleft()

    def _asked(self, query: zenoh.Query) -> None:
        with suppress(queue.Full):
            self._questions.put_nowait(query)

    def _answer(self) -> None:
        """Answer questions, one after the other; a reader that is slow delays the next one only."""
        while True:
            query = self._questions.get()
            if query is None:
                return
            with self._survives, suppress(zenoh.ZError), query:
                self._reply(query)

    def _reply(self, query: zenoh.Query) -> None:
        for kind, payloads in self._asked_for(query).items():
            for payload in payloads:
                query.reply(key(self._rig, kind), payload)

    def _asked_for(self, query: zenoh.Query) -> dict[str, list[bytes]]:
        """Return the messages that a question is about, by kind."""
        since_ns = 0
        with suppress(ValueError):
            last_s = float(query.parameters.get("last") or "nan")
            if last_s >= 0.0:
                since_ns = time.time_ns() - round(1e9 * min(last_s, 1e6))
        with self._lock:
            found = {kind: [payload] for kind, payload in self._lasting.items()}
            for kind, kept in self._kept.items():
                found[kind] = [payload for at_ns, payload in kept if at_ns >= since_ns]
        return {
            kind: payloads
            for kind, payloads in found.items()
            if query.key_expr.intersects(zenoh.KeyExpr(key(self._rig, kind)))
        }
