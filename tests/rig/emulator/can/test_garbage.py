"""Whatever is sent to the multicast group of an emulated CAN bus, its devices go on."""

import asyncio
import random
import socket
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import msgpack
import pytest
from hypothesis import given, strategies as st

from rig.configuration.rigs.rig import Rig, load_rig
from rig.emulator.addresses import HOST, Address, Endpoints
from rig.emulator.can.nodes import Node, serve
from rig.emulator.can.pump_node import PumpNode
from rig.emulator.can.valve_node import ValveNode
from rig.emulator.running import EmulatorThread
from rig.io.can.frames import FrameReader
from rig.io.can.libraries import python_can as can
from rig.io.can.link import CanOptions, open_bus
from rig.io.can.pump import CanPump
from tests.rig.emulator.can.test_nodes import DBC, MULTICAST, multicast, port as port
from tests.waiting import until

FRAME = {
    "timestamp": 0.0, "arbitration_id": 0x605, "is_extended_id": False, "is_remote_frame": False,
    "is_error_frame": False, "channel": None, "dlc": 8, "data": bytes(8), "is_fd": False,
    "bitrate_switch": False, "error_state_indicator": False,
}  # fmt: skip
ODD: list[Any] = [None, -1, 1.5, "x", b"x", [1], {}, 2**63, float("nan"), True, 2**30, 2**40]


def garbage() -> list[bytes]:
    """Bytes of every kind that are no frame, or one whose values are not those of a frame."""
    noise = random.Random(1)
    odd = [msgpack.packb({**FRAME, key: value}) for key in FRAME for value in ODD]
    remote = [
        msgpack.packb({**FRAME, "arbitration_id": identifier, "data": b"", "is_remote_frame": True,
                       "is_extended_id": identifier > 0x7FF})
        for identifier in (0x605, 0x205, 0x18FF0A01)
    ]  # fmt: skip
    return [b"", b"\x91" * 4000, *odd, *remote, *(noise.randbytes(n) for n in range(1, 60))]


@pytest.fixture
def group(port: int) -> Iterator[Callable[[], None]]:
    """Sends all of that garbage to the bus at the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)

        def send() -> None:
            for datagram in garbage():
                sender.sendto(datagram, (MULTICAST, port))

        yield send


def endpoints(rig: Rig, bus_port: int) -> Endpoints:
    by_type = {spec.type: replace(spec.options, port=bus_port) for spec in rig.drivers[2:4]}
    anywhere = Address(HOST, 0)
    return Endpoints(
        anywhere, drive=by_type["can_valve"], pump=by_type["can_pump"], control=anywhere
    )


def test_garbage_on_the_bus_ends_neither_emulator_nor_driver_and_is_told_once(
    port: int,
    group: Callable[[], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    rig = load_rig("emulated")
    served = endpoints(rig, port)
    with (
        EmulatorThread(rig, endpoints=served) as emulator,
        closing(CanPump("pump", served.pump)) as pump,
    ):
        pump.open()
        group()
        until(lambda: any(e["event"] == "can_unreadable" for e in emulator.record.events), "a note")
        assert emulator.status()["can"]["drive"] == "INIT"
        until(lambda: pump.read().get("pump_loaded") == 0.0, "the pump's next status")
        notes = [e for e in emulator.record.events if e["event"] == "can_unreadable"]
        assert len(notes) <= 2
    # A traceback for each would fill a pipe that nobody reads, and the emulator would hang.
    assert capfd.readouterr() == ("", "")


def _ignored(*_: object, **__: object) -> None:
    pass


NODES: list[Node] = [
    ValveNode(_ignored, lambda: 0.0, 1.0, 5, _ignored),
    PumpNode(_ignored, DBC / "pump_unit.dbc", lambda: 0.0, _ignored, _ignored),
]


@given(
    st.sampled_from([0, 0x080, 0x185, 0x205, 0x585, 0x605, 0x701, 0x18FF0A01, 0x18FF0A02]),
    st.binary(max_size=8),
)
def test_a_node_takes_any_data(identifier: int, data: bytes) -> None:
    for extended in (True, *((False,) if identifier <= 0x7FF else ())):
        for node in NODES:
            node.receive(can.Message(arbitration_id=identifier, data=data, is_extended_id=extended))
            node.cycle(0.0)


def test_a_datagram_does_not_make_the_reader_fill_its_memory(port: int) -> None:
    options = CanOptions(interface="udp_multicast", channel=MULTICAST, port=port)
    with (
        open_bus("pump", options) as bus,
        multicast(port) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        tracemalloc.start()
        sender.sendto(msgpack.packb({**FRAME, "data": 1 << 26}), (MULTICAST, port))
        other.send(can.Message(arbitration_id=7, data=b"sound", is_extended_id=False))
        reader = FrameReader(bus)
        frames: list[can.Message] = []
        until(lambda: frames, "the frame", meanwhile=lambda: frames.extend(reader.take(0.1)))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert [(frame.arbitration_id, bytes(frame.data)) for frame in frames] == [(7, b"sound")]
    assert reader.unreadable == 1
    assert peak < 1 << 22


def test_a_reader_is_not_kept_by_who_sends_without_end() -> None:
    class Flooded:
        """A bus on which there is always something, and never a frame."""

        def recv(self, wait: float) -> Any:
            raise can.CanOperationError("could not unpack received message")

    reader = FrameReader(Flooded())  # type: ignore[arg-type]
    assert reader.take() == []
    assert reader.unreadable == 500


def test_a_frame_that_a_node_cannot_take_ends_no_service(
    port: int,
) -> None:
    class Broken:
        def receive(self, frame: can.Message) -> None:
            raise ZeroDivisionError("of the node")

        def cycle(self, now: float) -> None:
            pass

    notes: list[dict[str, Any]] = []

    async def served() -> None:
        with multicast(port) as bus, multicast(port) as sender:
            serving = asyncio.create_task(
                serve(bus, "the bus", [Broken()], lambda event, **told: notes.append(told))
            )
            sender.send(can.Message(arbitration_id=1, data=b"", is_extended_id=False))
            while not notes:
                assert not serving.done()
                await asyncio.sleep(0.01)
            serving.cancel()

    asyncio.run(served())
    assert notes[0]["new"] == 1
    assert "ZeroDivisionError: of the node" in notes[0]["why"]
