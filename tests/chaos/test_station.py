"""A station and its clients are killed at any moment, and the rig is safe by its own record."""

import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.cli.live_stream import stream_of
from rig.control_socket import own_name
from rig.runner.run_folder.journal import JOURNAL, read_journal
from rig.stream.client import StreamClient
from tools.chaos.lab import CALIBRATE, HOME, RUN, STREAMED, Lab, lab_in
from tools.chaos.stage import COMPILE_S

pytestmark = pytest.mark.long

KILLS = 20


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with lab_in(tmp_path) as lab:
        yield lab


@pytest.mark.parametrize(
    ("command", "activity", "by"),
    [
        (HOME, "homing", ""),
        (CALIBRATE, "calibrating the bypass valves", ""),
        (RUN, "", "Bo"),
    ],
)
def test_who_drives_is_seen_refuses_others_and_is_stopped_on_the_stream(
    lab: Lab, command: tuple[str, ...], activity: str, by: str
) -> None:
    settings = stream_of(str(lab.stage.stream), paced=True)
    assert settings is not None
    station = lab.station()
    with StreamClient(settings) as client:

        def status() -> Any:
            return client.snapshot("emulated").campaign.get("status")

        def seen() -> Any:
            return "emulated" in client.rigs() and client.snapshot("emulated").alive

        lab.stage.wait(lambda: seen() and status() == "idle", "the idle station")
        assert client.send("abort", "emulated", "").reason == "nothing moves; the rig is disarmed"
        driving = lab.lends(*command)
        moves = ("homing", "running", "armed")
        lab.stage.wait(
            lambda: seen() and client.snapshot("emulated").state.get("state") in moves, "motion"
        )
        campaign = client.snapshot("emulated").campaign
        assert (campaign["activity"], campaign["begun_by"]) == (activity, by or own_name())
        if command is not HOME:
            # Homing would have ended before another program is loaded on a busy machine.
            assert lab.status()["driver"]["by"] == (by or own_name())
            second = lab.rig(*HOME)
            said, _ = second.communicate(timeout=COMPILE_S)
            assert second.returncode == 2, said
            assert f"asked by {by or own_name()}, has the rig since" in said
        assert client.send("abort", "emulated", "enough").accepted
        lab.safe_after(time.monotonic())
        driving.communicate(timeout=60.0)
        assert driving.returncode == 3
        lab.stage.wait(lambda: seen() and status() == "idle", "the idle station again")
    station.send_signal(signal.SIGTERM)
    said, _ = station.communicate(timeout=60.0)
    assert station.returncode == 0, said
    assert lab.stage.is_safe()


@pytest.mark.parametrize("command", [HOME, RUN], ids=["home", "run"])
def test_a_stop_that_nobody_hears_yet_ends_what_connects_before_anything_moves(
    lab: Lab, command: tuple[str, ...]
) -> None:
    """The station has left the rig, and whoever has asked for it does not serve a stream yet."""
    settings = stream_of(str(lab.stage.stream), paced=True)
    assert settings is not None
    lab.station()
    with StreamClient(settings) as client:
        lab.stage.wait(lambda: "emulated" in client.rigs(), "the idle station")
        driving = lab.lends(*command)
        unheard = client.send("abort", "emulated", "Ada", 0.1)
        assert unheard.is_unheard
        answer = client.send_until_heard("abort", "emulated", "Ada: it smells", 60.0, "Ada")
        assert answer.accepted, answer.reason
        said, _ = driving.communicate(timeout=COMPILE_S)
        states = {event["text"] for event in client.snapshot("emulated").events}
    assert driving.returncode == 3, said
    assert "homing: " not in said
    assert not any("homing: " in text for text in states)
    if command is RUN:
        end = read_journal(lab.stage.folder / "out" / JOURNAL)[-1]
        assert (end.kind, end["reason"]) == ("end", "Ada: it smells")
    else:
        assert "stopped by Ada: it smells" in said
    assert lab.stage.is_safe()


def killed(lab: Lab, number: int, draw: random.Random) -> tuple[float, bool, list[str]]:
    """Start a client of the lab's station and kill it at a drawn moment.

    Every fourth one is killed at a moment after its start, so that it may not have asked for the
    rig yet, and the others after they have got it.

    Returns:
        The time until the rig was safe, s; whether it was not safe when the kill came; and what the
        station has kept of its lease then (`Lab.lease_of`).
    """
    arguments = HOME if number % 2 else (*RUN, "--resume")
    client = lab.rig(*arguments) if number % 4 == 3 else lab.lends(*arguments)
    time.sleep(draw.uniform(0.0, 12.0))
    moved, at = not lab.stage.is_safe(), time.monotonic()
    client.kill()
    client.wait()
    took = lab.safe_after(at)
    lab.stage.wait(lab.is_idle, "the station to read the rig")
    return took, moved, lab.lease_of(client.pid)


def test_clients_killed_at_any_moment_leave_a_safe_rig_that_the_station_takes_back(
    lab: Lab,
) -> None:
    draw, took, ends = random.Random(19), [], []
    lab.station()
    for number in range(KILLS):
        safe_s, moved, kept = killed(lab, number, draw)
        took.append(safe_s)
        ends.append(kept[-1] if kept else "never asked")
        # One that had the valve enabled, a bypass open or the pump loaded had the rig, and could
        # not say its last word. Of the others the station's record tells what they had come to.
        assert kept in ([], ["lent", "returned"], ["lent", "died"])
        assert kept == ["lent", "died"] or not moved
        found = lab.kept("found")[-1]
        assert "OPEN" not in found
        assert "LOADED" not in found
    assert "died" in ends
    print("safe after", " ".join(f"{each:.2f}" for each in took), "s;", ", ".join(ends))


def test_a_station_killed_at_any_moment_leaves_a_safe_rig_and_lets_a_client_go_on(
    lab: Lab,
) -> None:
    draw, took = random.Random(20), []
    for number in range(KILLS):
        station = lab.station()
        if number % 2:
            client = lab.lends(*HOME)
            time.sleep(draw.uniform(0.0, 4.0))
            station.kill()
            again = lab.rig("station", "rig.yaml", *STREAMED)
            found = len(lab.kept("found"))
            said, _ = client.communicate(timeout=COMPILE_S)
            assert client.returncode == 0, said
            lab.safe_after(time.monotonic())
            lab.found_again(found)
            again.terminate()
            again.communicate(timeout=60.0)
        else:
            time.sleep(draw.uniform(0.0, 2.0))
            at = time.monotonic()
            station.kill()
            took.append(lab.safe_after(at))
    print("safe after", " ".join(f"{each:.2f}" for each in took), "s")
