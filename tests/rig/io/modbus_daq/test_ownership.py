"""The driver owns its I/O node, sees another master, and knows a reply of an earlier exchange."""

import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace

import pytest
from pymodbus.client import ModbusTcpClient

from rig.emulator.running import EmulatorThread
from rig.io.driver import DriverError, ExchangeStatus
from rig.io.modbus_daq.driver import ModbusDaq
from rig.io.modbus_daq.link import ModbusDaqOptions
from rig.io.modbus_daq.plan import exchange_plans
from tests.rig.io.modbus_bench import Line, framed, shipped_map
from tests.waiting import PATIENCE_S

NODE = shipped_map("io_node")
UNIT = 9


@pytest.fixture(scope="module")
def emulator() -> Iterator[EmulatorThread]:
    with EmulatorThread() as running:
        yield running


def driver(emulator: EmulatorThread, **options: object) -> "closing[ModbusDaq]":
    given = {"port": int(emulator.ports["daq"]), "watchdog": 0.5, "timeout": PATIENCE_S, **options}
    return closing(ModbusDaq("daq", ModbusDaqOptions("127.0.0.1", NODE, **given)))  # type: ignore[arg-type]


class Foreign:
    """Another program that writes to the node, as one that knows no owner."""

    def __init__(self, emulator: EmulatorThread) -> None:
        self._client = ModbusTcpClient("127.0.0.1", port=int(emulator.ports["daq"]))
        assert self._client.connect()
        self._counter = 0

    def write(self) -> int:
        """Write an enabled command; return the exception code, 0 if it was taken."""
        self._counter += 1
        words = struct.unpack(">4H", struct.pack(">HHf", self._counter, 1, 9.0))
        reply = self._client.write_registers(0, list(words))
        return int(reply.exception_code) if reply.isError() else 0

    def close(self) -> None:
        self._client.close()


def test_an_open_driver_owns_the_node_and_gives_it_up_when_it_closes(
    emulator: EmulatorThread,
) -> None:
    with driver(emulator) as daq:
        daq.open()
        assert emulator.status()["daq"]["owned"]
        daq.write({"command_V": 0.0})
        assert daq.read()["device_command_V"] == 0.0
        assert emulator.status()["daq"]["refused_writes"] == 0
    assert not emulator.status()["daq"]["owned"]


def test_another_master_is_refused_by_the_node_and_seen_by_the_owner_once(
    emulator: EmulatorThread,
) -> None:
    with driver(emulator) as daq, closing(Foreign(emulator)) as foreign:
        daq.open()
        daq.read()
        assert foreign.write() == 6
        with pytest.raises(DriverError, match="was written to by another master"):
            daq.read()
        daq.read()
        assert emulator.status()["daq"]["command_V"] == 0.0


@contextmanager
def going_on(turn: Callable[[], object]) -> Iterator[None]:
    """Call `turn` again and again, from a thread of its own, in a `with` block."""
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.005):
            with suppress(DriverError):
                turn()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def test_a_node_that_somebody_drives_is_refused_at_the_start(emulator: EmulatorThread) -> None:
    with driver(emulator) as first, driver(emulator) as second:
        first.open()
        with going_on(first.read), pytest.raises(DriverError, match="driven by another master"):
            second.open()


def test_a_living_owner_that_writes_seldom_is_refused_by_the_node(
    emulator: EmulatorThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.io.modbus_daq.link._WATCH_S", 0.0)
    with driver(emulator) as first, driver(emulator) as second:
        first.open()
        with going_on(first.read), pytest.raises(DriverError, match="owned by another master"):
            second.open()


def test_a_master_that_knows_no_owner_is_seen_at_the_start(emulator: EmulatorThread) -> None:
    with closing(Foreign(emulator)) as foreign, driver(emulator) as daq:
        seen = pytest.raises(DriverError, match="driven by another master: its counter goes on")
        with going_on(foreign.write), seen:
            daq.open()


def test_an_owner_that_died_is_waited_for(emulator: EmulatorThread) -> None:
    with driver(emulator, watchdog=0.2) as dead, driver(emulator, watchdog=0.2) as another:
        dead.open()
        dead.read()
        begun = time.monotonic()
        another.open()
        assert time.monotonic() - begun >= 0.1
        with pytest.raises(DriverError, match="not owned by this program any more"):
            dead.read()


def test_a_node_without_an_owner_s_registers_is_refused_with_the_setting_that_does_without(
    emulator: EmulatorThread,
) -> None:
    # Register 900 is no register of the node.
    assert NODE.owner is not None
    older = replace(NODE, owner=replace(NODE.owner, claim=900))
    options = ModbusDaqOptions("127.0.0.1", older, int(emulator.ports["daq"]), watchdog=0.5)
    with (
        closing(ModbusDaq("daq", options)) as daq,
        pytest.raises(DriverError, match=r"has no register 900 of an owner; .*ownership: none"),
    ):
        daq.open()
    with closing(ModbusDaq("daq", replace(options, ownership="none"))) as daq:
        daq.open()
        daq.read()


def reply_of(transaction: int, echo: int, told: int = 0) -> bytes:
    words = struct.pack(">HHHHIi6f", 1, 1, echo, told, 0, 0, *[0.0] * 6)
    return framed(transaction, bytes((23, 40)) + words)


@pytest.mark.parametrize(
    ("behind", "status"),
    [(0, ExchangeStatus.OK), (1, ExchangeStatus.WRONG_REPLY), (4, ExchangeStatus.WRONG_REPLY),
     (5, ExchangeStatus.OK)],
)  # fmt: skip
def test_a_reply_of_an_earlier_exchange_is_known_by_its_echo(
    behind: int, status: ExchangeStatus
) -> None:
    with Line(NODE) as line:
        # One that is further behind is left to the interlock: the device takes no writes.
        line.send(reply_of(7, (10 - behind) & 0xFFFF))
        assert line.exchange(7, {"host_counter": 10.0}) is status
        line.send(reply_of(8, 11))
        assert line.exchange(8, {"host_counter": 11.0}) is ExchangeStatus.OK


def test_the_heartbeat_is_the_key_and_its_complement_in_turn() -> None:
    plan, look = exchange_plans(NODE, "fc23", UNIT, 0x1234)
    at = plan.checked[0]
    assert look.checked[0] == -1
    assert plan.frames.size == exchange_plans(NODE, "fc23", UNIT)[0].frames.size + 2
    assert at == plan.frames.size - 2
