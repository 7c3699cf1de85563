import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.control_socket import note_interruption
from rig.runner.campaign.stopping import SIGNALS, StopFlag, stop_on_signals


@pytest.fixture(autouse=True)
def heeded() -> Iterator[None]:
    """Heed every signal, as in a terminal: tests run in the background inherit them ignored."""
    previous = {number: signal.signal(number, signal.SIG_DFL) for number in SIGNALS}
    yield
    for number, handler in previous.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_asks_for_a_stop_however_often_it_comes(number: int) -> None:
    stop = StopFlag()
    with stop_on_signals(stop):
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
    assert stop.requested
    assert stop.reason == signal.Signals(number).name


def test_who_interrupts_a_run_is_named_once(tmp_path: Path) -> None:
    for reason in ("Ada: it smells (SIGINT)", "SIGINT"):
        if "Ada" in reason:
            note_interruption(tmp_path, "Ada: it smells")
        stop = StopFlag()
        with stop_on_signals(stop, tmp_path):
            os.kill(os.getpid(), signal.SIGINT)
        assert stop.reason == reason
    assert list(tmp_path.iterdir()) == []


def test_the_first_reason_is_kept() -> None:
    stop = StopFlag()
    stop.request("one")
    stop.request("another")
    assert stop.reason == "one"


def test_a_stop_without_a_reason_is_a_stop() -> None:
    stop = StopFlag()
    stop.request("")
    assert stop.requested
    assert stop.reason == "somebody without a name"


def test_afterwards_signals_do_what_they_did_before() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]
    with stop_on_signals(StopFlag()):
        assert [signal.getsignal(number) for number in SIGNALS] != before
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_signal_that_is_ignored_stays_so() -> None:
    previous = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = StopFlag()
        with stop_on_signals(stop):
            os.kill(os.getpid(), signal.SIGHUP)
        assert not stop.requested
    finally:
        signal.signal(signal.SIGHUP, previous)


def test_a_signal_ends_what_may_be_interrupted_and_nothing_after_it() -> None:
    stop, came_to = StopFlag(), list[str]()
    with stop_on_signals(stop):
        with stop.interruptible():
            os.kill(os.getpid(), signal.SIGTERM)
            came_to.append("rest of the block")
        os.kill(os.getpid(), signal.SIGTERM)
        came_to.append("end")
    assert (came_to, stop.reason) == (["end"], "SIGTERM")
