"""The loop process runs on a fast driver from elsewhere, by the exchange that the driver brings."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from estimator.filters.registry import OUTPUTS, run_filter
from rig.compile_cache import drivers_key
from rig.io.registry import DriverSpec, driver_class
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError
from rig.loop.wire.orders import Close, Closed
from rig.supervisor.processes.child import Child, News
from tests.rig.io.datagram_device import DatagramDevice
from tests.rig.supervisor.processes.loop_rig import MODEL, LoopRig
from tests.waiting import COMPILE_S, PATIENCE_S, until

NOT_EXCHANGED = -1.0
DRIVER = Path(__file__).parents[2] / "io" / "datagram_daq.py"

# A loop of its own is compiled for this driver; the conformance suite tries its exchange each time.
pytestmark = pytest.mark.long


@pytest.fixture
def device() -> Iterator[DatagramDevice]:
    with DatagramDevice() as device:
        yield device


@pytest.fixture
def rig(
    device: DatagramDevice,
    install: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[LoopRig]:
    site = install("datagram_daq", DRIVER.read_text(), datagram_daq="DatagramDaq")
    monkeypatch.setenv("PYTHONPATH", str(site), prepend=os.pathsep)
    # What is compiled for a driver that others cannot import is not for their cache.
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert drivers_key()
    board, news = Board.create(len(LoopRig.channels)), list[News]()
    child = Child(
        "loop", "rig.supervisor.processes.loop_process", board, tmp_path / "log", news.append
    )
    try:
        rig = LoopRig(board, child, news)
        options = driver_class("datagram_daq").Options(device.port, timeout=PATIENCE_S)
        assert rig.open_driver(DriverSpec.of("daq", "datagram_daq", options)).rate_hz == 1000.0
        yield rig
    finally:
        child.end()


def test_a_test_runs_to_its_end_and_close_leaves_the_device_safe(
    rig: LoopRig, device: DatagramDevice
) -> None:
    assert device.is_null
    rig.arm()
    assert device.enabled
    loop = rig.test(300)
    loop.position()
    rows = np.concatenate([loop.advance(100) for _ in range(3)])
    assert rows[:, loop.channels.index("tick")].tolist() == list(range(300))
    # A host that stalls misses ticks, which have no exchange.
    exchanged = rows[rows[:, loop.channels.index("exchange_status")] != NOT_EXCHANGED]
    assert len(exchanged) > 0
    assert not exchanged[:, loop.channels.index("exchange_status")].any()
    assert (exchanged[:, loop.channels.index("sent_s")] > 0.0).all()
    assert np.ptp(exchanged[:, loop.channels.index("position_m")]) > 1e-4
    again = run_filter(rows[:, 0], rows[:, 2].copy(), rows[:, 3:8].copy(), MODEL)
    at = loop.channels.index(OUTPUTS[0])
    assert np.array_equal(again.outputs, rows[:, at : at + len(OUTPUTS)], equal_nan=True)
    assert rig.ask(Close()) == Closed()
    assert device.is_null


def test_a_trip_nulls_the_valve_and_the_loop_looks_that_it_stays_there(
    rig: LoopRig, device: DatagramDevice
) -> None:
    rig.arm()
    loop = rig.test(60_000)
    loop.advance(10)
    rig.board.words[Word.FIELD_TRIP] = Cause.BYPASS_STUCK
    loop.advance(60_000)
    with pytest.raises(LoopStoppedError, match="bypass") as stopped:
        loop.advance(1)
    assert stopped.value.action == Action.TRIP
    until(lambda: bool(rig.board.words[Word.VALVE_NULL_AT]), "null was confirmed")
    assert device.is_null
    device.drive(1.0)
    until(lambda: bool(rig.news), "another master was reported")
    assert "output at 1.00 V" in rig.news[0].text
    until(lambda: device.is_null, "the valve was brought to null again")


def test_sigterm_leaves_the_device_safe(rig: LoopRig, device: DatagramDevice) -> None:
    rig.arm()
    os.kill(rig.child._process.pid, signal.SIGTERM)
    assert rig.child.answer(COMPILE_S) == Closed()
    assert device.is_null


def test_a_device_that_vanishes_trips_and_is_not_called_safe(
    rig: LoopRig, device: DatagramDevice
) -> None:
    rig.arm()
    device.close()
    until(lambda: bool(rig.news), "the loss was reported")
    assert rig.board.words[Word.LOOP_TRIP] == Cause.EXCHANGE_LOST
    assert "does not answer" in rig.news[0].text
    assert rig.board.words[Word.VALVE_NULL_AT] == 0
    assert "does not answer" in rig.ask(Close()).failure
