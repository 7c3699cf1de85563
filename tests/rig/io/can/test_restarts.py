"""What is said to be a restart of the digital servovalve is one, on an emulated valve."""

from collections.abc import Iterator

import pytest

from rig.io.can.canopen import HEARTBEAT, TPDO1
from rig.io.can.ds408 import DriveState
from rig.io.can.libraries import python_can as can
from rig.io.driver import DriverError

from .test_valve import NODE, ValveBench


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[ValveBench]:
    opened = ValveBench(request.node.nodeid)
    yield opened
    opened.close()


def test_a_valve_that_restarts_is_reported(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.receive(can.Message(arbitration_id=0, data=[0x81, NODE], is_extended_id=False))
    with pytest.raises(DriverError, match="node 5 has restarted: it has sent its boot-up message"):
        bench.read(driver, 10)


def test_a_restart_is_reported_also_if_another_master_started_the_node_again(
    bench: ValveBench,
) -> None:
    driver = bench.active()
    for command in (0x81, 0x01):
        order = can.Message(arbitration_id=0, data=[command, NODE], is_extended_id=False)
        bench.valve.receive(order)
        bench.clock()
    with pytest.raises(DriverError, match="node 5 has restarted: it has sent its boot-up message"):
        bench.read(driver, 10)


def test_a_node_that_another_master_stops_is_not_said_to_have_restarted(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.receive(can.Message(arbitration_id=0, data=[0x80, NODE], is_extended_id=False))
    with pytest.raises(DriverError, match="is in PRE_OPERATIONAL, not OPERATIONAL: another master"):
        bench.read(driver, 10)


def test_a_heartbeat_from_before_the_own_start_command_is_no_restart(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The node is OPERATIONAL from a session before. Its heartbeat of the state to which the set-up
    # brings it has a lower priority on the bus than the status message that follows.
    bench.opened().close()
    statuses: list[can.Message] = []
    heartbeats: list[can.Message] = []

    def by_priority(frame: can.Message) -> None:
        orders = [e["command"] for e in bench.record.events if e["event"] == "drive_nmt"]
        if frame.arbitration_id == HEARTBEAT + NODE and len(orders) > 2:
            heartbeats.append(frame)
            return
        bench.bus.send(frame)
        if frame.arbitration_id == TPDO1 + NODE and len(orders) > 3:
            statuses.append(frame)
            if len(statuses) % 2 == 0 and heartbeats:
                bench.bus.send(heartbeats.pop(0))

    monkeypatch.setattr(bench.valve, "_send_frame", by_priority)
    driver = bench.opened()
    assert bench.read(driver, 10)["drive_state"] == DriveState.INIT
    assert len(statuses) > 4
