"""The console's server is configured and run here, until a signal ends it.

Its connections are limited, so that idle or slow ones cannot keep others out.
"""

import asyncio
import signal
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from rig.accounts import AccountFile
from rig.stream import StreamClient

from .address import Address, with_port
from .launcher import Served
from .logins import account_logins, login_file
from .server import LARGEST_MESSAGE, Console

BACKLOG: Final = 64
END_S: Final = 2
"""Time in s that open connections get to close, once the server is to end."""
LARGEST_HEADERS: Final = 16_384
"""Most bytes that the head of a request may have."""
REQUEST_S: Final = 15.0
"""Longest time in s from the beginning of a connection, or the end of its last answer, to the end
of the next answer. It is longer than the longest order takes."""
MOST_CONNECTIONS: Final = 200
"""Most connections at a time. If one more comes, a websocket that was refused but not closed by the
browser is cut, or else the connection that has waited longest for its request to be complete."""


def serve(
    client: StreamClient,
    token: str,
    served: Served,
    address: Address,
    *,
    log: Callable[[str], None],
    ready: Callable[[str], None],
    secrets: Path | None = None,
    accounts: AccountFile | None = None,
) -> None:
    """Serve a console until SIGINT or SIGTERM, then return.

    The handlers of both signals are replaced, so that they no longer end the process.

    Args:
        client: follows the streams.
        token: the token that visitors log in with.
        served: the campaigns, folder, profile and rig of the console.
        address: address at which it listens; port 0 means any free one.
        log: is called with a line on each refusal and on each action of an operator.
        ready: is called with the URL once the port is open.
        secrets: this user's folder of keys and tokens, in which logins are kept over a restart.
            Without it, and if the address leaves the port open, they end with the console.
        accounts: the file of accounts by which visitors log in, in place of the token.

    Raises:
        AccountsError: the file of accounts cannot be used, or holds no account.
        OSError: the address cannot be used, for example because the port is taken.
    """
    listener = listener_of(address)
    logins = None
    if secrets is not None and address.port:
        logins = (
            login_file(secrets, address.port, token)
            if accounts is None
            else account_logins(secrets, address.port, accounts.path)
        )
    address = with_port(address, listener.getsockname()[1])
    # uvicorn raises the signal that has ended it again, which must not end this process.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    with listener:
        server = server_of(Console(client, token, address, served, log, logins, accounts=accounts))
        ready(address.url)
        server.run(sockets=[listener])


def server_of(console: Console) -> uvicorn.Server:
    """Return the configured uvicorn server of a console, which is not running yet."""
    config = uvicorn.Config(
        console.application(),
        ws=LiveConnection,
        ws_max_size=LARGEST_MESSAGE,
        ws_per_message_deflate=False,
        ws_ping_interval=5.0,
        ws_ping_timeout=20.0,
        http=Connection,
        h11_max_incomplete_event_size=LARGEST_HEADERS,
        limit_concurrency=2 * MOST_CONNECTIONS,
        timeout_graceful_shutdown=END_S,
        access_log=False,
        log_config=None,
        server_header=False,
        proxy_headers=False,
        ssl_certfile=console.address.certificate,
        ssl_keyfile=console.address.key,
    )
    return uvicorn.Server(config)


def listener_of(address: Address) -> socket.socket:
    """Return a socket that listens at an address.

    Raises:
        OSError: the address cannot be used, for example because the port is taken.
    """
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((address.host, address.port))
    except OSError as error:
        listener.close()
        where = f"{address.host}:{address.port}"
        reason = f"{error.strerror}; give another --listen"
        raise OSError(f"cannot listen on {where}: {reason}") from None
    listener.listen(BACKLOG)
    return listener


class Connection(H11Protocol):
    """An HTTP connection that is cut if it is slow, or if it would keep others out."""

    _until: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit `REQUEST_S`; if there are too many connections, cut an older one.

        More than `MOST_CONNECTIONS` are too many. A refused websocket is cut first, else the
        connection that has waited longest for its request to be complete.
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


class LiveConnection(WebSocketsSansIOProtocol):
    """A websocket connection on which a text message that is not UTF-8 is refused, not an error."""

    def send_receive_event_to_app(self) -> None:
        """Hand a message on to the console; a text message that is not UTF-8 becomes one of bytes.

        uvicorn itself would log the error with all calls that have led to it, though nothing but
        the viewer's message is wrong.
        """
        try:
            b"".join(self.frames).decode()
        except UnicodeDecodeError:
            self.curr_msg_data_type = "bytes"
        super().send_receive_event_to_app()


def _make_room(others: list[Any]) -> None:
    """Cut so many of `others` that they are fewer than `MOST_CONNECTIONS`.

    Refused websockets are cut first, then the connections that have waited longest for their
    requests to be complete. Connections that do not wait are never cut.
    """
    others = [other for other in others if not other.transport.is_closing()]
    too_many = len(others) + 1 - MOST_CONNECTIONS
    refused = [other for other in others if getattr(other, "close_sent", False)]
    waits = [each for each in others if isinstance(each, Connection) and each.waits_since]
    waits.sort(key=lambda each: each.waits_since or 0.0)
    for other in (refused + waits)[: max(too_many, 0)]:
        other.transport.abort()
