"""The console's server is configured and run here, until a signal ends it."""

import signal
import socket
from collections.abc import Callable
from typing import Final

import uvicorn

from rig.stream import StreamClient

from .address import Address, with_port
from .connections import MOST_CONNECTIONS, Connection
from .server import LARGEST_MESSAGE, Console, Served

BACKLOG: Final = 64
END_S: Final = 2
"""Time in s that open connections get to close, once the server is to end."""
LARGEST_HEADERS: Final = 16_384
"""Most bytes that the head of a request may have."""


def serve(
    client: StreamClient,
    token: str,
    served: Served,
    address: Address,
    *,
    log: Callable[[str], None],
    ready: Callable[[str], None],
) -> None:
    """Serve a console; return after SIGINT or SIGTERM.

    Args:
        client: follows the streams.
        token: the token that visitors log in with.
        served: the campaigns, folder, profile and rig of the console.
        address: address at which it listens; port 0 means any free one.
        log: is called with a line on each refusal and on each action of an operator.
        ready: is called with the URL once the port is open.

    Raises:
        OSError: the address cannot be used, for example because the port is taken.
    """
    listener = listener_of(address)
    address = with_port(address, listener.getsockname()[1])
    # uvicorn raises the signal that has ended it again, which must not end this process.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    with listener:
        server = server_of(Console(client, token, address, served, log))
        ready(address.url)
        server.run(sockets=[listener])


def server_of(console: Console) -> uvicorn.Server:
    """Return the configured uvicorn server of a console, which is not running yet."""
    config = uvicorn.Config(
        console.application(),
        ws="websockets-sansio",
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
