"""Every way in which a run on the emulated rig can end has the exit code that is promised.

In the default suite, `tests/rig/runner/campaign/test_ways_to_end.py` has ways of a simulated rig.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from signal import SIGHUP, SIGINT, SIGKILL, SIGTERM, Signals
from typing import Any

import pytest
import yaml

from rig.cli.live_stream import stream_of
from rig.control_socket import ask
from rig.stream.client import StreamClient
from tools.chaos.stage import COMPILE_S, ROOT, Stage

TRACEBACK = "raceback"
ALL = ("supervisor", "loop", "field", "recorder")
LOST = "tripped: "
FULL = "the disk is full"
OPEN = "the emergency stop is open: make the rig safe and release its button"


def with_the_emergency_stop_open(stage: Stage) -> None:
    stage.inject(fault="estop")
    stage.start()


def without_devices(stage: Stage) -> None:
    stage.send(SIGKILL, "emulator")
    stage.start()


def in_a_test(what: Callable[[Stage], None]) -> Callable[[Stage], None]:
    def begin(stage: Stage) -> None:
        stage.begin()
        what(stage)

    return begin


def while_it_is_armed(what: Callable[[Stage], None]) -> Callable[[Stage], None]:
    def begin(stage: Stage) -> None:
        stage.ask(do="operator", attentive=False)
        stage.start()
        stage.wait(lambda: "press it on the rig" in stage.printed, "the reset button", COMPILE_S)
        stage.find_children()
        what(stage)

    return begin


def while_it_is_homed(what: Callable[[Stage], None]) -> Callable[[Stage], None]:
    def begin(stage: Stage) -> None:
        path = stage.folder / "rig.yaml"
        shipped = yaml.safe_load((ROOT / "config" / "rigs" / "emulated.yaml").read_text())
        rig = yaml.safe_load(path.read_text()) | {"homing": shipped["homing"]}
        path.write_text(yaml.safe_dump(rig))
        stage.start()
        stage.wait(lambda: "homing: " in stage.printed, "the homing run", COMPILE_S)
        stage.find_children()
        what(stage)

    return begin


def at_its_reset(stage: Stage) -> None:
    stage.begin()
    stage.send(SIGINT, "supervisor")
    stage.wait(lambda: stage.run.poll() is not None, "the run to end")
    stage.inject(fault="estop")
    stage.start("--resume")


def by_the_stream(stage: Stage) -> None:
    settings = stream_of(str(stage.stream), paced=True)
    assert settings is not None
    with StreamClient(settings) as client:
        stage.wait(lambda: "emulated" in client.rigs(), "the stream")
        assert client.send("abort", "emulated").accepted


def by_rig_control(stage: Stage) -> None:
    ask(stage.out, "abort", "enough")


def press(stage: Stage) -> None:
    stage.inject(fault="estop")


def press_and_give_up(stage: Stage) -> None:
    press(stage)
    stage.wait(lambda: "the emergency stop is open" in stage.printed, "the operator to be told")
    stage.send(SIGTERM, "supervisor")


def send(number: Signals, *parts: str) -> Callable[[Stage], None]:
    return lambda stage: stage.send(number, *parts)


def fill(*parts: str) -> Callable[[Stage], None]:
    return lambda stage: stage.limit_files(*parts)


@dataclass(frozen=True)
class Way:
    """A way to end.

    Attributes:
        what: happens.
        do: starts a run and has it happen.
        exit_code: that is promised.
        says: what the operator reads.
        trip: how the cause in the trip report ends; empty if there is to be no report.
        reported: whether results and report tell of it: not where nobody is left to, or no room.
    """

    what: str
    do: Callable[[Stage], None]
    exit_code: int
    says: str
    trip: str = ""
    reported: bool = True


WAYS = [
    Way("start with the emergency stop open", with_the_emergency_stop_open, 3, OPEN),
    Way("reset with the emergency stop open", at_its_reset, 3, OPEN),
    Way("start without the devices", without_devices, 2, "cannot connect", reported=False),
    Way("stopped while armed", while_it_is_armed(send(SIGINT, "supervisor")), 3, "1 not run"),
    Way("emergency stop while armed", while_it_is_armed(press_and_give_up), 3, "1 not run"),
    Way("loop killed while armed", while_it_is_armed(send(SIGKILL, "loop")), 3, LOST, "LOOP_LOST"),
    Way("no power while armed", while_it_is_armed(send(SIGKILL, "emulator")), 3, LOST, "_LOST"),
    Way("emergency stop while homed", while_it_is_homed(press), 3, "tripped", "ESTOP_OPEN"),
    Way("emergency stop in a test", in_a_test(press), 3, "tripped", "ESTOP_OPEN"),
    Way("disk full for the recording", in_a_test(fill("recorder")), 3, FULL, "DISK_FULL"),
    Way("disk full for all", in_a_test(fill(*ALL)), 3, FULL, reported=False),
    Way("supervisor killed", in_a_test(send(SIGKILL, "supervisor")), -9, "", reported=False),
    Way("SIGINT", in_a_test(send(SIGINT, "supervisor")), 3, "1 aborted"),
    Way("SIGTERM", in_a_test(send(SIGTERM, "supervisor")), 3, "1 aborted"),
    Way("SIGHUP", in_a_test(send(SIGHUP, "supervisor")), 3, "1 aborted"),
    Way("rig control", in_a_test(by_rig_control), 3, "1 aborted"),
    Way("the stream", in_a_test(by_the_stream), 3, "1 aborted"),
]


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.what)
def test_a_run_ends_with_the_exit_code_that_is_promised(way: Way, tmp_path: Path) -> None:
    with Stage(tmp_path) as stage:
        way.do(stage)
        stage.wait(lambda: stage.run.poll() is not None, "`rig run` to end", 2 * COMPILE_S)
        assert stage.run.returncode == way.exit_code, stage.printed
        stage.wait(lambda: not stage.living(), "its processes to end")
        if stage.emulator_lives:
            stage.wait(stage.is_safe, "the safe state")
        assert way.says in stage.printed
        assert TRACEBACK not in stage.printed
        if way.reported:
            results: dict[str, Any] = json.loads((stage.out / "results.json").read_text())
            assert results["exit_code"] == way.exit_code
            assert (stage.out / "report.html").is_file()
            assert (stage.out / "junit.xml").is_file()
        trips = list(stage.out.glob("trip-*.json"))
        assert bool(trips) == bool(way.trip)
        if way.trip:
            assert json.loads(trips[0].read_text())["cause"].endswith(way.trip)
