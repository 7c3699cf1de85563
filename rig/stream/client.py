"""A client follows the streams of rigs and sends them commands, for consoles and scripts.

    with StreamClient(load_stream("loopback")) as client:
        client.wait_for_rig()
        print(client.snapshot().decision)

Messages are received in a thread of the client; every method may be called from any thread. A
reader that does not keep up loses the oldest messages, and the snapshot counts them. Payloads that
are not valid messages are counted in the rig's snapshot, with the reason of the last one, and the
client goes on.
"""

import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext, suppress
from functools import cached_property
from math import inf
from typing import Any, Final

import msgpack
import zenoh

from rig.surviving import Surviving

from .answers import Answer, answered
from .commands import Credentials, Sender, asked_digest, credentials_of
from .heard_rigs import HeardRigs
from .known import Snapshot, UnknownRigError, Window
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
from .steady_clock import SteadyClock
from .view import RigView
from .voice import MAC, reader_s_voice_of

ANSWER_S: Final = 5.0
QUEUED: Final = 4096
"""Most messages that may wait to be processed; if there are more, the oldest are dropped."""
POLL_S: Final = 0.005
LOOK_S: Final = 0.05
"""Time in s between two looks whether messages were lost."""
AGAIN_S: Final = 0.5
"""Time in s before the client tries again after an error that concerns no single message."""
ASKED_PART: Final = 0.1
"""Most part of the time in which a rig is asked for lost messages again.

A reader that loses because it is slow is thus not made slower by what it asks for.
"""
ASK_S: Final = 0.5
"""Least time in s between two such questions."""
LATE_S: Final = 2.0
"""Time in s by which a question for lost messages reaches farther back than the loss, as it may
wait before it is answered."""
ATTEMPT_S: Final = 1.0
"""Time in s for which each attempt of `StreamClient.send_until_heard` waits for an answer."""
HEARD_AGAIN_S: Final = 0.1
"""Pause in s between two of these attempts."""

OnMessage = Callable[[str, str, Mapping[str, Any]], None]


class StreamClient:
    """A context manager that follows one rig, or all that can be reached, and sends commands.

    It follows from the moment it is made until `close`.

    Args:
        settings: the profile; `rig.configuration.rigs.stream.load_stream` reads one.
        connect: endpoints to connect to; if empty, the profile's.
        rig: id of the rig; `*` for all.
        window_s: how long in s samples are stored after their arrival.
        history: whether each rig that appears is asked for its past messages, and asked again for
            messages that were lost.
        credentials: name and key to sign commands with; if None, those of the profile's first
            operator, or without any operator the name `local` with this user's own key. They are
            read when the first command is sent.
        on_message: is called with rig, kind and content of each valid message, one at a time, but
            not of past ones that were asked for; an error that it raises is passed to `on_failure`.
        on_failure: is called with a line on each error after which the client went on; it may be
            called from any thread. If None, the line is written to stderr.

    Raises:
        StreamError: a file of the profile cannot be read, or the session cannot be opened. It is no
            error if there is no rig or router yet. In mode `client` the session is opened later, in
            the client's thread, which passes errors to `on_failure` and tries again.
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
        self._rigs = HeardRigs(window_s)
        self._history = history
        self._credentials = credentials
        self._on_message = on_message
        self._survives = Surviving("following the stream", on_failure or _to_stderr)
        self._lock = threading.RLock()
        self._clock = SteadyClock()
        self._closing = threading.Event()
        self._connect = tuple(connect)
        self._session: zenoh.Session | None = None
        self._voice = reader_s_voice_of(settings)
        self._asking: list[threading.Thread] = []
        self._look_at = 0.0
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
        """Stop following, close the session and wait for the client's threads to end.

        It does nothing if the client is closed already.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self._taking.join()
        if self._session is not None:
            # Others that are stalled may keep Zenoh from closing in its time; nothing is lost then.
            with suppress(zenoh.ZError):
                self._tokens.undeclare()
                self._session.close()
        # A thread that is still inside Zenoh when the program ends would crash it.
        for thread in self._asking:
            thread.join()

    def rigs(self) -> tuple[str, ...]:
        """Return the sorted ids of all rigs that were heard on the stream, dead ones included."""
        with self._lock:
            return tuple(view.rig for view in self._rigs)

    def snapshots(self) -> list[Snapshot]:
        """Return what is known of each of these rigs now, in the order of their ids."""
        with self._lock:
            return [view.snapshot(self._clock.now_ns()) for view in self._rigs]

    def living(self) -> list[str]:
        """Return the sorted ids of all rigs that are alive."""
        return [snapshot.rig for snapshot in self.snapshots() if snapshot.alive]

    def wait_for_rig(self, timeout_s: float = 5.0) -> str:
        """Wait until a rig is alive, and return its id; the first id if there are several.

        Raises:
            UnknownRigError: no rig was alive in time.
        """
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for rig in self.living():
                return rig
            time.sleep(POLL_S)
        raise UnknownRigError("no rig is heard of; is one running, and with a stream?")

    def snapshot(self, rig: str | None = None) -> Snapshot:
        """Return what is known of a rig now; without an id, of the only known rig.

        Raises:
            UnknownRigError: the rig is not known; or no id is given and not exactly one is known.
        """
        with self._lock:
            return self._rigs.known(rig).snapshot(self._clock.now_ns())

    def window(self, last_s: float, names: tuple[str, ...] = (), rig: str | None = None) -> Window:
        """Return a rig's stored samples of the last seconds of rig time, in whole batches.

        Args:
            last_s: length of the window in s; whole batches make it longer by up to one batch.
            names: channels; all if empty.
            rig: id of the rig; None for the only known one.

        Raises:
            UnknownRigError: the rig is not known; or no id is given and not exactly one is known.
        """
        with self._lock:
            return self._rigs.known(rig).window(last_s, names)

    def history(self, last_s: float, rig: str | None = None, timeout_s: float = ANSWER_S) -> Window:
        """Ask a rig for its past messages, await them, and return the samples of the last seconds.

        Past samples are stored as new ones are: for the client's `window_s` after their arrival. If
        the rig does not answer, the samples that are stored already are returned.

        Args:
            last_s: how far back to ask, and length of the returned window, in s; the rig may have
                less.
            rig: id of the rig; None for the only known one.
            timeout_s: how long in s each question, one for each kind of message, waits for answers.

        Raises:
            UnknownRigError: the rig is not known; or no id is given and not exactly one is known.
        """
        with self._lock:
            view = self._rigs.known(rig)
        self._ask(view, last_s, timeout_s)
        with self._lock:
            return view.window(last_s)

    def send(
        self,
        command: CommandName,
        rig: str | None = None,
        text: str = "",
        timeout_s: float = ANSWER_S,
        test: str = "",
        person: str = "",
    ) -> Answer:
        """Send a signed command, wait for the rig's answer and return it.

        If none comes, the returned answer is not accepted, and its reason begins "no answer".

        Args:
            command: the command.
            rig: id of the rig; None for the only known one.
            text: a remark, which is recorded with the command; cut off after 500 characters.
            timeout_s: how long in s to wait for the answer.
            test: name of the test to skip or retry; empty for the present one.
            person: name of who gives the command, which is recorded; empty if that is not known. A
                rig of an earlier version, which does not know this field, is sent the command again
                without it.

        Raises:
            UnknownRigError: the rig is not known; or no id is given and not exactly one is known.
            KeyFileError: the operator's key cannot be read or made. It is read only once, for the
                first command, and not at all if the client was given credentials.
        """
        answer = self._sent(command, rig, text, timeout_s, test, person)
        if person and answer.reason.startswith("malformed"):
            return self._sent(command, rig, text, timeout_s, test, "")
        return answer

    def send_until_heard(
        self,
        command: CommandName,
        rig: str | None,
        text: str,
        wait_s: float,
        person: str = "",
    ) -> Answer:
        """Send a command again and again until a rig answers it; return the last answer.

        A rig that is only being connected, or that changes hands, is not heard for some seconds; a
        rig that was never heard may be heard soon.

        Args:
            command: the command.
            rig: id of the rig; None for the only known one.
            text: a remark, as of `send`.
            wait_s: longest time in s for which that is tried.
            person: who gives the command, as of `send`.

        Raises:
            KeyFileError: the operator's key cannot be read or made.
        """
        until = time.monotonic() + wait_s
        answer = Answer(False, "no answer: the client is closed")
        this = threading.current_thread()
        with self._lock:
            self._asking = [*self._asking, this]  # so that `close` waits for it
        try:
            while not self._closing.is_set():
                try:
                    answer = self.send(command, rig, text, ATTEMPT_S, person=person)
                except UnknownRigError as unknown:
                    answer = Answer(False, f"no answer: {unknown}")
                if not answer.is_unheard or time.monotonic() > until:
                    break
                self._closing.wait(HEARD_AGAIN_S)
        finally:
            with self._lock:
                self._asking = [each for each in self._asking if each is not this]
        return answer

    def _sent(
        self,
        command: CommandName,
        rig: str | None,
        text: str,
        timeout_s: float,
        test: str,
        person: str,
    ) -> Answer:
        """Send a command once; see `send`."""
        with self._lock:
            view = self._rigs.known(rig)
            is_proven = view.snapshot(self._clock.now_ns()).proven
            # A stop takes no turn: it waits for no other command that is still on its way out.
            turn = view.turn if command != "abort" else nullcontext()

        def sign() -> bytes:
            with self._lock:
                return self._sender.sign(view.rig, view.session, command, text, test, person)

        def counts(reply: zenoh.Sample, payload: bytes) -> bool:
            if not is_proven or self._answers(reply, payload):
                return True
            with self._lock:
                view.refuse("an answer not signed by the rig: another program gives it")
            return False

        where = command_key(view.rig, command)
        return answered(self._session, where, sign, turn, timeout_s, counts)

    def _answers(self, sample: zenoh.Sample, asked: bytes) -> bool:
        """Return whether the rig has signed an answer, and it answers these bytes."""
        payload = bytes(sample.payload)
        if not self._is_said(str(sample.key_expr), payload):
            return False
        return bool(msgpack.unpackb(payload).get("to") == asked_digest(asked))

    @cached_property
    def _sender(self) -> Sender:
        operators = self._settings.operators or (Operator("local", ()),)
        return Sender(self._credentials or credentials_of(operators[0]))

    def _token_changed(self, sample: zenoh.Sample) -> None:
        with self._survives, suppress(MessageError):
            rig, _ = rig_and_kind(str(sample.key_expr))
            present = sample.kind == zenoh.SampleKind.PUT
            with self._lock:
                view = self._rigs.of(rig, self._clock.now_ns())
                view.has_token = present
            if present and self._history:
                # This runs in a thread of Zenoh, which must not wait for answers, as these come in
                # threads of Zenoh too.
                self._begin_asking(self._ask, view, self._window_s, ANSWER_S)

    def _begin_asking(self, ask: Callable[..., None], *arguments: Any) -> None:
        """Ask a rig in a thread of its own, which `close` awaits."""
        asking = threading.Thread(target=ask, args=arguments)
        with self._lock:
            self._asking = [*(each for each in self._asking if each.is_alive()), asking]
            asking.start()

    def _ask(
        self,
        view: RigView,
        last_s: float,
        timeout_s: float,
        kinds: Collection[str] = (*LASTING, *KEPT),
    ) -> None:
        """Ask a rig for past messages, wait for the answers, and give them to the rig's view.

        They are the newest message of each kind in `LASTING`, channels first, then those of the
        kinds in `KEPT` that were sent in the last `last_s` seconds. Each kind is one question.
        """
        for kind in (each for each in (*LASTING, *KEPT) if each in kinds):
            if self._closing.is_set() or self._session is None:
                return
            with self._survives, suppress(zenoh.ZError):
                replies = self._session.get(
                    key(view.rig, kind) + (f"?last={last_s:g}" if kind in KEPT else ""),
                    timeout=timeout_s,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    # Answers have the question's priority, so past messages delay no new ones.
                    priority=zenoh.Priority.DATA_LOW,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
                for reply in replies:
                    if reply.ok is not None:
                        self._take(view.rig, kind, reply.ok, is_past=True)

    def _ask_for_lost(self) -> None:
        """Begin to ask each rig for the messages that were lost, if it is time for that."""
        now = time.monotonic()
        if not self._history or now < self._look_at:
            return
        self._look_at = now + LOOK_S
        with self._lock:
            due = (view for view in self._rigs if now >= view.asked_again_at)
            lost = [(view, *view.to_ask_again()) for view in due]
        for view, kinds, since_ns in lost:
            if kinds:
                view.asked_again_at = now + ASK_S
                last_s = 1e-9 * (self._clock.now_ns() - since_ns) + LATE_S
                self._begin_asking(self._ask_again, view, min(last_s, self._window_s), kinds)

    def _ask_again(self, view: RigView, last_s: float, kinds: frozenset[str]) -> None:
        """Ask a rig for lost messages, and for no others before and soon after the answers came."""
        begun, view.asked_again_at = time.monotonic(), inf
        try:
            self._ask(view, last_s, ANSWER_S, kinds)
        finally:
            now = time.monotonic()
            view.asked_again_at = now + max((now - begun) / ASKED_PART, ASK_S)

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
        """Receive messages until the client is closed; after an error, report it and try again."""
        while not self._closing.is_set():
            with self._survives:
                if self._session is None:
                    # If the router is not there yet, try again later.
                    with suppress(UnreachableError):
                        self._follow()
                    continue
                self._take_messages()
            self._closing.wait(AGAIN_S)

    def _take_messages(self) -> None:
        while not self._closing.is_set():
            self._ask_for_lost()
            sample = self._messages.try_recv()
            if sample is None:
                self._closing.wait(POLL_S)
                continue
            # A key of something else is left aside.
            with self._survives, suppress(MessageError):
                self._take(*rig_and_kind(str(sample.key_expr)), sample, is_past=False)

    def _take(self, rig: str, kind: str, sample: zenoh.Sample, *, is_past: bool) -> None:
        """Give a message to the rig's view, and then, unless it is past, to `on_message`.

        If it is not valid, it is only counted in the view, provided that the rig was known before.
        """
        with self._lock:
            known = self._rigs.get(rig)
        try:
            content, is_proven = self._heard(sample)
            with self._lock:
                now_ns = self._clock.now_ns()
                view = self._rigs.of(rig, now_ns, is_proven=is_proven)
                view.admit(content, now_ns, is_proven=is_proven)
                (view.take_past if is_past else view.take)(kind, content, now_ns)
        except MessageError as error:
            if known is not None:
                with self._lock:
                    known.refuse(str(error))
            return
        if self._on_message is not None and not is_past:
            self._on_message(rig, kind, content)

    def _heard(self, sample: zenoh.Sample) -> tuple[dict[str, Any], bool]:
        """Return the content of a message, and whether the rig has signed it.

        Raises:
            MessageError: it is no message.
        """
        if len(sample.payload) > LARGEST_MESSAGE:
            raise MessageError("too large")
        payload = bytes(sample.payload)
        content = unpack(payload)
        content.pop(MAC, None)
        return content, self._is_said(str(sample.key_expr), payload)

    def _is_said(self, zenoh_key: str, payload: bytes) -> bool:
        return self._voice is not None and self._voice.said(zenoh_key, payload)


def _to_stderr(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
