"""The guard refuses requests that do not come from the console's own page, or are too large.

Any page that a user visits can make the browser send requests to a console, but it cannot forge the
headers Origin and Host. A request from another origin, or under a name that is not the console's
(DNS rebinding), is therefore refused; a websocket is refused before it is opened. Refusals are
logged, but so few per second that an attacker cannot fill the disk with the log.
"""

import time
from collections.abc import Callable
from typing import Final

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .address import Address

LARGEST_BODY: Final = 4096
"""Most bytes that the body of a request may have."""
MOST_PER_S: Final = 20
"""Most refusals that are logged within a second; further ones are only counted."""

_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_HEADERS: Final = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


class Refusals:
    """A log of refusals with a limited rate.

    Args:
        log: is called with each line.
    """

    def __init__(self, log: Callable[[str], None]) -> None:
        self._log = log
        self._since = time.monotonic()
        self._count = 0

    def __call__(self, address: str, why: str) -> None:
        """Log that a request from an address was refused, and why.

        After `MOST_PER_S` refusals within a second, further ones are only counted.
        """
        self.look()
        self._count += 1
        if self._count <= MOST_PER_S:
            self._log(f"refused, from {address}: {why}")

    def look(self) -> None:
        """Begin a new second if the present one is over.

        The number of refusals in it that were only counted is logged then, if there were any.
        """
        now = time.monotonic()
        if now - self._since < 1.0:
            return
        if self._count > MOST_PER_S:
            self._log(f"refused: {self._count - MOST_PER_S} more, not told one by one")
        self._since, self._count = now, 0


class Guard:
    """An ASGI application that refuses foreign requests and adds security headers to all answers.

    Args:
        application: the application that serves the other requests.
        address: the console's address, whose names are the allowed values of the header Host.
        refused: takes each refusal.
    """

    def __init__(self, application: ASGIApp, address: Address, refused: Refusals) -> None:
        self._application = application
        self._hosts = address.names
        scheme = "https" if address.secure else "http"
        self._origins = frozenset(f"{scheme}://{host}" for host in address.names)
        lasting = (b"strict-transport-security", b"max-age=31536000")
        self._headers = (*_HEADERS, lasting) if address.secure else _HEADERS
        self._refused = refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it on to the application; `lifespan` events pass unchecked."""
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        problem = self._problem(scope)
        if problem:
            status, text = problem
            self._refused(address_of(scope), text)
            if scope["type"] == "websocket":
                # A websocket that is closed before it is accepted gets the status 403.
                await send({"type": "websocket.close", "code": 1008, "reason": ""})
                return
            headers = [(b"content-type", b"text/plain; charset=utf-8"), *self._headers]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": f"refused: {text}\n".encode()})
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self._headers]
            await send(message)

        await self._application(scope, self._limited(scope, receive), with_headers)

    def _problem(self, scope: Scope) -> tuple[int, str] | None:
        """Return HTTP status and reason if a request is to be refused; else None."""
        given = Headers(scope=scope)
        host, origin = given.getlist("host"), given.getlist("origin")
        if len(host) != 1 or host[0].lower() not in self._hosts:
            return 421, f"the name {', '.join(host)[:80]!r} is not this console's"
        acts = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if acts and (len(origin) != 1 or origin[0] not in self._origins):
            return 403, f"a request from another site ({', '.join(origin)[:80]})"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, f"the method {scope['method'][:20]}"
        if not scope["query_string"].isascii():
            return 400, "a query that is not ASCII"
        length = given.get("content-length", "")
        if length.isdecimal() and int(length) > LARGEST_BODY:
            return 413, f"a body of {length} bytes, more than {LARGEST_BODY}"
        return None

    def _limited(self, scope: Scope, receive: Receive) -> Receive:
        """Return a `receive` for an HTTP request that limits its body; unchanged for a websocket.

        It logs and raises an HTTPException 413 once the body exceeds `LARGEST_BODY`.
        """
        if scope["type"] != "http":
            return receive
        taken = 0

        async def receive_some() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > LARGEST_BODY:
                text = f"a body of more than {LARGEST_BODY} bytes"
                self._refused(address_of(scope), text)
                raise HTTPException(413, text)
            return message

        return receive_some


def address_of(scope: Scope) -> str:
    """Return the IP address that a request comes from; "unknown" if there is none."""
    client = scope.get("client")
    return client[0] if client else "unknown"
