"""Follows the streams of rigs, and sends them commands; for consoles, monitors and scripts.

    with StreamClient(load_stream("loopback")) as client:
        client.wait_for_rig()
        print(client.snapshot().decision)

Messages are taken in threads of Zenoh; every method may be called from any thread. A reader that
does not keep up loses the oldest messages, and learns how many. Whatever anybody publishes, the
next message is taken as well: what is none is counted in the rig's snapshot, with the reason.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

import msgpack
import zenoh

from rig.surviving import Surviving

from .commands import Credentials, Sender, credentials_of
from .messages import (
    KEPT,
    LARGEST_MESSAGE,
    LASTING,
    MessageError,
    alive_key,
    command_key,
    key,
    rig_and_kind,
    unpack,
)
from .sessions import UnreachableError, check_files, subscriber_session
from .settings import CommandName, Endpoint, Operator, StreamSettings
from .view import RigView, Snapshot, Window

ANSWER_S: Final = 5.0
QUEUED: Final = 4096
"""Messages that may wait to be taken; the oldest go first."""
POLL_S: Final = 0.005
AGAIN_S: Final = 0.5
"""How long nothing is tried after a failure that was none of a message."""

OnMessage = Callable[[str, str, Mapping[str, Any]], None]


class UnknownRigError(LookupError):
    """No rig is known, or not the one asked for."""


@dataclass(frozen=True)
class Answer:
    """What became of a command.

    Attributes:
        accepted: whether the rig obeys.
        reason: why not; empty if it does.
    """

    accepted: bool
    reason: str = ""


class StreamClient:
    """Follows one rig, or all that can be reached; a context manager.

    Args:
        settings: the profile; `rig.configuration.rigs.stream.load_stream` reads one.
        connect: where to, instead of where the profile says.
        rig: its id; `*` for all.
        window_s: how long samples are kept.
        history: whether to ask rigs that appear for what was before.
        credentials: to command with; None: the profile's first operator, when needed.
        on_message: is called with rig, kind and content of each message, one at a time; what it
            raises goes to `on_failure`.
        on_failure: is called with a line on each failure of this program that following survived;
            from any thread. By default it is written to stderr.

    Raises:
        StreamError: the session cannot be opened; that nobody is there is no error.
    """

    def __init__(
        self,
        settings: StreamSettings,
        connect: Sequence[Endpoint] = (),
        *,
        rig: str = "*",
        window_s: float = 30.0,
        history: bool = True,
        credentials: Credentials | None = None,
        on_message: OnMessage | None = None,
        on_failure: Callable[[str], object] | None = None,
    ) -> None:
        self._settings = settings
        self._wanted = rig
        self._window_s = window_s
        self._history = history
        self._credentials = credentials
        self._on_message = on_message
        self._survives = Surviving("following the stream", on_failure or _to_stderr)
        self._sender: Sender | None = None
        self._views: dict[str, RigView] = {}
        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._connect = tuple(connect)
        self._session: zenoh.Session | None = None
        self._asking: list[threading.Thread] = []
        check_files(settings)
        if settings.mode != "client":
            self._follow()
        self._taking = threading.Thread(target=self._run, name="stream", daemon=True)
        self._taking.start()

    def __enter__(self) -> "StreamClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Follow no rig any more."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._taking.join()
        if self._session is not None:
            self._tokens.undeclare()
            self._session.close()
        # A thread that is still within Zenoh when the program ends would bring it down.
        for thread in self._asking:
            thread.join()

    def rigs(self) -> tuple[str, ...]:
        """Return the ids of all rigs that were heard of, dead ones included."""
        with self._lock:
            return tuple(sorted(self._views))

    def wait_for_rig(self, timeout_s: float = 5.0) -> str:
        """Return the id of the rig that is there, the first if there are several.

        Raises:
            UnknownRigError: none was heard of in time.
        """
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for rig in self.rigs():
                if self.snapshot(rig).alive:
                    return rig
            time.sleep(POLL_S)
        raise UnknownRigError("no rig is heard of; is one running, and with a stream?")

    def snapshot(self, rig: str | None = None) -> Snapshot:
        """Return what is known of a rig now; of the only one, if none is named.

        Raises:
            UnknownRigError: it was not heard of, or there are several.
        """
        with self._lock:
            return self._view(rig).snapshot(time.time_ns())

    def window(self, last_s: float, names: tuple[str, ...] = (), rig: str | None = None) -> Window:
        """Return a rig's samples of the last seconds, of all channels if none is named.

        Raises:
            UnknownRigError: it was not heard of, or there are several.
        """
        with self._lock:
            return self._view(rig).window(last_s, names)

    def history(self, last_s: float, rig: str | None = None, timeout_s: float = ANSWER_S) -> Window:
        """Ask a rig for what it still has of the last seconds, and return it with what came since.

        Raises:
            UnknownRigError: it was not heard of, or there are several.
        """
        with self._lock:
            view = self._view(rig)
        self._ask(view, last_s, timeout_s)
        return self.window(last_s, rig=view.rig)

    def send(
        self,
        command: CommandName,
        rig: str | None = None,
        text: str = "",
        timeout_s: float = ANSWER_S,
        test: str = "",
    ) -> Answer:
        """Send a command, and return the rig's answer, or an answer that says that nobody answers.

        Args:
            command: what to do.
            rig: its id; the only one, if not given.
            text: a remark, which is recorded with it.
            timeout_s: how long to wait.
            test: name of the test to skip or retry; the present one, if not given.

        Raises:
            UnknownRigError: the rig was not heard of, or there are several.
            KeyFileError: this end has no key.
        """
        with self._lock:
            view = self._view(rig)
            payload = self._signer().sign(view.rig, view.session, command, text, test)
        return self._answer_to(command_key(view.rig, command), payload, timeout_s)

    def _signer(self) -> Sender:
        if self._sender is None:
            operators = self._settings.operators or (Operator("local", ()),)
            self._sender = Sender(self._credentials or credentials_of(operators[0]))
        return self._sender

    def _answer_to(self, selector: str, payload: bytes, timeout_s: float) -> Answer:
        if self._session is None:
            return Answer(False, "no answer: there is no connection yet")
        try:
            for reply in self._session.get(selector, payload=payload, timeout=timeout_s):
                answer = None if reply.ok is None else _answer(bytes(reply.ok.payload))
                if answer is not None:
                    return answer
        except zenoh.ZError as error:
            return Answer(False, f"no answer: {error}")
        return Answer(False, "no answer: the rig takes no commands from here, or is not there")

    def _view(self, rig: str | None) -> RigView:
        if rig is None:
            if len(self._views) != 1:
                known = ", ".join(sorted(self._views)) or "none"
                raise UnknownRigError(f"name the rig; known are: {known}")
            return next(iter(self._views.values()))
        if rig not in self._views:
            raise UnknownRigError(f"rig {rig} was not heard of")
        return self._views[rig]

    def _view_of(self, rig: str) -> RigView:
        if rig not in self._views:
            self._views[rig] = RigView(rig, self._window_s)
        return self._views[rig]

    def _token_changed(self, sample: zenoh.Sample) -> None:
        with self._survives, suppress(MessageError):
            rig, _ = rig_and_kind(str(sample.key_expr))
            present = sample.kind == zenoh.SampleKind.PUT
            with self._lock:
                view = self._view_of(rig)
                view.token(present=present)
            if present and self._history:
                # Answers come in threads of Zenoh, of which this is one: it must not wait for them.
                asking = threading.Thread(target=self._ask, args=(view, self._window_s, ANSWER_S))
                self._asking = [*(each for each in self._asking if each.is_alive()), asking]
                asking.start()

    def _ask(self, view: RigView, last_s: float, timeout_s: float) -> None:
        """Ask a rig for what lasts, channels first, and then for what it keeps."""
        for kinds, parameters in ((LASTING, ""), (KEPT, f"?last={last_s:g}")):
            for kind in kinds:
                if self._closing.is_set() or self._session is None:
                    return
                with self._survives, suppress(zenoh.ZError):
                    replies = self._session.get(
                        key(view.rig, kind) + parameters,
                        timeout=timeout_s,
                        consolidation=zenoh.ConsolidationMode.NONE,
                        # The past waits for the present: answers are sent as the question was.
                        priority=zenoh.Priority.DATA_LOW,
                        congestion_control=zenoh.CongestionControl.BLOCK,
                    )
                    for reply in replies:
                        if reply.ok is not None:
                            self._take_past(view, kind, reply.ok)

    def _take_past(self, view: RigView, kind: str, sample: zenoh.Sample) -> None:
        with self._left_aside(view):
            content = _content(sample)
            with self._lock:
                view.take_past(kind, content, time.time_ns())

    def _follow(self) -> None:
        session = subscriber_session(self._settings, self._connect)
        try:
            keys = key(self._wanted, "*")
            self._messages = session.declare_subscriber(keys, zenoh.handlers.RingChannel(QUEUED))
            self._session = session
            self._tokens = session.liveliness().declare_subscriber(
                alive_key(self._wanted), self._token_changed, history=True
            )
        except BaseException:
            self._session = None
            session.close()
            raise

    def _run(self) -> None:
        """Take messages until closed; a failure is reported, and what failed is tried again."""
        while not self._closing.is_set():
            with self._survives:
                if self._session is None:
                    # A router that is not there yet is waited for.
                    with suppress(UnreachableError):
                        self._follow()
                    continue
                self._take_messages()
            self._closing.wait(AGAIN_S)

    def _take_messages(self) -> None:
        while not self._closing.is_set():
            sample = self._messages.try_recv()
            if sample is None:
                self._closing.wait(POLL_S)
                continue
            with self._survives:
                self._take(sample)

    def _take(self, sample: zenoh.Sample) -> None:
        try:
            rig, kind = rig_and_kind(str(sample.key_expr))
        except MessageError:
            return
        with self._lock:
            view = self._views.get(rig)
        with self._left_aside(view):
            content = _content(sample)
            with self._lock:
                self._view_of(rig).take(kind, content, time.time_ns())
            if self._on_message is not None:
                self._on_message(rig, kind, content)

    @contextmanager
    def _left_aside(self, view: RigView | None) -> Iterator[None]:
        """Take a message; whoever may publish may publish nonsense, which is counted."""
        try:
            yield
        except MessageError as error:
            if view is not None:
                with self._lock:
                    view.refuse(str(error))


def _content(sample: zenoh.Sample) -> dict[str, Any]:
    if len(sample.payload) > LARGEST_MESSAGE:
        raise MessageError("too large")
    return unpack(bytes(sample.payload))


def _answer(payload: bytes) -> Answer | None:
    """Return the answer to a command; None if it is none."""
    with suppress(Exception):  # whatever a parser makes of bytes that may be anything
        reply = msgpack.unpackb(payload, max_map_len=8)
        accepted, reason = reply["accepted"], reply["reason"]
        if type(accepted) is bool and type(reason) is str:
            return Answer(accepted, reason)
    return None


def _to_stderr(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
