"""Commands leave in the order of their numbers, whoever gives them at the same time."""

import threading
from contextlib import nullcontext
from typing import Any, cast

import pytest
import zenoh

from rig.stream.answers import Answer, answered


class Session:
    """A session that keeps the commands in the order in which they leave, and answers none."""

    def __init__(self) -> None:
        self.left: list[bytes] = []

    def get(self, selector: str, *, payload: bytes, timeout: float) -> list[zenoh.Reply]:
        self.left.append(payload)
        return []


@pytest.mark.parametrize(("is_stop", "left"), [(False, [b"1", b"2"]), (True, [b"2", b"1"])])
def test_a_command_leaves_behind_those_that_were_signed_before_it_and_a_stop_waits_for_none(
    is_stop: bool, left: list[bytes]
) -> None:
    session, turn = Session(), threading.Lock()
    number, has_left = iter((b"1", b"2")), threading.Event()

    def send(sign: Any, its_turn: Any) -> Answer:
        return answered(cast(Any, session), "key", sign, its_turn, 1.0, lambda *_: True)

    def later() -> None:
        send(lambda: next(number), nullcontext() if is_stop else turn)
        has_left.set()

    other = threading.Thread(target=later)

    def slowly() -> bytes:
        mine = next(number)
        other.start()
        has_left.wait(60.0 if is_stop else 0.05)
        return mine

    assert not send(slowly, turn).accepted
    other.join()
    assert session.left == left
