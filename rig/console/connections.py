"""Connections that send nothing, or too slowly, keep nobody else out."""

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_S: Final = 15.0
"""How long a request may take, from its connection, or the one before, to its answer's end; longer
than the longest order."""
MOST_CONNECTIONS: Final = 200
"""Connections at a time; for one more, a websocket that was refused and stays is closed, or else
the connection that has waited longest for its request to be complete."""


class Connection(H11Protocol):
    """A connection by HTTP that ends if it is slow, or if others are kept out by it."""

    _until: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin; the oldest that is idle makes room."""
        super().connection_made(transport)
        self._begin()
        if len(self.connections) >= MOST_CONNECTIONS:
            _make_room([each for each in self.connections if each is not self])

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._end()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._begin()
        super().on_response_complete()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Become a websocket, which has its own limits."""
        self._end()
        super().handle_websocket_upgrade(event)

    @property
    def waits_since(self) -> float | None:
        """When this connection began to wait for a whole request, s; None if it does not wait."""
        # The cycle is of the newest request whose head has come; before the first there is none.
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
    """Close what is too many: websockets that were refused and stay, then the longest waiting."""
    others = [other for other in others if not other.transport.is_closing()]
    too_many = len(others) + 1 - MOST_CONNECTIONS
    refused = [other for other in others if getattr(other, "close_sent", False)]
    waits = [each for each in others if isinstance(each, Connection) and each.waits_since]
    waits.sort(key=lambda each: each.waits_since or 0.0)
    for other in (refused + waits)[: max(too_many, 0)]:
        other.transport.abort()
