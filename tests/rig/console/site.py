"""Serves a console in a thread, with a stream that the test feeds, and sends requests to it."""

import asyncio
import http.client
import json
import re
import ssl
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from websockets.sync.client import ClientConnection, connect

from rig.accounts import AccountFile, Passwords
from rig.console.address import address_of, with_port
from rig.console.launcher import Served
from rig.console.running import listener_of, server_of
from rig.console.server import Console

from .fakes import RUNNING, FakeClient, until

TOKEN = "cd" * 32
CHEAP = Passwords(memory_kib=8, passes=1)
"""Passwords that are hashed quickly, for tests whose claim is not the cost."""
NOTHING_SERVED = Served()
Headers = dict[str, str]


@dataclass
class Reply:
    """The reply to a request; the names of its headers are in lower case."""

    status: int
    headers: Headers
    text: str


@dataclass
class Site:
    """A console of one rig that is served in a thread.

    Attributes:
        client: the stream that the test feeds.
        console: the console itself.
        port: its port on 127.0.0.1.
        log: lines that the console has logged.
        certificate: certificate of the console, if it is served over TLS.
    """

    client: FakeClient
    console: Console
    port: int
    log: list[str] = field(default_factory=list)
    certificate: Path | None = None

    @property
    def origin(self) -> str:
        return f"http{'s' if self.certificate else ''}://127.0.0.1:{self.port}"

    def ask(
        self, method: str, path: str, body: str | bytes = "", headers: Headers | None = None
    ) -> Reply:
        """Send a request and return the reply.

        The header Origin is that of the console's own page, unless `headers` has another; a header
        with an empty value is not sent.
        """
        connection = self._connection()
        sent_headers = {"Origin": self.origin} | (headers or {})
        connection.putrequest(method, path, skip_host="Host" in sent_headers)
        for name, value in sent_headers.items():
            if value:
                connection.putheader(name, value)
        content = body.encode() if isinstance(body, str) else body
        if "Transfer-Encoding" not in sent_headers:
            connection.putheader("Content-Length", str(len(content)))
        connection.endheaders()
        connection.send(content)
        got = connection.getresponse()
        headers = {k.lower(): v for k, v in got.getheaders()}
        reply = Reply(got.status, headers, got.read().decode(errors="replace"))
        connection.close()
        return reply

    def _connection(self) -> http.client.HTTPConnection:
        if self.certificate is None:
            return http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        trusted = ssl.create_default_context(cafile=self.certificate)
        return http.client.HTTPSConnection("127.0.0.1", self.port, timeout=30, context=trusted)

    def log_in(self, name: str = "Anna", token: str = TOKEN, **headers: str) -> Reply:
        form = urlencode({"name": name, "token": token})
        return self.ask("POST", "/login", form, headers)

    def member(self, name: str, password: str, **headers: str) -> Reply:
        """Log in by an account."""
        return self.ask("POST", "/login", urlencode({"name": name, "password": password}), headers)

    def cookie(self, name: str = "Anna") -> Headers:
        """Log in, and return the Cookie header of the visitor's further requests."""
        return {"Cookie": self.log_in(name).headers["set-cookie"].partition(";")[0]}

    def order(self, who: Headers, **content: Any) -> tuple[int, dict[str, Any]]:
        headers = {"Content-Type": "application/json", **who}
        reply = self.ask("POST", "/order", json.dumps(content), headers)
        return reply.status, json.loads(reply.text)

    def live(self, who: Headers, **headers: str) -> ClientConnection:
        url = f"ws://127.0.0.1:{self.port}/live"
        sent_headers = {"Origin": self.origin} | headers
        origin = sent_headers.pop("Origin")
        return connect(url, origin=origin or None, additional_headers={**who, **sent_headers})  # type: ignore[arg-type]

    def is_logged(self, pattern: str) -> bool:
        return any(re.search(pattern, line) for line in list(self.log))


@contextmanager
def site_served(
    leaving: ExitStack,
    certificate: Path | None = None,
    key: Path | None = None,
    accounts: AccountFile | None = None,
    served: Served = NOTHING_SERVED,
) -> Iterator[Site]:
    """Serve a console of one rig on which a campaign runs, and yield it.

    With `certificate` and `key` it is served over TLS, and with `accounts` one logs in by these.
    The server takes a fifth of a second to end; `leaving` waits for that later.
    """
    anywhere = address_of("127.0.0.1:0", (), certificate, key)
    listener = listener_of(anywhere)
    address = with_port(anywhere, listener.getsockname()[1])
    client = FakeClient(RUNNING)
    log: list[str] = []
    console = Console(
        client, TOKEN, address, served, log.append, accounts=accounts, passwords=CHEAP
    )
    server = server_of(console)
    serving = threading.Thread(target=lambda: asyncio.run(server.serve(sockets=[listener])))
    serving.start()
    until(lambda: server.started, "the server to start")
    try:
        yield Site(client, console, address.port, log, certificate)
    finally:
        server.should_exit = True
        leaving.callback(listener.close)
        leaving.callback(serving.join)
