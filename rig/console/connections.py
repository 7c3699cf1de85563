"""Connections are limited here, so that idle or slow ones cannot keep others out."""

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_S: Final = 15.0
"""Longest time in s from the beginning of a connection, or the end of its last answer, to the end
of the next answer. It is longer than the longest order takes."""
MOST_CONNECTIONS: Final = 200
"""Most connections at a time. If one more comes, a websocket that was refused but not closed by the
browser is cut, or else the connection that has waited longest for its request to be complete."""


class Connection(H11Protocol):
    """An HTTP connection that is cut if it is slow, or if it would keep others out."""

    _until: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit; if there are too many connections, cut one.

        `MOST_CONNECTIONS` says which.
        """
        super().connection_made(transport)
        self._begin()
        if len(self.connections) >= MOST_CONNECTIONS:
            _make_room([each for each in self.connections if each is not self])

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the time limit, as the connection has ended."""
        self._end()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Start the time limit anew, for the next request."""
        self._begin()
        super().on_response_complete()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Stop the time limit, as the connection becomes a websocket, which has limits itself."""
        self._end()
        super().handle_websocket_upgrade(event)

    @property
    def waits_since(self) -> float | None:
        """A time that orders connections by how long they wait for a complete request.

        It is the time, in s of the event loop's clock, at which the limit ends; an earlier one has
        waited longer. None if the connection does not wait.
        """
        # `cycle` belongs to the newest request whose head was received; at first it is None.
        waits = not self.cycle or self.cycle.response_complete or self.cycle.more_body
        return self._until.when() if self._until is not None and waits else None

    def _begin(self) -> None:
        self._end()
        self._until = self.loop.call_later(REQUEST_S, self.transport.abort)

    def _end(self) -> None:
        if self._until is not None:
            self._until.cancel()
            self._until = None


def _make_room(others: list[Any]) -> None:
    """Cut as many connections as are too many: refused websockets first, then the longest waiting.

    The limit leaves room for one more beside `others`.
    """
    others = [other for other in others if not other.transport.is_closing()]
    too_many = len(others) + 1 - MOST_CONNECTIONS
    refused = [other for other in others if getattr(other, "close_sent", False)]
    waits = [each for each in others if isinstance(each, Connection) and each.waits_since]
    waits.sort(key=lambda each: each.waits_since or 0.0)
    for other in (refused + waits)[: max(too_many, 0)]:
        other.transport.abort()
