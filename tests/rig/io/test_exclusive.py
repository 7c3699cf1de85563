"""Two programs never drive the same device: the second learns who has it."""

import os
import pwd
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from rig.io.can.ds408_valve import CanValveOptions
from rig.io.can.pump import CanPumpOptions
from rig.io.device_lock import connection_of, exclusive, in_use
from rig.io.driver import DriverError
from rig.io.registry import DriverSpec


@dataclass(frozen=True)
class Options:
    """Of a driver on the network."""

    host: str = "127.0.0.1"
    port: int = 1


@dataclass(frozen=True)
class BusOptions:
    """Of a driver on a bus."""

    channel: str = "can0"


def spec(name: str, options: object) -> DriverSpec:
    return DriverSpec(name, "fake", "", options, "slow", (), (), 1.0)


@pytest.fixture
def device(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> DriverSpec:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return spec("daq", Options())


def test_a_device_that_another_program_has_is_refused_with_its_process(device: DriverSpec) -> None:
    with (
        exclusive([device]),
        pytest.raises(
            DriverError, match=rf"daq: 127.0.0.1:1 is in use by the process {os.getpid()}"
        ),
        exclusive([device]),
    ):
        pass


def test_whether_a_device_is_in_use_is_known_without_taking_it(device: DriverSpec) -> None:
    assert in_use([device]) == ""
    with exclusive([device]):
        why = f"daq: 127.0.0.1:1 is in use by the process {os.getpid()}"
        assert in_use([spec("meters", Options(port=2)), device]) == why
    assert in_use([device]) == ""


def test_of_another_users_program_the_user_is_named_with_what_can_be_done(
    device: DriverSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    with exclusive([device]):
        user = pwd.getpwuid(os.stat("/proc/self").st_uid).pw_name
        monkeypatch.setattr(os, "getuid", lambda: -1)
        whose = f"in use by the process {os.getpid()} of the user {user}"
        assert in_use([device]) == f"daq: 127.0.0.1:1 is {whose}"
        with pytest.raises(DriverError, match=f"{whose}.*lends the rig to commands of {user} only"):
            exclusive([device]).__enter__()


def test_two_drivers_of_a_rig_with_the_same_device_are_both_named(device: DriverSpec) -> None:
    why = "meters: 127.0.0.1:1 is the device of the driver daq of this rig too; give each"
    both = [device, spec("meters", Options())]
    with pytest.raises(DriverError, match=why):
        exclusive(both).__enter__()
    with exclusive([device]):
        pass


def test_it_is_free_again_afterwards_whatever_ended_it(device: DriverSpec) -> None:
    with pytest.raises(ZeroDivisionError), exclusive([device]):
        raise ZeroDivisionError
    with exclusive([device]):
        pass


def test_other_devices_and_buses_are_no_matter_of_it(device: DriverSpec) -> None:
    with exclusive([device]), exclusive([spec("other", Options(port=2))]):
        pass
    bus = spec("drive", BusOptions())
    assert connection_of(bus.options) is None
    with exclusive([bus]), exclusive([bus]):
        pass


def test_of_a_bus_each_node_has_one_program(device: DriverSpec) -> None:
    valve = spec("drive", CanValveOptions(channel="can0", node=5))
    other_valve = spec("other", CanValveOptions(channel="can0", node=6))
    emulated = CanValveOptions(interface="udp_multicast", channel="239.0.0.1", port=1024, node=5)
    assert connection_of(emulated) != connection_of(replace(emulated, port=1025))
    pump = spec("pump", CanPumpOptions(channel="can0", dbc=Path("pump_unit.dbc")))
    with (
        exclusive([device, valve, other_valve, pump]),
        pytest.raises(DriverError, match="drive: node 5 on can0 is in use"),
        exclusive([valve]),
    ):
        pass
    with (
        exclusive([pump]),
        pytest.raises(DriverError, match="pump: pump_unit on can0 is in use"),
        exclusive([pump]),
    ):
        pass


def test_a_lock_is_for_runs_of_all_users_whatever_the_umask(
    device: DriverSpec, tmp_path: Path
) -> None:
    before = os.umask(0o077)
    try:
        with exclusive([device]):
            (lock,) = tmp_path.iterdir()
    finally:
        os.umask(before)
    assert lock.stat().st_mode & 0o777 == 0o666


def test_a_lock_that_cannot_be_opened_is_named_with_the_remedy(
    device: DriverSpec, tmp_path: Path
) -> None:
    with exclusive([device]):
        (lock,) = tmp_path.iterdir()
    lock.unlink()
    lock.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DriverError, match=rf"lock of 127.0.0.1:1 cannot.*delete {lock}"):
        exclusive([device]).__enter__()
    assert not (tmp_path / "elsewhere").exists()
