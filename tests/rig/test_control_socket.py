"""A line is received from a connection as soon as its newline has come."""

import socket
from collections.abc import Iterator

import pytest

from rig.control_socket import EndlessLineError, line_from
from tests.waiting import PATIENCE_S

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    here, there = socket.socketpair()
    with here, there:
        here.settimeout(PATIENCE_S)
        yield here, there


@pytest.mark.parametrize("sent", [b"one\n", b"one\ntwo", b"one\n\n"])
def test_a_line_ends_with_its_newline_whatever_follows(pair: Pair, sent: bytes) -> None:
    here, there = pair
    there.sendall(sent)
    there.shutdown(socket.SHUT_WR)
    assert line_from(here) == sent


@pytest.mark.parametrize("timeout_s", [None, PATIENCE_S])
def test_the_connection_keeps_its_own_timeout(pair: Pair, timeout_s: float | None) -> None:
    here, there = pair
    here.settimeout(timeout_s)
    there.sendall(b"one\n")
    line_from(here)
    assert here.gettimeout() == timeout_s


@pytest.mark.parametrize("sent", [b"", b"half a line", b"one that is too long\n"])
def test_a_line_that_does_not_end_or_is_too_long_is_an_error(pair: Pair, sent: bytes) -> None:
    here, there = pair
    there.sendall(sent)
    there.shutdown(socket.SHUT_WR)
    with pytest.raises(EndlessLineError):
        line_from(here, longest=12)
    assert here.gettimeout() == PATIENCE_S


def test_a_line_that_does_not_end_in_time_is_an_error(pair: Pair) -> None:
    here, there = pair
    here.settimeout(0.05)
    there.sendall(b"half a line")
    with pytest.raises(EndlessLineError, match="does not end"):
        line_from(here)
    assert here.gettimeout() == 0.05
