"""What may be asked of the console, by whom: every order of the page goes through here."""

import json
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from rig.stream import COMMANDS, Answer, CommandName, KeyFileError, StreamClient, UnknownRigError

from .control_holder import ControlHolder, NotInControl
from .launcher import ASKED, ENDING, Launched, Launcher, LaunchRefused
from .visitors import Visitor

LONGEST_TEXT: Final = 400
"""Characters of a remark; with its writer's name it fits into a command."""
LONGEST_NAME: Final = 200
STOP: Final = "stop"
ORDERS: Final = (STOP, "take", "take over", "release", "start", "go on", *COMMANDS)
STOP_S: Final = 2.5
"""How long an answer to a stop is waited for."""
COMMAND_S: Final = 5.0
ENDING_REASON: Final = "it has been ending since the stop before; it was interrupted as well"
ASKED_REASON: Final = "the stream did not take it; the run's control port did"
INTERRUPTED_REASON: Final = (
    "neither the stream nor the run's control port took it; the process was interrupted"
)

_KEYS: Final = frozenset({"order", "rig", "text", "name"})


class MalformedError(ValueError):
    """A request that is no order at all; the message says why."""


@dataclass(frozen=True)
class Order:
    """What somebody asks for.

    Attributes:
        order: one of `ORDERS`.
        rig: its id, for a command.
        text: a remark.
        name: of the test to skip or retry, the campaign to start, the run to go on with.
    """

    order: str
    rig: str = ""
    text: str = ""
    name: str = ""


def parse(body: bytes) -> Order:
    """Return the order in a request.

    Raises:
        MalformedError: it is none.
    """
    try:
        content = json.loads(body)
    except (ValueError, RecursionError):
        raise MalformedError("is no JSON") from None
    if not isinstance(content, dict) or not content.keys() <= _KEYS:
        raise MalformedError("has not the keys of an order")
    if not all(isinstance(value, str) for value in content.values()):
        raise MalformedError("has a value that is no text")
    try:
        "".join(content.values()).encode()
    except UnicodeEncodeError:
        # Half a character, which no viewer and no rig can be sent.
        raise MalformedError("has a value that is no text") from None
    if content.get("order") not in ORDERS:
        raise MalformedError("is none that there is")
    if any(len(content.get(key, "")) > LONGEST_NAME for key in ("rig", "name")):
        raise MalformedError("has a name that is too long")
    if len(content.get("text", "")) > LONGEST_TEXT:
        raise MalformedError(f"has a remark of more than {LONGEST_TEXT} characters")
    return Order(**content)


def _said(order: Order, visitor: Visitor) -> str:
    """Return what the journal keeps of an order: who gave it, and the remark."""
    return f"{visitor.name}: {order.text}" if order.text else visitor.name


class Orders:
    """Carries orders out; methods may wait for a rig's answer, and are called from any thread.

    Args:
        client: sends commands.
        control: who may act.
        launcher: starts runs.
    """

    def __init__(self, client: StreamClient, control: ControlHolder, launcher: Launcher) -> None:
        self._client = client
        self._control = control
        self._launcher = launcher
        self._one_at_a_time = threading.Lock()
        """Held while control changes hands, or a run is started."""

    def carry_out(self, order: Order, visitor: Visitor) -> Answer:
        """Do what is asked for, if this visitor may, and return what came of it.

        Anybody who is logged in may stop a rig; for all else one needs control.
        """
        try:
            if order.order == STOP:
                return self._stop(order, visitor)
            with self._one_at_a_time:
                if self._is_done_here(order, visitor):
                    return Answer(True)
            return self._send(cast(CommandName, order.order), order, visitor, COMMAND_S)
        except (NotInControl, LaunchRefused, UnknownRigError, KeyFileError) as refusal:
            return Answer(False, str(refusal))

    def leave(self, visitor: Visitor) -> None:
        """Let go of control for somebody who logs out."""
        with self._one_at_a_time:
            self._control.release(visitor)

    def _is_done_here(self, order: Order, visitor: Visitor) -> bool:
        """Do what needs no rig; return whether that is all."""
        if order.order in ("take", "take over"):
            self._control.take(visitor, over=order.order == "take over")
            return True
        self._control.require(visitor)
        if order.order == "release":
            self._control.release(visitor)
        elif order.order in ("start", "go on"):
            self._launch(order)
        else:
            return False
        return True

    def _send(self, command: CommandName, order: Order, visitor: Visitor, wait_s: float) -> Answer:
        said = _said(order, visitor)
        return self._client.send(command, order.rig, said, wait_s, order.name)

    def _stop(self, order: Order, visitor: Visitor) -> Answer:
        """Abort the rig that the page shows by the stream; else, or too, what was started here.

        What was started here is asked by its control port where the stream does not answer, and
        where its rig is not heard yet, so that no page can show it; where that does not answer
        either, it is interrupted as by Ctrl-C. Of other runs it is not known here whose folder is
        whose. It is not called obeyed where that is not the rig that the page shows.
        """
        try:
            rig = order.rig or self._only_living()
            answer = self._send("abort", Order(STOP, rig, order.text), visitor, STOP_S)
        except Exception as refusal:  # whatever it is, the other way is left
            rig, answer = order.rig, Answer(False, str(refusal) or type(refusal).__name__)
        running = self._launcher.present()
        if answer.accepted:
            meant = "" if order.rig else f"on {rig}, the only one that lives"
            # The page may show another rig until the one that was started is heard: stop both.
            if running and not self._was_heard(running):
                done = self._launcher.stop(_said(order, visitor))
                if done:
                    also = f"and what was started here, not heard yet, was {done}"
                    return Answer(True, f"{meant}, {also}" if meant else also)
            if running and self.rig_of_run(running.folder.name) == rig:
                self._launcher.was_stopped(running.folder.name)
            return Answer(True, meant)
        done = self._launcher.stop(_said(order, visitor))
        if not done:
            return answer
        elsewhere = running and (self.rig_of_run(running.folder.name) or running.rig)
        if elsewhere and elsewhere != rig:
            text = f"{answer.reason}; what was started here, on {elsewhere}, was {done}"
            return Answer(False, text)
        if done == ENDING:
            return Answer(True, ENDING_REASON)
        if done == ASKED:
            return Answer(True, ASKED_REASON)
        return Answer(True, INTERRUPTED_REASON)

    def _only_living(self) -> str:
        """Return the rig that is meant by a page that was not shown any yet."""
        alive = self._living()
        if len(alive) != 1:
            raise UnknownRigError(f"name the rig; alive are: {', '.join(alive) or 'none'}")
        return alive[0]

    def rig_of_run(self, folder: str) -> str:
        """Return the living rig that has a run of this folder; empty if none is known."""
        for rig in self._living() if folder else []:
            if self._client.snapshot(rig).campaign.get("directory") == folder:
                return rig
        return ""

    def _was_heard(self, run: Launched) -> bool:
        """Return whether a run's stream was heard since it was started, or gone on with, here."""
        for rig in self._client.rigs():
            campaign = self._client.snapshot(rig).campaign
            begun_ns = campaign.get("begun_ns")
            is_new = isinstance(begun_ns, int) and begun_ns >= run.started_ns
            if is_new and campaign.get("directory") == run.folder.name:
                return True
        return False

    def _living(self) -> list[str]:
        return [rig for rig in self._client.rigs() if self._client.snapshot(rig).alive]

    def _launch(self, order: Order) -> None:
        alive = self._living()
        same = Path(self._launcher.rig_of(order.name)).stem in alive
        if alive and (order.order == "go on" or same):
            raise LaunchRefused(f"{', '.join(alive)} has a campaign running")
        if order.order == "start":
            self._launcher.start(order.name)
        else:
            self._launcher.go_on(order.name)
