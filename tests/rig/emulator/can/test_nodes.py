"""The emulated devices on CAN, as any program that has the DBC files sees them."""

import asyncio
import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from rig.configuration.reading.lookup import shipped_config_dir
from rig.emulator.can.nodes import serve
from rig.emulator.can.pump_node import PumpNode
from rig.emulator.can.valve_node import ValveNode
from rig.io.can.canopen import NmtCommand
from rig.io.can.ds408 import FULL_SCALE, DriveState
from rig.io.can.libraries import cantools, python_can as can
from tests.waiting import PATIENCE_S, until

DBC = shipped_config_dir() / "dbc"
PAGE = Path(__file__).parents[4] / "docs" / "can.md"
MULTICAST = "239.74.163.2"


def database() -> Any:
    described = cantools.database.Database()
    for name in ("servovalve", "pump_unit"):
        described.add_dbc_file(DBC / f"{name}.dbc")
    return described


class Served:
    """Both devices served on a bus from a thread of their own, until closed."""

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self.notes: list[tuple[str, dict[str, Any]]] = []
        self._stop = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),))
        self._thread.start()

    async def _run(self) -> None:
        with self._open_bus() as bus:
            valve = ValveNode(bus.send, lambda: 1.25e-4, 2.5e-4, 5, lambda *_, **__: None)
            start = can.Message(arbitration_id=0, data=[NmtCommand.START, 0], is_extended_id=False)
            valve.receive(start)
            pump = PumpNode(
                bus.send,
                DBC / "pump_unit.dbc",
                lambda: 13.8e6,
                lambda _: None,
                lambda *_, **__: None,
            )
            serving = asyncio.create_task(serve(bus, "the bus", [valve, pump], self.noted))
            await self._stop.wait()
            serving.cancel()
            with pytest.raises(asyncio.CancelledError):
                await serving

    def noted(self, event: str, **details: Any) -> None:
        self.notes.append((event, details))

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE_S)
        self._loop.close()


def virtual(channel: str) -> can.BusABC:
    return can.Bus(interface="virtual", channel=channel, ignore_config=True)


def multicast(port: int) -> can.BusABC:
    return can.Bus(
        interface="udp_multicast", channel=MULTICAST, port=port, hop_limit=0, ignore_config=True
    )


@pytest.fixture
def port() -> int:
    """A free UDP port on which multicast works, or the reason why there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        free = int(probe.getsockname()[1])
    try:
        with multicast(free) as sender, multicast(free) as receiver:
            sender.send(can.Message(arbitration_id=1, data=b"", is_extended_id=False))
            heard = receiver.recv(PATIENCE_S)
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast on this machine: {error}")
    if heard is None:
        pytest.skip("no multicast on this machine: a frame sent was not received")
    return free


@pytest.fixture
def served_on_virtual(request: pytest.FixtureRequest) -> Iterator[can.BusABC]:
    with virtual(request.node.nodeid) as listener:
        served = Served(lambda: virtual(request.node.nodeid))
        yield listener
        served.close()


def test_both_devices_are_followed_on_one_bus_by_the_dbc(served_on_virtual: can.BusABC) -> None:
    described = database()
    heard: dict[str, Any] = {}

    def listen() -> None:
        frame = served_on_virtual.recv(0.1)
        if frame is not None:
            message = described.get_message_by_frame_id(frame.arbitration_id)
            heard[message.name] = message.decode(frame.data)

    wanted = {"ValveStatus", "ValveHeartbeat", "PumpStatus"}
    until(lambda: wanted <= heard.keys(), "both devices", meanwhile=listen)
    assert heard["ValveStatus"]["State"] == "INIT"
    assert heard["ValveStatus"]["Spool"] == pytest.approx(50.0)
    assert heard["PumpStatus"]["Pressure"] == pytest.approx(138.0)
    assert heard["PumpStatus"]["MotorState"] == "RUNNING"


def test_the_script_of_the_page_follows_them_from_another_process(
    port: int, tmp_path: Path
) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(script.strip().splitlines()) == 10
    (tmp_path / "config").symlink_to(shipped_config_dir())
    served = Served(lambda: multicast(port))
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", script.replace("15504", str(port))],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
    )
    watchdog = threading.Timer(PATIENCE_S, process.kill)
    watchdog.start()
    try:
        assert process.stdout is not None
        lacking = {"'State': 'INIT'", "'MotorState': 'RUNNING'"}
        for line in process.stdout:
            lacking = {words for words in lacking if words not in line}
            if not lacking:
                break
        assert not lacking
    finally:
        watchdog.cancel()
        process.kill()
        process.communicate()
        served.close()


@given(
    events=st.lists(
        st.one_of(
            st.tuples(st.just(0x205), st.binary(max_size=8)),
            st.tuples(st.just(0x205), st.sampled_from([bytes((w, 0, 0, 0)) for w in range(16)])),
            st.tuples(st.just(0x605), st.sampled_from([bytes((0x2B, 0x40, 0x60, 0, 7, 0, 0, 0))])),
            st.tuples(st.just(0x000), st.sampled_from([b"\x01\x05", b"\x80\x05", b"\x81\x00"])),
            st.just((None, b"")),
        )
    )
)
def test_no_traffic_brings_the_valve_to_active_but_by_the_whole_walk(
    events: list[tuple[int | None, bytes]],
) -> None:
    passed = ["INIT"]

    def note(event: str, **details: Any) -> None:
        if event == "drive_state":
            passed.append(details["state"])

    valve = ValveNode(lambda _: None, lambda: 0.0, 1.0, 5, note)
    for number, (identifier, data) in enumerate(events):
        if identifier is None:
            valve.fail(0x1000)
            assert valve.acting_command(0.5) == 0.0
        else:
            valve.receive(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        valve.cycle(0.005 * number)
    assert all(before == "HOLD" for before, state in pairwise(passed) if state == "ACTIVE")


def test_the_dbc_knows_the_states_and_the_scale_of_the_profile() -> None:
    described = database()
    status = described.get_message_by_name("ValveStatus")
    state = status.get_signal_by_name("State")
    assert {int(code): str(name) for code, name in state.choices.items()} == {
        int(known): known.name for known in DriveState
    }
    for message, signal in (("ValveStatus", "Spool"), ("ValveCommand", "Setpoint")):
        scaled = described.get_message_by_name(message).get_signal_by_name(signal)
        assert scaled.scale * FULL_SCALE == 100.0
