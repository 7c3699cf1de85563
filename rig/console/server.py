"""The console's web application: pages, login, orders by POST, and the live view by a websocket."""

import asyncio
import contextlib
import json
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from rig.accounts import AccountFile, Passwords, refusals
from rig.stream import StreamClient
from rig.surviving import Surviving
from rig.unique_keys import unique_keys

from .address import Address
from .feed import TICK_S, Cursor, Feed
from .guard import Guard, Refusals, address_of
from .launcher import Launcher, Served
from .logins import LoginFile
from .members import STOPPING_S, Members
from .orders import STOP, ForbiddenError, MalformedError, Orders, parse
from .preview import Preview
from .queue import Queue, QueueFile
from .visitors import LIFETIME_S, ControlHolder, LoginRefused, Visitor, Visitors

PAGE: Final = Path(__file__).parent / "page"
KINDS: Final = {
    ".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml",
}  # fmt: skip
LARGEST_MESSAGE: Final = 1024
"""Most bytes of one message that a page may send by its websocket."""
MESSAGES_PER_S: Final = 10
MOST_VIEWERS: Final = 40
ALIVE_S: Final = 0.5
"""Longest time in s without a message to a viewer, whose page thus sees that the console lives."""
LOOK_S: Final = 0.5
"""Period in s at which started runs, control and viewers are checked and shown."""
MOST_STOPS: Final = 16
"""Most stops that are carried out at once, in threads of their own beside those of other orders."""
MOST_WAITING: Final = 4
"""Most previews that are waited for at once, some seconds each; others wait for their turn."""
LONGEST_SPAN_S: Final = 8 * 3600
"""Longest stretch of the history that is sent in one answer, s: all that is kept."""
LATEST_S: Final = 1e11
"""Latest end of a stretch, s since 1970: far beyond any clock, and no number that overflows."""
LOGGED_OUT: Final = 4401
EXPIRED: Final = 4402
UNWELCOME: Final = 1008
TOO_LARGE: Final = 1009
FULL: Final = 1013


@dataclass
class Console:
    """The console as a web application, with its visitors, its launcher and its feed.

    Attributes:
        client: follows the streams; its owner closes it.
        token: the token that visitors log in with.
        address: address at which the console is served.
        served: the settings by which campaigns are started.
        log: is called with a line on each refusal and on each action of an operator.
        logins: keeps the logins over a restart of the console; None if they end with it.
        viewers: visitor -> number of live views that are open.
        accounts: the file of accounts by which visitors log in, in place of the token; None if the
            token is for whoever has it.
        passwords: compares their passwords; None for the usual costs.
    """

    client: StreamClient
    token: str
    address: Address
    served: Served
    log: Callable[[str], None]
    logins: LoginFile | None = None
    viewers: Counter[Visitor] = field(default_factory=Counter)
    accounts: AccountFile | None = None
    passwords: Passwords | None = None

    def __post_init__(self) -> None:
        self.feed = Feed(self.client)
        self.members: Members | None = None
        if self.accounts is not None:
            passwords = self.passwords or Passwords()
            self.members = Members(self.accounts, self.say, passwords, file=self.logins)
        self.visitors = Visitors(self.token, file=None if self.members else self.logins)
        self.control = ControlHolder(self.say)
        self.launcher = Launcher(self.served, self.say)
        file = QueueFile(self.served.folder.absolute())
        self.queue = Queue(file, self.launcher, self.client, self.say)
        if self.launcher.may_start:
            self.queue.offer()
        self.orders = Orders(self.client, self.control, self.launcher, self.queue, self.say)
        self.preview = Preview()
        self._working: asyncio.Future[None] | None = None
        self.cookie = f"rig-console-{self.address.port}"
        self._refused = Refusals(self.log)
        self._stopping = ThreadPoolExecutor(MOST_STOPS, "stop")
        # Who waits for a check does so in threads of their own, so that no order waits for them.
        self._checking = ThreadPoolExecutor(MOST_WAITING, "check")
        self._looked_at = 0.0
        self._survives = Surviving("the console", self.log)

    def say(self, text: str) -> None:
        """Log a text, and show it to all viewers as a notice."""
        self.log(text)
        self.feed.notice(text)

    def application(self) -> ASGIApp:
        """Return the guarded ASGI application that uvicorn serves."""
        routes = [
            Route("/", self._page, methods=["GET"]),
            Route("/login", self._login_page, methods=["GET"]),
            Route("/login", self._log_in, methods=["POST"]),
            Route("/logout", self._log_out, methods=["POST"]),
            Route("/order", self._order, methods=["POST"]),
            Route("/history", self._history, methods=["GET"]),
            Route("/preview", self._preview, methods=["GET"]),
            Route("/page/{name}", self._file, methods=["GET"]),
            WebSocketRoute("/live", self._live),
        ]
        inner = Starlette(routes=routes, lifespan=self._lifespan)
        return Guard(inner, self.address, self._refused)

    def _visitor(self, connection: HTTPConnection, *, acts: bool = False) -> Visitor | None:
        cookie = connection.cookies.get(self.cookie)
        if self.members is not None:
            return self.members.visitor(cookie, acts=acts)
        return self.visitors.visitor(cookie)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        following = asyncio.create_task(self._follow())
        ended = threading.Event()
        if self.members is not None:
            watch = self.members.watch
            threading.Thread(target=watch, args=(ended,), name="accounts", daemon=True).start()
        yield
        ended.set()
        following.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await following

    async def _follow(self) -> None:
        """Update the feed from the streams twenty times a second, until it is cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            now = loop.time()
            with self._survives:
                self.feed.tick(now)
                if now - self._looked_at >= LOOK_S:
                    self._looked_at = now
                    self._look()
                    self._work_off_queue()
            await asyncio.sleep(max(TICK_S - (loop.time() - now), TICK_S / 5))

    def _work_off_queue(self) -> None:
        """Have the queue looked after in a thread, unless that still goes on since the last time.

        The disk may hang, which must delay neither the live views nor a stop.
        """
        if not self.launcher.may_start or (self._working is not None and not self._working.done()):
            return

        def work() -> None:
            with self._survives:
                self.orders.work_off_queue()

        self._working = asyncio.get_running_loop().run_in_executor(None, work)

    def _look(self) -> None:
        """Check runs and refusals; update the sections on runs, control and viewers.

        All viewers are shown these sections.
        """
        with self._survives:  # an order that was obeyed is not reported as failed
            self._refused.look()
            self.launcher.look()
            holder = self.control.holder
            if self.members is not None and holder and not self.members.may_act(holder.number):
                self.orders.lapse(holder)
            running = self.launcher.present()
            if running is not None:
                self.orders.was_heard(running)
            content = self.launcher.content()
            if content["last"] is not None:
                content["last"]["rig"] = self.orders.rig_of_run(self.launcher.under_way())
            self.feed.common.put("launch", content)
            self.feed.common.put("queue", self.queue.content())
            is_here = self.control.holder in self.viewers
            self.feed.common.put("holder", {**self.control.content(), "here": is_here})
            watching = [{"number": who.number, "name": who.name} for who in self.viewers]
            self.feed.common.put("viewers", watching)

    async def _page(self, request: Request) -> Response:
        # Whose login has expired gets the page too, as stop is on it; it shows nothing of the rig.
        if self._visitor(request, acts=True) is None:
            return RedirectResponse("/login", status_code=303)
        return HTMLResponse((PAGE / "console.html").read_text())

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in {file.name for file in PAGE.iterdir()} or Path(name).suffix == ".html":
            return Response("not found\n", 404)
        file = PAGE / name
        return Response(file.read_bytes(), media_type=KINDS.get(file.suffix, "text/plain"))

    async def _login_page(self, request: Request) -> Response:
        visitor = self._visitor(request)
        if visitor is not None and not visitor.expired:
            return RedirectResponse("/", status_code=303)
        return self._login_form("")

    def _login_form(self, problem: str, status: int = 200, wait_s: float = 0.0) -> Response:
        name = "login.html" if self.members is None else "login_account.html"
        return _login_page(name, problem, status, wait_s)

    async def _log_in(self, request: Request) -> Response:
        address = address_of(request.scope)
        fields: dict[str, list[str]] = {}
        with contextlib.suppress(ValueError):
            fields = parse_qs((await _body(request)).decode(errors="replace"), max_num_fields=4)
        told = (fields.get(key, [""])[0] for key in ("token", "name", "password"))
        token, name, password = told
        try:
            if self.members is None:
                cookie, lasts_s = self.visitors.log_in(token, name, address), LIFETIME_S
            else:
                before = request.cookies.get(self.cookie)
                cookie = await self.members.log_in(name, password, address, before)
                lasts_s = LIFETIME_S + STOPPING_S
        except LoginRefused as refused:
            self._refused(address, f"login: {refused}")
            status = 429 if refused.wait_s else 403
            return self._login_form(str(refused), status, refused.wait_s)
        known = self.visitors if self.members is None else self.members
        visitor = known.visitor(cookie)
        assert visitor is not None
        self.log(f"{visitor.name} logs in, from {address}")
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(
            self.cookie, cookie, max_age=round(lasts_s), httponly=True, samesite="strict",
            secure=self.address.secure,
        )  # fmt: skip
        return answer

    async def _log_out(self, request: Request) -> Response:
        visitor = self._visitor(request)
        if visitor is not None:
            self.orders.leave(visitor)
            known = self.visitors if self.members is None else self.members
            known.log_out(request.cookies.get(self.cookie))
        answer = RedirectResponse("/login", status_code=303)
        answer.delete_cookie(self.cookie)
        return answer

    async def _order(self, request: Request) -> Response:
        visitor = self._visitor(request, acts=True)
        address = address_of(request.scope)
        if visitor is None:
            self._refused(address, "an order from nobody who is logged in")
            return JSONResponse({"accepted": False, "reason": "log in first"}, 401)
        try:
            if request.headers.get("content-type", "").split(";")[0] != "application/json":
                raise MalformedError("is not declared as JSON")
            order = parse(await _body(request))
        except MalformedError as error:
            self._refused(address, f"an order that {error}")
            return JSONResponse({"accepted": False, "reason": f"the order {error}"}, 400)
        threads = self._stopping if order.order == STOP else None
        loop = asyncio.get_running_loop()
        try:
            answer = await loop.run_in_executor(threads, self.orders.carry_out, order, visitor)
        except ForbiddenError as error:
            self._refused(address, f"{visitor.name}: {order.order}: {error}")
            refusal = {"accepted": False, "reason": str(error), "expired": visitor.expired}
            return JSONResponse(refusal, 401 if visitor.expired else 403)
        rig = order.rig if order.order == STOP else ""
        what = order.text if order.order in ("jog", "set") else ""
        about = " ".join(part for part in (order.order, rig, order.name, what) if part)
        refused = "" if answer.accepted else f" refused, {answer.reason}"
        tell = self.say if order.order == STOP else self.log
        # Whoever holds a button of manual mode sends twenty heartbeats a second.
        if order.order != "beat" or refused:
            tell(f"{visitor.name}: {about}{refused}")
            self._look()
        content = {"accepted": answer.accepted, "reason": answer.reason}
        return JSONResponse(content, 200 if answer.accepted else 409)

    async def _history(self, request: Request) -> Response:
        """Answer with a stretch of a rig's history: its header, and the values as binary floats.

        The query gives `rig`, `end_ms` (since 1970, or 0 for now), `span_s`, `steps` and `names`,
        with commas in between.
        """
        visitor = self._visitor(request)
        if visitor is None or visitor.expired:
            return JSONResponse({"reason": "log in first"}, 401)
        asked = request.query_params
        history = self.feed.history(asked.get("rig", ""))
        if history is None:
            return JSONResponse({"reason": "no history is kept of this rig"}, 404)
        try:
            end_s = int(asked.get("end_ms", "0")[:20]) / 1e3 or time.time_ns() * 1e-9
            span_s, steps = int(asked.get("span_s", "60")[:8]), int(asked.get("steps", "600")[:8])
        except ValueError:
            return JSONResponse({"reason": "end_ms, span_s and steps must be whole numbers"}, 400)
        if not (0 < span_s <= LONGEST_SPAN_S and steps > 0 and 0 < end_s < LATEST_S):
            return JSONResponse({"reason": f"span_s must be 1 to {LONGEST_SPAN_S}"}, 400)
        names = tuple(name for name in asked.get("names", "").split(",") if name)
        stretch = history.stretch(end_s, float(span_s), names, steps)
        head = {"x-history": stretch.header()}
        return Response(stretch.body(), 200, head, "application/octet-stream")

    async def _preview(self, request: Request) -> Response:
        """Answer with what a start of the query's `campaign` would do, by `rig check`."""
        visitor = self._visitor(request)
        if visitor is None or visitor.expired:
            return JSONResponse({"problems": ["log in first"]}, 401)
        words = self.launcher.to_check(request.query_params.get("campaign", ""))
        if words is None:
            return JSONResponse({"problems": ["this campaign is not offered"]}, 404)
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(self._checking, self.preview.of, words)
        return JSONResponse(found)

    async def _live(self, socket: WebSocket) -> None:
        visitor = self._visitor(socket)
        await socket.accept()
        if visitor is None:
            await self._end(socket, LOGGED_OUT, "a live view for nobody who is logged in")
            return
        if visitor.expired:
            await self._end(socket, EXPIRED, f"a live view for {visitor.name}, by an expired login")
            return
        if self.viewers.total() >= MOST_VIEWERS:
            await self._end(socket, FULL, f"more than {MOST_VIEWERS} viewers")
            return
        self.viewers[visitor] += 1
        cursor = Cursor()
        works = (self._show(socket, cursor, visitor), self._listen(socket, cursor))
        tasks = [asyncio.create_task(work) for work in works]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                # These errors only mean that the viewer has gone, which is no failure.
                gone = isinstance(ended, WebSocketDisconnect | RuntimeError)
                if isinstance(ended, Exception) and not gone:
                    self._survives.note(ended)
            self.viewers[visitor] -= 1
            if not self.viewers[visitor]:
                del self.viewers[visitor]

    async def _end(self, socket: WebSocket, code: int, why: str) -> None:
        """Log why a live view is refused, and close its websocket with a code."""
        self._refused(address_of(socket.scope), why)
        await socket.close(code)

    async def _show(self, socket: WebSocket, cursor: Cursor, visitor: Visitor) -> None:
        """Send a viewer the news, at most twenty times a second, until its login ends or it leaves.

        Without news, an empty message goes out every `ALIVE_S`.
        """
        await socket.send_text(self._about(visitor))
        loop = asyncio.get_running_loop()
        sent_at, role = loop.time(), visitor.role
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while (now := self._visitor(socket)) is not None and not now.expired:
                if now.role != role:
                    role = now.role
                    await socket.send_text(self._about(now))
                news = self.feed.news(cursor)
                if news is None and loop.time() - sent_at >= ALIVE_S:
                    news = "{}"
                if news is not None:
                    await socket.send_text(news)
                    sent_at = loop.time()
                await asyncio.sleep(TICK_S)
            await socket.close(LOGGED_OUT if now is None else EXPIRED)

    def _about(self, visitor: Visitor) -> str:
        """Return the message that tells a page whose it is, and what its role may not do."""
        about: dict[str, Any] = {
            "you": visitor.number, "name": visitor.name, "now_ms": time.time_ns() // 10**6,
        }  # fmt: skip
        if self.members is not None:
            about |= {"role": str(visitor.role), "may_not": refusals(visitor.role)}
        return json.dumps(about)

    async def _listen(self, socket: WebSocket, cursor: Cursor) -> None:
        """Receive a viewer's choices of a rig; close the websocket at any other message.

        It is also closed if more than `MESSAGES_PER_S` messages come within a second.
        """
        loop = asyncio.get_running_loop()
        taken: list[float] = []
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                if message.get("code") == TOO_LARGE:
                    self._refused(
                        address_of(socket.scope), f"a message of more than {LARGEST_MESSAGE} bytes"
                    )
                return
            taken = [at for at in taken if loop.time() - at < 1.0]
            taken.append(loop.time())
            rig = _chosen(message)
            too_many = len(taken) > MESSAGES_PER_S
            if rig is None or too_many:
                why = "too many messages" if too_many else "a malformed message"
                await self._end(socket, UNWELCOME, why)
                return
            cursor.choose(rig)


def _chosen(message: Any) -> str | None:
    """Return the rig that a websocket's message asks for; None if the message is malformed."""
    try:
        content = json.loads(message["text"], object_pairs_hook=unique_keys)
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or content.keys() != {"rig"}:
        return None
    rig = content["rig"]
    return rig if isinstance(rig, str) and len(rig) <= 200 else None


async def _body(request: Request) -> bytes:
    """Return the body of a request; empty if the sender disconnected meanwhile."""
    try:
        return await request.body()
    except ClientDisconnect:
        return b""


def _login_page(name: str, problem: str, status: int, wait_s: float) -> Response:
    page = (PAGE / name).read_text()
    headers = {"retry-after": str(round(wait_s) + 1)} if wait_s else {}
    shown = f'<p class="problem" role="alert">{problem}</p>' if problem else ""
    return HTMLResponse(page.replace("<!-- problem -->", shown), status, headers)
