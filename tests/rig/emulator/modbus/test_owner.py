"""One master owns the emulated I/O node, and others are refused (docs/io_node.md, Ownership)."""

from struct import pack, unpack

import pytest

from rig.emulator.modbus.functions import ModbusException
from tests.rig.emulator.conftest import Bench

KEY, OTHER = 0x1234, 0x4321
ENABLE, LAMP = 1, 4


class Master:
    """A master that owns the node by a key; without a key it writes registers 0 to 3 only."""

    def __init__(self, bench: Bench, key: int = 0) -> None:
        self._node, self._bench = bench.node, bench
        self._key = self._beat = key
        self.counter = 0

    def claim(self) -> None:
        self._node.write(640, pack(">H", self._key))

    def release(self) -> None:
        self._node.write(641, pack(">H", self._key))

    def write(self, bits: int = 0, command_V: float = 0.0, *, beats: bool = True) -> None:  # noqa: N803
        self.counter += 1
        data = pack(">HHf", self.counter, bits, command_V)
        if self._key:
            self._beat ^= 0xFFFF * beats
            data += pack(">H", self._beat)
        self._node.write(0, data)

    def enable(self) -> None:
        self.write(LAMP)
        self._node.press_reset(True)
        self._node.press_reset(False)
        self.write(ENABLE, 1.0)


@pytest.fixture
def owner(bench: Bench) -> Master:
    master = Master(bench, KEY)
    master.claim()
    return master


def told(bench: Bench) -> int:
    return int(unpack(">H", bench.node.read(259, 1))[0])


def test_a_node_without_an_owner_is_as_nodes_were_before(bench: Bench) -> None:
    Master(bench).enable()
    assert bench.node.enabled
    assert told(bench) == 0
    assert bench.node.read(640, 2) == bytes(4)


def test_what_others_write_is_refused_and_counted_and_the_owner_goes_on(
    bench: Bench, owner: Master
) -> None:
    owner.enable()
    for other in (Master(bench), Master(bench, OTHER)):
        with pytest.raises(ModbusException) as refused:
            other.write(ENABLE, 9.0)
        assert refused.value.code == 6
    assert bench.node.enabled
    assert bench.plant.truth is not None
    owner.write(ENABLE, 1.0)
    assert told(bench) == 0x8002
    assert bench.events().count("another_master_refused") == 1


def test_without_the_heartbeat_that_toggles_enable_falls(bench: Bench, owner: Master) -> None:
    owner.enable()
    for _ in range(30):
        bench.clock.advance(0.01)
        owner.write(ENABLE, 1.0)
    assert bench.node.enabled
    # The counter goes on, as that of a program whose loop hangs behind a gateway that repeats.
    for _ in range(30):
        bench.clock.advance(0.01)
        owner.write(ENABLE, 1.0, beats=False)
    assert not bench.node.enabled
    assert "watchdog_trip" in bench.events()


def test_the_key_cannot_be_read(bench: Bench, owner: Master) -> None:
    owner.write()
    assert bench.node.read(640, 2) == pack(">HH", 1, 0)
    assert bench.node.read(4, 1) == bytes(2)


def test_a_living_owner_stays_and_a_dead_one_is_replaced_with_the_relay_open(
    bench: Bench, owner: Master
) -> None:
    owner.enable()
    other = Master(bench, OTHER)
    with pytest.raises(ModbusException):
        other.claim()
    assert bench.node.enabled
    bench.clock.advance(0.2)
    other.claim()
    assert not bench.node.enabled
    with pytest.raises(ModbusException):
        owner.write()
    other.write()
    assert told(bench) == 0x8001


def test_an_owner_that_gives_the_node_up_leaves_the_relay_open(bench: Bench, owner: Master) -> None:
    owner.enable()
    with pytest.raises(ModbusException):
        Master(bench, OTHER).release()
    owner.release()
    assert not bench.node.enabled
    Master(bench).write()


@pytest.mark.parametrize("key", [0, 0x8000, 0xFFFF])
def test_what_is_no_key_is_refused(bench: Bench, key: int) -> None:
    with pytest.raises(ModbusException) as refused:
        bench.node.write(640, pack(">H", key))
    assert refused.value.code == 3


def test_anybody_may_null_the_valve_of_an_owned_node(bench: Bench, owner: Master) -> None:
    owner.enable()
    bench.node.write(768, pack(">H", 1))
    assert not bench.node.enabled


def test_the_watchdog_s_time_is_not_changed_while_an_owner_drives(
    bench: Bench, owner: Master
) -> None:
    bench.node.write(514, pack(">H", 50))
    owner.enable()
    with pytest.raises(ModbusException):
        bench.node.write(514, pack(">H", 1000))
