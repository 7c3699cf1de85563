"""Emulated devices that serve real sockets and pseudo-terminals from a thread of their own."""

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
    """A clock that stands still until the test lets it go on."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, time_s: float) -> None:
        self.now_ns += round(time_s * 1e9)


class DeviceThread:
    """An event loop in a thread: what devices are served by."""

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
        """Close a device, once it has taken in the connections that were made to it."""

        async def closed() -> None:
            # asyncio leaks a connection that it accepts for a server which is closed by then.
            for _ in range(10):
                await asyncio.sleep(1e-3)
            close()

        self.run(closed())

    def end(self) -> None:
        async def settle() -> None:
            # A connection that is being accepted while its client has gone already takes some
            # turns of the loop to be made and closed; only the loop's own wake-up stays.
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
    """Bypass valves on an emulated I/O, both on a clock that the test turns."""

    def __init__(self, thread: DeviceThread, folder: Path) -> None:
        self.clock = ManualClock()
        self.record = Record(clock=self.clock)
        self.device = BypassIo(self.record, self.clock, ball_travel_s=0.5, needle_travel_s=2.0)
        self.port = thread.run(self.device.open("127.0.0.1", 0))
        self._thread = thread
        self._folder = folder
        self._drivers: list[BypassValves] = []
        self._clients: list[Client] = []
        self._reply_s = PATIENCE_S

    def driver(self, sleep: Callable[[float], None] | None = None, **options: Any) -> BypassValves:
        """Return a driver of the device over TCP, not yet open; its sleep turns the clock."""
        given = {"host": "127.0.0.1", "port": self.port, **options}
        return self._made(BypassOptions(**given), sleep)

    def serial_driver(self, **options: Any) -> BypassValves:
        """Return a driver of the device over a serial line, not yet open."""
        path = self._folder / "ttyBypass"
        self._thread.run(self.device.open_serial(path))
        # A pseudo-terminal knows no parity, and says so (tcsetattr of glibc).
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
        """Let a fault of the wire keep replies away; drivers wait for none meanwhile.

        A reply that comes is waited for with patience: its time is the machine's, not the rig's.
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
        """Take the device away."""
        self._thread.close(self.device.close)

    def disconnect(self) -> None:
        """Break off its connections."""
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
