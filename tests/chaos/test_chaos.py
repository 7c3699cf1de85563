"""How the chaos suite judges, and a few of its scenarios; `make chaos` plays them all."""

import subprocess
import sys
from pathlib import Path
from typing import IO, Any

import pytest

from tests.waiting import until
from tools.chaos.__main__ import row, table, with_table
from tools.chaos.judge import Outcome, driven, problems, safe_at
from tools.chaos.play import play
from tools.chaos.scenario import Scenario, pause, wire
from tools.chaos.scenarios import BENIGN, SCENARIOS
from tools.chaos.stage import Stage, StageError

OUTLIVED = Scenario(
    "all that a run outlives, then an emergency stop",
    (*(step for scenario in BENIGN for step in (*scenario.steps, pause(0.4))), wire("estop")),
    ("ESTOP_OPEN",),
)
KILLS = [
    scenario for scenario in SCENARIOS if scenario.name in ("loop: kill -9", "supervisor: kill -9")
]
TRIPS = Scenario("estop", (), ("ESTOP_OPEN",))
AS_CLAIMED: dict[str, Any] = {
    "exit_code": 3,
    "cause": "ESTOP_OPEN",
    "valve_s": 0.001,
    "bypass_s": 0.5,
    "pump_s": 0.6,
    "lost_s": 0.0,
    "report": "",
    "printed": "",
    "unfinished": (),
}


@pytest.mark.long
@pytest.mark.parametrize(
    "scenario",
    [OUTLIVED, *KILLS],
    ids=lambda scenario: scenario.name,
)
def test_the_rig_is_safe_and_the_cause_named_after(scenario: Scenario, tmp_path: Path) -> None:
    outcome = play(scenario, tmp_path)
    assert not problems(scenario, outcome), f"{outcome.printed}\n{outcome.report}"


class Dying(Stage):
    """A stage whose emulator answers its first request, and ends amid the next one."""

    ANSWERS = """
import json, socket
with socket.create_server(("127.0.0.1", 0)) as server:
    print(json.dumps({"ports": {"control": server.getsockname()[1]}}), flush=True)
    with server.accept()[0] as line, line.makefile("rw") as file:
        file.readline()
        print(json.dumps({"ok": True}), file=file, flush=True)
        file.readline()
        print('{"ok": tr', end="", file=file, flush=True)
"""

    def _python(
        self, command: str, *arguments: str, output: int | IO[str]
    ) -> "subprocess.Popen[str]":
        return subprocess.Popen([sys.executable, "-c", self.ANSWERS], stdout=output, text=True)


def test_an_emulator_that_ends_amid_a_request_fails_its_scenario_alone(tmp_path: Path) -> None:
    with Dying(tmp_path) as stage:
        with pytest.raises(StageError, match=r"gave no answer to \{'do': 'status'\}"):
            stage.is_safe()
        until(lambda: not stage.emulator_lives, "the emulator to end")
        for _ in range(2):
            with pytest.raises(StageError, match=r"gave no answer to \{'do': 'inject'"):
                stage.inject(fault="lost_counts", counts=1)


def test_no_two_scenarios_have_the_same_name() -> None:
    names = [scenario.name for scenario in SCENARIOS]
    assert len(set(names)) == len(names) >= 25


def test_what_is_as_claimed_is_no_problem() -> None:
    assert not problems(TRIPS, Outcome(**AS_CLAIMED))


@pytest.mark.parametrize(
    ("otherwise", "problem"),
    [
        ({"exit_code": 0}, "exit code 0, not 3"),
        ({"cause": ""}, "cause none, not ESTOP_OPEN"),
        ({"bypass_s": None}, "bypass is not safe"),
        ({"bypass_s": 0.7}, "not in the order valve, bypass, pump"),
        ({"lost_s": 12.0}, "lost 12.0 s of data"),
        ({"lost_s": None}, "lost None s of data"),
        ({"printed": "Traceback (most recent call last)"}, "a traceback"),
        ({"unfinished": (".trip-1.json.partial",)}, ".trip-1.json.partial is left half written"),
    ],
)
def test_what_is_not_as_claimed_is_said(otherwise: dict[str, Any], problem: str) -> None:
    assert problems(TRIPS, Outcome(**AS_CLAIMED | otherwise)) == [problem]


def test_a_valve_that_is_enabled_again_is_not_safe() -> None:
    events = [
        {"at_ns": 3, "event": "valve_enabled"},
        {"at_ns": 2, "event": "valve_disabled"},
        {"at_ns": 1, "event": "pump_unloaded"},
    ]
    assert safe_at(events) == {"valve": None, "bypass": None, "pump": 1}


def test_devices_that_move_are_those_that_a_kill_leaves_to_others() -> None:
    events = [
        {"at_ns": 1, "event": "valve_disabled"},
        {"at_ns": 2, "event": "ball_ordered", "bypass": "internal_leakage", "opened": False},
        {"at_ns": 3, "event": "pump_loaded"},
    ]
    assert driven(events) == ["pump"]
    assert driven([*events, {"at_ns": 4, "event": "valve_enabled"}]) == ["valve", "pump"]


def test_bypasses_are_shut_when_the_last_ball_is_and_one_that_never_left_by_its_order() -> None:
    def ball(at_ns: int, event: str, bypass: str, opened: bool) -> dict[str, Any]:
        return {"at_ns": at_ns, "event": f"ball_{event}", "bypass": bypass, "opened": opened}

    events = [
        ball(1, "ordered", "internal_leakage", True),
        ball(2, "arrived", "internal_leakage", True),
        ball(3, "ordered", "supply_leakage", True),
        ball(5, "ordered", "internal_leakage", False),
        ball(6, "ordered", "supply_leakage", False),
    ]
    assert safe_at(events)["bypass"] is None
    assert safe_at([*events, ball(9, "arrived", "internal_leakage", False)])["bypass"] == 9


def test_a_line_of_the_table_has_the_claim_beside_what_came_of_it() -> None:
    scenario = Scenario("stop", (), ("ESTOP_OPEN",), null_ms=20)
    line = "| stop | `ESTOP_OPEN` | 1 ms (20) | 500 ms | 600 ms | 0.0 s | 3 |"
    assert row(scenario, Outcome(**AS_CLAIMED)) == line


def test_a_page_gets_the_table_and_keeps_the_rest() -> None:
    page = "before\n<!-- table of chaos -->\n| old |\n<!-- end -->\nafter"
    expected = "before\n<!-- table of chaos -->\n| new |\n<!-- end -->\nafter"
    assert with_table(page, ["| new |"]) == expected
    assert len(list(table([(TRIPS, Outcome(**AS_CLAIMED))]))) == 3
