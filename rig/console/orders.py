"""Every order of the page goes through here, which checks who may give it and carries it out."""

import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from rig.accounts import why_not
from rig.stream import COMMANDS, Answer, CommandName, KeyFileError, StreamClient, UnknownRigError
from rig.unique_keys import RepeatedKeyError, unique_keys

from .launcher import ASKED, ENDING, INTERRUPTED, Launched, Launcher, LaunchRefused
from .queue import Queue, QueueError
from .standing_stop import STANDS_S, StandingStop
from .visitors import ControlHolder, NotInControl, Visitor

LONGEST_TEXT: Final = 400
"""Most characters of a remark, so that it fits into a command with its writer's name."""
LONGEST_NAME: Final = 200
STOP: Final = "stop"
QUEUE: Final = ("queue add", "queue move", "queue remove", "queue start", "queue halt")
"""Orders about the queue: their `name` is a campaign, or the number of an entry."""
ORDERS: Final = (STOP, "take", "take over", "release", "start", "go on", "set", *QUEUE, *COMMANDS)
EXPIRED: Final = "by a login that has expired"
"""What is recorded of a stop by somebody whose login has expired."""
STOP_S: Final = 2.5
"""Time in s for which an answer to a stop is awaited."""
COMMAND_S: Final = 5.0
REASONS: Final = {
    ENDING: "it has been ending since the stop before; it was interrupted as well",
    ASKED: "the stream did not take it; the run's control port did",
    INTERRUPTED: "neither the stream nor the run's control port took it; the process was "
    "interrupted",
}
"""How a run was stopped that the stream did not stop, in words, by the way of `Launcher.stop`."""

_KEYS: Final = frozenset({"order", "rig", "text", "name"})


class ForbiddenError(PermissionError):
    """The error of an order that the visitor's role may not give; its message is the reason."""


class MalformedError(ValueError):
    """The error of a request that is not an order.

    Its message says why, as a phrase that follows "the order", such as "is no JSON".
    """


@dataclass(frozen=True)
class Order:
    """An order that a visitor gives on the page.

    Attributes:
        order: the kind of order, one of `ORDERS`.
        rig: id of the rig, for a command or a stop. If empty, a stop goes to the only rig that is
            alive; a command is refused, as no rig has this id.
        text: a remark; may be empty.
        name: name of the test to skip or retry, of the campaign to start, or of the folder of the
            run to resume, whose control is set, or that has ended and is acknowledged, or the
            number of an entry of the queue; else empty. Of "queue move" `text` says whither; of
            "queue add" it is a mark, by which a request that comes again is known; of "queue start"
            the name is the number of the entry that is to begin.
    """

    order: str
    rig: str = ""
    text: str = ""
    name: str = ""


def parse(body: bytes) -> Order:
    """Return the order in the body of a request.

    Raises:
        MalformedError: the body is not a JSON object of texts with the keys of `Order`, a key comes
            twice, its kind is not in `ORDERS`, or a text is too long.
    """
    try:
        content = json.loads(body, object_pairs_hook=unique_keys)
    except RepeatedKeyError as error:
        raise MalformedError(str(error)) from None
    except (ValueError, RecursionError):
        raise MalformedError("is no JSON") from None
    if not isinstance(content, dict) or not content.keys() <= _KEYS:
        raise MalformedError("has not the keys of an order")
    try:
        # A lone surrogate is half a character, which cannot be sent to any viewer or rig.
        "".join(content.values()).encode()
    except (TypeError, UnicodeEncodeError):
        raise MalformedError("has a value that is no text") from None
    if content.get("order") not in ORDERS:
        raise MalformedError("is none that there is")
    if any(len(content.get(key, "")) > LONGEST_NAME for key in ("rig", "name")):
        raise MalformedError("has a name that is too long")
    if len(content.get("text", "")) > LONGEST_TEXT:
        raise MalformedError(f"has a remark of more than {LONGEST_TEXT} characters")
    return Order(**content)


def _said(order: Order, visitor: Visitor) -> str:
    """Return the text that is recorded with an order: who gave it, and the remark, if any."""
    parts = (EXPIRED if visitor.expired else "", order.text)
    remark = "; ".join(part for part in parts if part)
    return f"{visitor.name}: {remark}" if remark else visitor.name


class Orders:
    """The object that carries orders out.

    Its methods may be called from any thread, and may wait for a rig's answer.

    Args:
        client: sends commands to rigs.
        control: records who may act.
        launcher: starts, resumes and stops runs.
        queue: the campaigns that are started one after another; None if there is no queue.
        say: is called with a sentence on what came of a stop that nobody had heard at first.
    """

    def __init__(
        self,
        client: StreamClient,
        control: ControlHolder,
        launcher: Launcher,
        queue: Queue | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._client = client
        self._standing = StandingStop(client, say)
        self._queue = queue
        self._control = control
        self._launcher = launcher
        self._one_at_a_time = threading.Lock()
        """This lock is held while control changes hands, or a run is started."""

    def carry_out(self, order: Order, visitor: Visitor) -> Answer:
        """Carry out an order if this visitor may give it; return whether it was obeyed, or why not.

        Anybody who is logged in may stop a rig or ask for control; any other order needs control.

        Raises:
            ForbiddenError: the visitor's role may not give this order, or the login has expired and
                the order is not to stop.
        """
        missing = why_not(order.order, visitor.role)
        if visitor.expired and order.order != STOP:
            missing = "your login has expired; log in again. Stop works without"
        if missing:
            raise ForbiddenError(missing)
        try:
            if order.order == STOP:
                return self._stop(order, visitor)
            with self._one_at_a_time:
                if self._is_done_here(order, visitor):
                    return Answer(True)
            return self._send(cast(CommandName, order.order), order, visitor, COMMAND_S)
        except (NotInControl, LaunchRefused, QueueError, UnknownRigError, KeyFileError) as refusal:
            return Answer(False, str(refusal))

    def leave(self, visitor: Visitor) -> None:
        """Release control if the visitor, who logs out, has it."""
        with self._one_at_a_time:
            self._control.release(visitor)

    def lapse(self, visitor: Visitor) -> None:
        """Release control if the visitor, who may not act any more, has it.

        While another order is carried out nothing is done, so that nobody waits: call it again.
        """
        if self._one_at_a_time.acquire(blocking=False):
            try:
                self._control.release(visitor, "has control no longer: the login may not act")
            finally:
                self._one_at_a_time.release()

    def _is_done_here(self, order: Order, visitor: Visitor) -> bool:
        """Carry out an order about control or about starting runs; return False for any other.

        An order other than taking control raises `NotInControl` unless the visitor has control.
        """
        if order.order in ("take", "take over"):
            self._control.take(visitor, over=order.order == "take over")
            return True
        self._control.require(visitor)
        if order.order == "release":
            self._control.release(visitor)
        elif order.order in ("start", "go on"):
            self._launch(order, visitor)
        elif order.order == "set":
            self._launcher.set_control(order.name, order.text, visitor.name)
        elif order.order == "acknowledge" and order.name:
            self._launcher.acknowledge(order.name, order.text, visitor.name)
        elif order.order in QUEUE:
            self._change_queue(order, visitor)
        else:
            return False
        return True

    def _change_queue(self, order: Order, visitor: Visitor) -> None:
        if self._queue is None or not self._launcher.may_start:
            raise LaunchRefused("runs are queued and started on the rig's own machine only")
        if order.order == "queue add":
            self._queue.add(order.name, visitor.name, order.text)
        elif order.order == "queue remove":
            self._queue.remove(order.name)
        elif order.order == "queue move":
            self._queue.move(order.name, order.text)
        elif order.order == "queue start":
            self._queue.begin(visitor.name, order.name)
        else:
            self._queue.halt(f"{visitor.name} has halted it")

    def work_off_queue(self) -> None:
        """Take the changes of the queue's file, and start its next campaign if it is time for it.

        That may wait for another order, and for the disk.
        """
        if self._queue is not None:
            with self._one_at_a_time:
                self._queue.look()

    def _send(self, command: CommandName, order: Order, visitor: Visitor, wait_s: float) -> Answer:
        said = _said(order, visitor)
        return self._client.send(command, order.rig, said, wait_s, order.name, person=visitor.name)

    def _stop(self, order: Order, visitor: Visitor) -> Answer:
        """Stop the rig that the page shows, and return whether that was done.

        The rig is first sent an abort by the stream. If it does not obey, the run that was started
        here is stopped by `Launcher.stop`: by its control port, or else as by Ctrl-C. If that run
        is on another rig than the page shows, the stop does not count as obeyed. The run is also
        stopped after an abort that was obeyed if its stream was not received yet, as no page can
        show its rig then.
        """
        if self._queue is not None:
            self._queue.halt(f"{visitor.name} has stopped {order.rig or 'the rig'}")
        until = time.monotonic() + STOP_S
        try:
            rig = order.rig or self._only_living()
            answer = self._send("abort", Order(STOP, rig, order.text), visitor, STOP_S)
            is_unheard = answer.is_unheard
        except Exception as refusal:  # after any error the launcher tries its own ways
            rig, answer = order.rig, Answer(False, str(refusal) or type(refusal).__name__)
            is_one = bool(order.rig) or not self._client.living()
            is_unheard = isinstance(refusal, UnknownRigError) and is_one
        running = self._launcher.present()
        if answer.accepted:
            meant = "" if order.rig else f"on {rig}, the only one that lives"
            # Until the started run's stream is received, the page may show another rig: stop both.
            if running and not self.was_heard(running):
                done = self._launcher.stop(_said(order, visitor), visitor.name)
                if done:
                    also = f"and what was started here, not heard yet, was {done}"
                    return Answer(True, f"{meant}, {also}" if meant else also)
            if running and self.rig_of_run(running.folder.name) == rig:
                running.asked = True
            return Answer(True, meant)
        done = self._launcher.stop(_said(order, visitor), visitor.name)
        if not done:
            return self._stands(order, visitor, answer, until) if is_unheard else answer
        elsewhere = running and (self.rig_of_run(running.folder.name) or running.rig)
        if elsewhere and elsewhere != rig:
            text = f"{answer.reason}; what was started here, on {elsewhere}, was {done}"
            return Answer(False, text)
        return Answer(True, REASONS[done])

    def _stands(self, order: Order, visitor: Visitor, answer: Answer, until: float) -> Answer:
        """Return the answer to a stop; one that nobody has heard is said until somebody hears it.

        That is waited for until a time of the monotonic clock in s.
        """
        left_s = max(until - time.monotonic(), 0.0)
        rig, said = order.rig, _said(order, visitor)
        heard = self._standing.stand(rig, said, visitor.name, left_s)
        if heard is not None:
            return heard
        also = f"whatever begins on {rig or 'it'} within {STANDS_S:g} s is stopped"
        return Answer(False, f"nobody hears it yet ({answer.reason}); {also}")

    def _only_living(self) -> str:
        """Return the id of the only living rig; a page that shows no rig yet means this one.

        Raises:
            UnknownRigError: no rig is alive, or several are.
        """
        alive = self._client.living()
        if len(alive) != 1:
            raise UnknownRigError(f"name the rig; alive are: {', '.join(alive) or 'none'}")
        return alive[0]

    def rig_of_run(self, folder: str) -> str:
        """Return the living rig whose campaign runs in a folder of this name; "" if none does."""
        for shot in self._client.snapshots() if folder else []:
            if shot.alive and shot.campaign.get("directory") == folder:
                return shot.rig
        return ""

    def was_heard(self, run: Launched) -> bool:
        """Return whether a run's stream has told of its campaign since the run was started here."""
        if run.heard:
            return True
        campaigns = [shot.campaign for shot in self._client.snapshots()]
        mine = [each for each in campaigns if each.get("directory") == run.folder.name]
        begun = [each.get("begun_ns") for each in mine]
        run.heard = any(isinstance(at_ns, int) and at_ns >= run.started_ns for at_ns in begun)
        return run.heard

    def _launch(self, order: Order, visitor: Visitor) -> None:
        # A rig that its station only reads is alive too, and driven by nothing.
        shots = [shot for shot in self._client.snapshots() if shot.alive]
        alive = [shot.rig for shot in shots if shot.campaign.get("status") != "idle"]
        same = Path(self._launcher.rig_of(order.name)).stem in alive
        if alive and (order.order == "go on" or same):
            raise LaunchRefused(f"{', '.join(alive)} has a campaign running")
        if order.order == "start":
            self._launcher.start(order.name, visitor.name)
        else:
            self._launcher.go_on(order.name, visitor.name)
