"""A rig's messages are numbered, stored for late joiners, and sent without waiting for readers."""

import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from rig.surviving import Surviving, start, threads_granted

from .messages import KEPT, LASTING, VERSION, alive_key, key
from .steady_clock import SteadyClock
from .voice import Voice, said

QUESTIONS_KEPT: Final = 64
"""Most questions of late joiners that may wait; further ones are dropped without an answer."""
MESSAGES_KEPT: Final = 10_000
"""Most messages that are stored of each kind of `KEPT`: samples of minutes, or more events than a
rig has in a day."""


class StreamSender:
    """The sending end of one rig's stream, which is open until `close` is called.

    Args:
        session: an open Zenoh session, which is not closed here.
        rig: the rig's id.
        history_s: how long in s samples are stored for late joiners.
        on_failure: is called, from another thread, with a line on each answer to a late joiner that
            failed; later questions are answered all the same.
        voice: signs the messages; None if they are not signed.

    Attributes:
        name: random name of this session of the stream.
        sequences: kind -> sequence number of its newest message, from 0 on.

    Raises:
        OSError: the system grants no further thread.
    """

    def __init__(
        self,
        session: zenoh.Session,
        rig: str,
        history_s: float,
        on_failure: Callable[[str], None],
        voice: Voice | None = None,
    ) -> None:
        self.name = secrets.token_hex(8)
        self.sequences: dict[str, int] = {}
        self._rig = rig
        self._voice = voice
        self._session = session
        self._history_ns = round(1e9 * history_s)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._lasting: dict[str, bytes] = {}
        self._kept: dict[str, deque[tuple[int, bytes]]] = {kind: deque() for kind in KEPT}
        self._lock = threading.Lock()
        self._clock = SteadyClock()
        self._questions: queue.Queue[zenoh.Query | None] = queue.Queue(QUESTIONS_KEPT)
        self._survives = Surviving("answering late joiners", on_failure)
        self._answering = threading.Thread(target=self._answer, name="history", daemon=True)
        start(self._answering)
        self._token = session.liveliness().declare_token(alive_key(rig))
        # Zenoh starts a thread of Python for each function that it is to call.
        with threads_granted():
            self._queryable = session.declare_queryable(key(rig, "*"), self._asked)

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        """Number, store and send a message; it is dropped for readers that do not keep up.

        Of each kind in `LASTING` only the newest message is stored, of each kind in `KEPT` the
        newest `MESSAGES_KEPT`, and samples for `history_s` at most. The content must be such that
        `pack` can pack it, as what `finite` returns.
        """
        sequence = self.sequences.get(kind, -1) + 1
        self.sequences[kind] = sequence
        header = {
            "version": VERSION,
            "session": self.name,
            "sequence": sequence,
            "sent_ns": time.time_ns(),
        }
        payload = said({**header, **content}, key(self._rig, kind), self._voice)
        with self._lock:
            if kind in LASTING:
                self._lasting[kind] = payload
            elif kind in self._kept:
                kept = self._kept[kind]
                now_ns = self._clock.now_ns()
                kept.append((now_ns, payload))
                oldest_ns = now_ns - self._history_ns
                while (kind == "samples" and kept[0][0] < oldest_ns) or len(kept) > MESSAGES_KEPT:
                    kept.popleft()
        self._publisher(kind).put(payload)

    def close(self) -> None:
        """End the stream, but leave the Zenoh session open.

        Readers see at once, by the liveliness token, that the rig has gone.
        """
        self._queryable.undeclare()
        self._token.undeclare()
        with suppress(queue.Full):
            self._questions.put_nowait(None)
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _publisher(self, kind: str) -> zenoh.Publisher:
        if kind not in self._publishers:
            # All kinds have one priority, so a heartbeat arrives after the messages it counts.
            self._publishers[kind] = self._session.declare_publisher(
                key(self._rig, kind),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA,
            )
        return self._publishers[kind]

    def _asked(self, query: zenoh.Query) -> None:
        with suppress(queue.Full):
            self._questions.put_nowait(query)

    def _answer(self) -> None:
        """Answer questions one after the other until `close`.

        A slow reader only delays the answers to others, not the stream.
        """
        while True:
            query = self._questions.get()
            if query is None:
                return
            with self._survives, suppress(zenoh.ZError), query:
                for kind, payloads in self._asked_for(query).items():
                    for payload in payloads:
                        query.reply(key(self._rig, kind), payload)

    def _asked_for(self, query: zenoh.Query) -> dict[str, list[bytes]]:
        """Return, by kind, the packed messages that a question asks for by its key.

        Of kinds in `LASTING` it is the newest message. Of those in `KEPT` all that are stored are
        returned, or, if the question has a parameter `last`, those sent in the last `last` seconds.
        """
        since_ns = 0
        with suppress(ValueError):
            last_s = float(query.parameters.get("last") or "nan")
            if last_s >= 0.0:
                since_ns = self._clock.now_ns() - round(1e9 * min(last_s, 1e6))
        with self._lock:
            found = {kind: [payload] for kind, payload in self._lasting.items()}
            for kind, kept in self._kept.items():
                found[kind] = [payload for at_ns, payload in kept if at_ns >= since_ns]
        return {
            kind: payloads
            for kind, payloads in found.items()
            if query.key_expr.intersects(zenoh.KeyExpr(key(self._rig, kind)))
        }
