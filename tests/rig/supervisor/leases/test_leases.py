"""A station lends its rig to one client at a time, and a lease ends with its last process."""

import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rig.configuration import Rig, load_rig
from rig.control_socket import own_name
from rig.io.driver import DriverError
from rig.loop.interlocks.trip import StopRequestedError
from rig.supervisor.leases import asking, keeper as keeper_module, protocol
from rig.supervisor.leases.asking import leased, tell_station, why_busy, word_of_station
from rig.supervisor.leases.keeper import Keeper, Lease
from rig.supervisor.processes.onlooker import Errand
from rig.surviving import Surviving
from tests.waiting import until

HOMING = Errand("homing", "Bo")


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Return a rig whose station, if any, is of this test alone.

    Its folder has a short path, as that of a socket may have 107 bytes.
    """
    with tempfile.TemporaryDirectory(prefix="rig-") as folder:
        monkeypatch.setattr("tempfile.tempdir", folder)
        yield load_rig("emulated")


@pytest.fixture
def failures() -> list[str]:
    return []


@pytest.fixture
def keeper(rig: Rig, failures: list[str]) -> Iterator[Keeper]:
    with Keeper(rig, Surviving("the socket", failures.append)) as keeper:
        keeper.stands("idle", "nothing drives")
        yield keeper
    assert failures == []


@pytest.fixture
def granting(keeper: Keeper) -> Iterator[None]:
    """Let the station leave its rig to everybody who asks."""
    ended = threading.Event()

    def grant() -> None:
        while not ended.is_set():
            if keeper.asked is not None:
                keeper.grant(keeper.asked)
            keeper.changed.wait(0.01)
            keeper.changed.clear()

    thread = threading.Thread(target=grant)
    thread.start()
    yield
    ended.set()
    thread.join()


def look() -> None:
    """Look at nothing."""


def lease_of(keeper: Keeper) -> Lease:
    """Return the lease that somebody has asked for, once that is so."""
    lease = until(lambda: keeper._lease, "the lease")
    assert lease is not None
    return lease


def test_without_a_station_nobody_is_asked(rig: Rig) -> None:
    with leased(rig, HOMING, look) as kept:
        assert kept == ()
    assert word_of_station(rig) is None


def test_a_socket_that_a_killed_station_left_is_no_station(rig: Rig) -> None:
    folder = protocol.folder_of_station(rig)
    folder.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(folder / "control.sock"))
    assert word_of_station(rig) is None
    with Keeper(rig, Surviving("the socket", print)):
        assert word_of_station(rig) is not None


@pytest.mark.usefixtures("granting")
def test_who_drives_is_told_to_everybody_until_the_lease_ends(rig: Rig, keeper: Keeper) -> None:
    with leased(rig, HOMING, look) as kept:
        assert len(kept) == 1
        status = word_of_station(rig)
        assert status is not None
        assert status["state"] == "driven"
        assert status["driver"]["what"] == "homing"
        assert why_busy(rig).startswith("homing, asked by Bo, has the rig since ")
        assert f"(process {os.getpid()})" in why_busy(rig)
        with pytest.raises(DriverError, match=r"homing, asked by Bo, .*wait for its end"):
            ExitStack().enter_context(leased(rig, Errand("tuning", "Eve"), look))
    until(lambda: keeper.status["state"] == "idle", "the end of the lease")
    assert why_busy(rig) == ""


@pytest.mark.usefixtures("granting")
def test_a_client_without_an_errand_is_known_by_its_command_line(
    rig: Rig, keeper: Keeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/somewhere/cli/__main__.py", "home", "--rig", "my rig"])
    with leased(rig, Errand(), look):
        driver = keeper.status["driver"]
    assert (driver["what"], driver["by"]) == ("rig home --rig 'my rig'", own_name())


@pytest.mark.usefixtures("granting")
@pytest.mark.parametrize("says", [True, False])
def test_it_is_known_whether_a_client_ended_or_died(rig: Rig, keeper: Keeper, says: bool) -> None:
    context = leased(rig, HOMING, look)
    (kept,) = context.__enter__()
    lease = lease_of(keeper)
    if says:
        context.__exit__(None, None, None)
    else:
        # Who is killed closes its descriptors, and says nothing.
        os.dup2(os.open(os.devnull, os.O_RDONLY), kept)
    until(lambda: not keeper.holds(lease), "the end of the lease")
    assert lease.said_end == says


ENDED: dict[str, Any] = {
    "campaign": {"name": "leaks", "tests": [{"name": "a test"}] * 2000},
    "decision": {}, "trips": {}, "folder": "/runs/leaks",
}  # fmt: skip


@pytest.mark.usefixtures("granting")
def test_who_had_the_rig_last_says_how_that_ended_and_nobody_else_does(
    rig: Rig, keeper: Keeper
) -> None:
    tell_station(rig, ENDED)
    with leased(rig, HOMING, look):
        lease = lease_of(keeper)
    until(lambda: not keeper.holds(lease), "the end of the lease")
    tell_station(rig, ENDED | {"trips": "none"})
    assert lease.told is None
    tell_station(rig, ENDED)
    assert lease.told == ENDED
    lease.told, lease.pid = None, 1
    tell_station(rig, ENDED)
    assert lease.told is None


@pytest.mark.usefixtures("granting")
def test_a_lease_lasts_as_long_as_a_process_that_has_its_descriptor(
    rig: Rig, keeper: Keeper
) -> None:
    with ExitStack() as stack:
        (kept,) = stack.enter_context(leased(rig, HOMING, look))
        part = subprocess.Popen(
            [sys.executable, "-S", "-c", "input()"], pass_fds=(kept,), stdin=subprocess.PIPE
        )
    lease = lease_of(keeper)
    until(lambda: lease.said_end, "the client's last word")
    assert keeper.holds(lease)
    part.communicate(b"\n")
    until(lambda: not keeper.holds(lease), "the end of the lease")


def test_a_client_that_is_stopped_while_it_waits_goes_without_the_rig(
    rig: Rig, keeper: Keeper
) -> None:
    def stopped() -> None:
        raise StopRequestedError("stopped by SIGINT")

    with pytest.raises(StopRequestedError):
        ExitStack().enter_context(leased(rig, HOMING, stopped))
    until(lambda: keeper.asked is None, "the end of the request")


def test_who_is_refused_learns_why(rig: Rig, keeper: Keeper) -> None:
    def refuse() -> None:
        keeper.refuse(lease_of(keeper), "bypass: not safe", "look at it")

    thread = threading.Thread(target=refuse)
    thread.start()
    with pytest.raises(DriverError, match="emulated: bypass: not safe; look at it"):
        ExitStack().enter_context(leased(rig, HOMING, look))
    thread.join()
    assert keeper.asked is None


def test_a_lease_that_has_ended_is_not_granted(keeper: Keeper) -> None:
    gone = cast(Any, SimpleNamespace())
    assert not keeper.grant(gone)
    keeper.refuse(gone, "", "")


def test_a_station_itself_does_not_ask_itself(rig: Rig, keeper: Keeper) -> None:
    with leased(rig, Errand("watch", "Bo", of_station=True), look) as kept:
        assert kept == ()
    assert keeper.asked is None


def test_a_second_station_of_the_same_devices_is_refused(rig: Rig, keeper: Keeper) -> None:
    with pytest.raises(DriverError, match=f"its station is the process {os.getpid()} already"):
        Keeper(rig, Surviving("the socket", print)).__enter__()
    assert word_of_station(rig) is not None


@pytest.mark.usefixtures("keeper")
@pytest.mark.parametrize(("module", "ours", "theirs"), [(asking, 1, 2), (keeper_module, 2, 1)])
def test_between_two_versions_both_are_named(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, module: Any, ours: int, theirs: int
) -> None:
    monkeypatch.setattr(module, "PROTOCOL", 2)
    named = rf"version 0.1.0 with protocol {ours}, .* version 0.1.0 with (protocol )?{theirs}"
    with pytest.raises(DriverError, match=named):
        word_of_station(rig)


@pytest.mark.parametrize(
    "said",
    [b"\xff\n", b"[]\n", b"{", b'{"protocol": 1, "request": "fly"}\n', b'{"request": "lease"}\n'],
)
def test_who_says_what_is_no_request_gets_no_lease(
    rig: Rig, keeper: Keeper, said: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper_module, "REQUEST_S", 0.1)
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(protocol.folder_of_station(rig) / "control.sock"))
        client.sendall(said)
        client.recv(1 << 16)
        assert client.recv(1) == b""
    assert keeper.status["state"] == "idle"


def test_a_folder_of_another_user_holds_no_station(
    rig: Rig, keeper: Keeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = protocol.folder_of_station(rig)
    uid = os.getuid()
    monkeypatch.setattr("os.getuid", lambda: uid + 1)
    assert not protocol.is_own_folder(folder)


def test_a_station_without_devices_leaves_it_to_their_locks_who_is_busy(
    rig: Rig, keeper: Keeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    keeper.stands("no devices", "they do not answer")
    monkeypatch.setattr(asking, "in_use", lambda drivers: "daq: in use by the process 7")
    assert why_busy(rig) == "daq: in use by the process 7"


def test_what_a_client_says_of_itself_is_one_line_of_bounded_length() -> None:
    line: Callable[[object], str] = keeper_module._line
    assert line("homing\n\x1b[2J") == "homing[2J"
    assert len(line("x" * 9999)) == keeper_module.LONGEST_TEXT
    assert line(None) == "unknown"
