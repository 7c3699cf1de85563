"""A command is sent to a rig once here, and its answer read."""

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass

import msgpack
import zenoh

from .commands import OTHER_SESSION


@dataclass(frozen=True)
class Answer:
    """The answer to a command.

    Attributes:
        accepted: whether the command is obeyed.
        reason: the reason if it is not obeyed; else empty, or a remark on how it was obeyed.
    """

    accepted: bool
    reason: str = ""

    @property
    def is_unheard(self) -> bool:
        """Whether nobody has answered, or only a session that was not known to the sender yet."""
        return not self.accepted and (
            self.reason.startswith("no answer") or OTHER_SESSION in self.reason
        )


def answered(
    session: zenoh.Session | None,
    selector: str,
    sign: Callable[[], bytes],
    turn: AbstractContextManager[object],
    timeout_s: float,
    counts: Callable[[zenoh.Sample, bytes], bool],
) -> Answer:
    """Sign a command, send it, and return the first answer that counts.

    If none comes, the returned answer is not accepted, and its reason begins "no answer".

    Args:
        session: Zenoh's session; None if there is no connection yet.
        selector: key of the command.
        sign: returns the signed command, which has the next number of its sender.
        turn: is held from the signing until the command is on its way, so that commands leave in
            the order of their numbers: the rig refuses one that comes after a later one.
        timeout_s: how long to wait for an answer, s.
        counts: tells whether an answer to these bytes comes from the rig.
    """
    if session is None:
        return Answer(False, "no answer: there is no connection yet")
    try:
        with turn:
            command = sign()
            replies = session.get(selector, payload=command, timeout=timeout_s)
        for reply in replies:
            answer = None if reply.ok is None else _answer(bytes(reply.ok.payload))
            if answer is not None and reply.ok is not None and counts(reply.ok, command):
                return answer
    except zenoh.ZError as error:
        return Answer(False, f"no answer: {error}")
    return Answer(False, "no answer: the rig takes no commands from here, or is not there")


def _answer(payload: bytes) -> Answer | None:
    """Return the answer that a payload holds; None if it holds none."""
    with suppress(Exception):  # the parser may raise anything, as the bytes may be anything
        reply = msgpack.unpackb(payload, max_map_len=8)
        accepted, reason = reply["accepted"], reply["reason"]
        if type(accepted) is bool and type(reason) is str:
            return Answer(accepted, reason)
    return None
