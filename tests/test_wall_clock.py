"""Nothing measures how long something takes by a clock that somebody may set."""

import ast
import re
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from rig.stream.steady_clock import SteadyClock
from rig.stream.view import RigView

ROOT = Path(__file__).parents[1]
HOUR_NS = 3600 * 10**9

TIMES_OF_DAY = {
    "rig/cli/application.py": "the name of a file",
    "rig/cli/campaigns/run.py": "the name of a folder",
    "rig/cli/campaigns/runs.py": "which runs are older than so many days",
    "rig/cli/campaigns/schedule.py": "a schedule's times are times of day",
    "rig/cli/hardware/calibrate.py": "the day of a calibration",
    "rig/cli/hardware/commission.py": "the day of a commissioning",
    "rig/cli/hardware/home.py": "the name of a folder",
    "rig/cli/hardware/jog.py": "the name of a folder",
    "rig/cli/hardware/leak_test.py": "the day of a leak test",
    "rig/cli/models/gap_finding.py": "a seed",
    "rig/cli/models/identify.py": "the day of an identification",
    "rig/cli/models/sweep.py": "the name of a folder",
    "rig/cli/models/tune.py": "the day of a tuning",
    "rig/configuration/checking.py": "which times of a schedule come next",
    "rig/console/feed.py": "when a notice or a sample came, for the page",
    "rig/console/launcher.py": "when a run was started, for the page; the name of a folder",
    "rig/console/queue/queue_file.py": "when a campaign was queued, for people",
    "rig/console/server.py": "up to when a history is asked for, for the page",
    "rig/console/logins.py": "until when a login holds, also over a restart",
    "rig/console/visitors.py": "since when somebody has control, for the page",
    "rig/io/transducer_calibration.py": "whether a calibration has expired today",
    "rig/runner/campaign/campaign_run.py": "when a run was begun",
    "rig/runner/campaign/simulated_bench.py": "when a recording was begun",
    "rig/runner/campaign/streamed.py": "when a run was begun, for readers of the stream",
    "rig/runner/counters/store.py": "when counters were written",
    "rig/runner/run_folder/journal.py": "when something happened, in the journal",
    "rig/runner/station/last_use.py": "when what drove the rig last ended, and was seen",
    "rig/runner/station/station_log.py": "when something happened, in the station's log",
    "rig/stream/commands.py": "whether a command is of now, by clocks of two machines",
    "rig/stream/sender.py": "when a message was sent",
    "rig/stream/steady_clock.py": "where the steady clock begins",
    "rig/supervisor/leases/keeper.py": "since when somebody has the rig, for people",
    "rig/supervisor/processes/publisher.py": "when a row was taken, for readers of the stream",
    "rig/supervisor/session.py": "when a recording was begun",
    "rig/supervisor/trip_report.py": "when a trip was, for people",
}
"""Modules that ask for the time of day, and what for: none of it is how long something took."""
WALL = {"time.time", "time.time_ns", "datetime.now", "datetime.datetime.now", "datetime.utcnow"}
NAMES = {name.rpartition(".")[2] for name in WALL}


def wall_calls(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield each place where a program asks for the time of day, called or handed on."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in NAMES and ast.unparse(node) in WALL:
            yield node


def differences(tree: ast.AST) -> list[str]:
    """Return the differences of two times of day that are taken in one expression."""
    return [
        ast.unparse(node)
        for node in ast.walk(tree)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub)
        if next(wall_calls(node.left), None) and next(wall_calls(node.right), None)
    ]


@cache
def product() -> dict[str, ast.Module]:
    texts = {
        str(file.relative_to(ROOT)): file.read_text(encoding="utf-8")
        for package in ("rig", "control", "estimator", "faults")
        for file in sorted((ROOT / package).rglob("*.py"))
    }
    # Parsing all of them takes two seconds, and the others name no clock of this kind.
    named = re.compile(r"time\.time|datetime\.(utc)?now|from time import")
    return {name: ast.parse(text) for name, text in texts.items() if named.search(text)}


def test_the_time_of_day_is_asked_for_where_a_time_of_day_is_meant() -> None:
    modules = product()
    asking = {name for name, tree in modules.items() if next(wall_calls(tree), None)}
    assert asking == set(TIMES_OF_DAY)
    found = {name: differences(modules[name]) for name in asking}
    assert {name: each for name, each in found.items() if each} == {}


def test_what_would_measure_by_the_time_of_day_is_found() -> None:
    tree = ast.parse("import time\nlate = time.time() - (begun + time.time())")
    assert len(list(wall_calls(tree))) == 2
    assert differences(tree) == ["time.time() - (begun + time.time())"]
    assert differences(ast.parse("time.time_ns() - time.monotonic_ns()")) == []


def test_no_module_takes_a_clock_by_another_name() -> None:
    taken = [
        name
        for name, tree in product().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "time"
        if {"time", "time_ns"} & {each.name for each in node.names}
    ]
    assert taken == []


@pytest.mark.parametrize("step_ns", [HOUR_NS, -HOUR_NS], ids=["forwards", "back"])
def test_a_clock_that_is_set_by_an_hour_makes_no_live_rig_dead_and_no_silent_one_alive(
    step_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SteadyClock()
    rig = RigView("rig")
    heartbeat = {
        "version": 1, "session": "a", "sequence": 0, "sent_ns": time.time_ns(),
        "heartbeat_s": 0.5, "up_s": 1.0, "rows": 0, "sequences": {}, "commands": False,
    }  # fmt: skip
    rig.has_token = True
    rig.take("heartbeat", heartbeat, clock.now_ns())
    day, steady = time.time_ns(), time.monotonic_ns()
    monkeypatch.setattr(time, "time_ns", lambda: day + step_ns)
    assert rig.snapshot(clock.now_ns()).life == "live"
    monkeypatch.setattr(time, "monotonic_ns", lambda: steady + 60 * 10**9)
    snapshot = rig.snapshot(clock.now_ns())
    assert snapshot.life == "dead"
    assert snapshot.age_s == pytest.approx(60.0, abs=30.0)
