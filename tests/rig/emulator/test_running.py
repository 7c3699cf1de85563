"""An emulator that fails says so to whoever waits for it, and is no other rig meanwhile."""

import asyncio
import time

import pytest

from rig.configuration.rigs.rig import Rig
from rig.emulator.application import Emulator
from rig.emulator.running import EmulatorThread


def serve_until_it_fails(emulator: EmulatorThread) -> None:
    with emulator:
        while emulator._thread.is_alive():
            time.sleep(0.01)


def test_who_asks_an_emulator_that_has_failed_learns_why(
    simulated: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(emulator: Emulator) -> None:
        raise ZeroDivisionError("of the plant")

    monkeypatch.setattr(Emulator, "tend", fails)
    emulator = EmulatorThread(simulated).__enter__()
    emulator._thread.join()
    with pytest.raises(RuntimeError, match="the emulator has failed"):
        emulator.status()
    with pytest.raises(ZeroDivisionError, match="of the plant"):
        emulator.__exit__(None, None, None)


def test_an_emulator_one_of_whose_devices_fails_ends(
    simulated: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def device() -> None:
        raise ConnectionError("the bus is gone")

    opened = Emulator.open

    async def open_with_it(emulator: Emulator) -> None:
        await opened(emulator)
        emulator._tasks.append(asyncio.create_task(device()))

    monkeypatch.setattr(Emulator, "open", open_with_it)
    with pytest.raises(ConnectionError, match="the bus is gone"):
        serve_until_it_fails(EmulatorThread(simulated))
