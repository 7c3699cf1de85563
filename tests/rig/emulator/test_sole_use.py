"""Two emulators on one machine do not share a bus or a line unawares."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from rig.configuration.rigs.rig import load_rig
from rig.emulator.addresses import HOST, Address, Endpoints, endpoints_of
from rig.emulator.running import EmulatorThread
from rig.emulator.sole_use import ServedAlreadyError, sole_use


@pytest.fixture
def endpoints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Endpoints:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    rig = load_rig("emulated")
    return replace(endpoints_of(rig), bypass=tmp_path / "bypass", meters=tmp_path / "meters")


def test_the_second_emulator_is_told_all_that_is_taken_by_whom_and_the_remedy(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    with (
        sole_use(endpoints),
        pytest.raises(ServedAlreadyError) as refused,
        sole_use(endpoints),
    ):
        pass
    bus, meters, bypass = refused.value.problems
    owner = f"is served by the emulator of process {os.getpid()} already; end it, or give"
    assert bus == (
        f"CAN by multicast at the UDP port 15504 {owner} the drivers of the CAN bus another `port` "
        "in the rig file (not the group alone)"
    )
    assert meters == (
        f"the serial line {tmp_path}/meters {owner} another path as `port` of its driver in the "
        "rig file"
    )
    assert f"the serial line {tmp_path}/bypass {owner} another path as `device`" in bypass


def test_another_group_at_the_same_port_is_the_same_bus(endpoints: Endpoints) -> None:
    elsewhere = replace(endpoints, meters=None, bypass=None)
    drive = replace(endpoints.drive, channel="239.74.163.3")
    pump = replace(endpoints.pump, channel="239.74.163.3")
    with sole_use(endpoints):
        with (
            pytest.raises(ServedAlreadyError, match="port 15504"),
            sole_use(replace(elsewhere, drive=drive, pump=pump)),
        ):
            pass
        drive, pump = replace(drive, port=1025), replace(pump, port=1025)
        with sole_use(replace(elsewhere, drive=drive, pump=pump)):
            pass


def test_what_was_served_may_be_served_again_and_who_is_refused_leaves_it_alone(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    served = Endpoints(Address(HOST, 0), meters=tmp_path / "meters")
    with EmulatorThread(endpoints=served):
        line = (tmp_path / "meters").readlink()
        with pytest.raises(ServedAlreadyError):
            EmulatorThread(endpoints=served).__enter__()
        assert (tmp_path / "meters").readlink() == line
    with EmulatorThread(endpoints=served):
        assert (tmp_path / "meters").exists()
