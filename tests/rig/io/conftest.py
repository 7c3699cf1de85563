"""Fixtures with emulated devices that a thread serves on real sockets and pseudo-terminals."""

import asyncio
import itertools
import selectors
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import pytest

from rig.emulator.modbus.bypass_io import BypassIo
from rig.emulator.record import Record
from rig.io.bypass_valves.driver import BypassValves
from rig.io.bypass_valves.link import Client
from rig.io.bypass_valves.options import BypassOptions
from tests.waiting import PATIENCE_S

T = TypeVar("T")


class ManualClock:
    """A clock that advances only when the test advances it."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, time_s: float) -> None:
        self.now_ns += round(time_s * 1e9)


class DeviceThread:
    """A thread with an event loop, which serves devices."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._loop = asyncio.SelectorEventLoop(self._selector)
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE_S)

    def call(self, work: Callable[[], T]) -> T:
        async def called() -> T:
            return work()

        return self.run(called())

    def close(self, close: Callable[[], object]) -> None:
        """Close a device by `close`, after it has accepted all connections that were made to it."""

        async def closed() -> None:
            # asyncio leaks a connection that it accepts after its server was closed.
            for _ in range(10):
                await asyncio.sleep(1e-3)
            close()

        self.run(closed())

    def end(self) -> None:
        async def settle() -> None:
            # A connection whose client has gone takes some turns of the loop to be accepted and
            # closed. In the end, only the loop's own wake-up socket is left.
            until = time.monotonic() + PATIENCE_S
            for turn in itertools.count():
                await asyncio.sleep(1e-3)
                closed = turn > 5 and len(self._selector.get_map()) == 1
                if closed or time.monotonic() > until:
                    return

        self.run(settle())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE_S)
        self._loop.close()


class BypassBench:
    """Emulated bypass valves and drivers of them, which read a clock that the test advances."""

    def __init__(self, thread: DeviceThread, folder: Path) -> None:
        self.clock = ManualClock()
        self.record = Record(clock=self.clock)
        self.device = BypassIo(self.record, self.clock)
        self.port = thread.run(self.device.open("127.0.0.1", 0))
        self._thread = thread
        self._folder = folder
        self._drivers: list[BypassValves] = []
        self._clients: list[Client] = []
        self._reply_s = PATIENCE_S

    def driver(self, sleep: Callable[[float], None] | None = None, **options: Any) -> BypassValves:
        """Return a driver of the device over TCP, not yet open.

        Where the driver sleeps, it calls `sleep`, or else advances the clock.
        """
        given = {"host": "127.0.0.1", "port": self.port, **options}
        return self._made(BypassOptions(**given), sleep)

    def serial_driver(self, **options: Any) -> BypassValves:
        """Return a driver of the device over a serial line, not yet open."""
        path = self._folder / "ttyBypass"
        self._thread.run(self.device.open_serial(path))
        # A pseudo-terminal has no parity; setting one fails (tcsetattr of glibc).
        line = {"transport": "rtu", "device": str(path), "parity": "none"}
        return self._made(BypassOptions(**{**line, **options}), None)

    def _made(self, options: BypassOptions, sleep: Callable[[float], None] | None) -> BypassValves:
        patient = replace(options, timeout=self._reply_s)
        driver = BypassValves("bypass", patient, self.clock, sleep or self.clock.advance)
        made = driver._client

        def client() -> Client:
            self._clients.append(made())
            self._clients[-1].comm_params.timeout_connect = self._reply_s
            return self._clients[-1]

        driver._client = client  # type: ignore[method-assign]
        self._drivers.append(driver)
        return driver

    @contextmanager
    def unanswered(self, fault: str) -> Iterator[None]:
        """Set a fault of the wire that suppresses replies; drivers wait only 50 ms meanwhile.

        At other times drivers wait long for a reply, because its delay depends on the machine.
        """
        setattr(self.device.wire, fault, True)
        self._wait_for_replies(0.05)
        try:
            yield
        finally:
            setattr(self.device.wire, fault, False)
            self._wait_for_replies(PATIENCE_S)

    def _wait_for_replies(self, time_s: float) -> None:
        self._reply_s = time_s
        for client in self._clients:
            client.comm_params.timeout_connect = time_s

    def power_off(self) -> None:
        """Close the device, as if it lost power."""
        self._thread.close(self.device.close)

    def disconnect(self) -> None:
        """Break all connections to the device."""
        self._thread.call(self.device.disconnect)

    def end(self) -> None:
        for driver in self._drivers:
            driver.close()
        self.power_off()


@pytest.fixture
def device_thread() -> Iterator[DeviceThread]:
    thread = DeviceThread()
    yield thread
    thread.end()


@pytest.fixture
def bypass(device_thread: DeviceThread, tmp_path: Path) -> Iterator[BypassBench]:
    bench = BypassBench(device_thread, tmp_path)
    yield bench
    bench.end()
