"""The grammar of chaos and its verdicts, without a process; `make test-long` plays a few cases."""

import json
import socket
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tools.chaos.drawn import bounds, strikes
from tools.chaos.drawn.__main__ import RESULTS, played, read_results, summary
from tools.chaos.drawn.bounds import Bound
from tools.chaos.drawn.fault import Fault, Strike, Struck, null_deadlines
from tools.chaos.drawn.grammar import FIRST_S, GROUPS, LATER_S, causes_of, draw
from tools.chaos.drawn.pauses import paused_ns
from tools.chaos.drawn.play import Evidence, strike as struck_at
from tools.chaos.drawn.verdict import enabled_spans, violations
from tools.chaos.judge import cause_of
from tools.chaos.scenarios import SCENARIOS

MS = 1_000_000
ESTOP = Fault("estop", (), ("ESTOP_OPEN",), 20.0, frozenset({3}))
KILLED = Fault(
    "supervisor: kill -9", (), ("SUPERVISOR_LOST",), 150.0, frozenset({-9}),
    needs=frozenset({"loop", "daq"}), takes=frozenset({"supervisor"}), keeps_results=False,
)  # fmt: skip
LOOP = Fault("loop: SIGSTOP", (), ("LOOP_LOST",), 350.0, frozenset({3}), takes=frozenset({"loop"}))
NOISE = Fault("meters: noise", ())


def event(at_ms: float, name: str, **more: Any) -> dict[str, Any]:
    return {"at_ns": round(at_ms * MS), "event": name, **more}


def struck(fault: Fault, at_ms: float) -> Struck:
    return Struck(fault, round(at_ms * MS), round(at_ms * MS))


def events(null: float, shut: float, unloaded: float) -> tuple[dict[str, Any], ...]:
    """A session whose devices become safe at these times, ms."""
    ball = {"bypass": "internal_leakage"}
    return (
        event(0, "pump_loaded"),
        event(1, "valve_enabled"),
        event(2, "ball_ordered", opened=True, **ball),
        event(3, "ball_arrived", opened=True, **ball),
        event(null, "valve_disabled"),
        event(shut - 1, "ball_ordered", opened=False, **ball),
        event(shut, "ball_arrived", opened=False, **ball),
        event(unloaded, "pump_unloaded"),
    )


def results(status: str, exit_code: int) -> dict[str, Any]:
    return {"exit_code": exit_code, "tests": [{"status": status, "message": ""}]}


def evidence(*faults: Struck, **otherwise: Any) -> Evidence:
    """What an emergency stop at 1000 ms leaves behind, unless told otherwise."""
    usual: dict[str, Any] = {
        "events": events(1001, 1500, 1600),
        "exit_code": 3,
        "cause": "ESTOP_OPEN",
        "results": results("tripped", 3),
        "confirmed": frozenset({"valve", "bypass", "pump"}),
        "trip_reports": 1,
    }
    return Evidence(faults or (struck(ESTOP, 1000),), **(usual | otherwise))


# -- drawing ---------------------------------------------------------------------------------------


def test_a_case_depends_on_seed_and_number_alone() -> None:
    assert [draw(7, number).name for number in range(20)] == [
        draw(7, number).name for number in range(20)
    ]
    assert len({draw(seed, number).name for seed in (1, 2) for number in range(40)}) == 80


def test_cases_strike_twice_within_the_test_with_faults_of_every_group() -> None:
    names: Counter[str] = Counter()
    for number in range(400):
        first, second = draw(3, number).strikes
        assert FIRST_S[0] <= first.at_s <= second.at_s <= FIRST_S[1] + LATER_S
        names.update((first.fault.name, second.fault.name))
    for part in ("loop", "field", "recorder", "supervisor", "publisher", "emulator"):
        assert any(name.startswith(part) for name in names), part
    assert len(names) > 100
    assert len(GROUPS) >= 15


def test_every_fault_that_ends_the_motion_has_a_time_a_cause_and_an_exit_code() -> None:
    for number in range(400):
        for strike in draw(5, number).strikes:
            fault = strike.fault
            assert (fault.null_ms is None) == bool(fault.exits & {0, 1})
            if fault.null_ms is not None:
                assert fault.causes


def test_times_of_single_faults_are_those_that_the_scenarios_claim() -> None:
    claimed = {scenario.name: scenario.null_ms for scenario in SCENARIOS if scenario.causes}
    claimed["encoder: frozen"] = (claimed["encoder: frozen"] or 0.0) + bounds.TURNING.ms
    shared = 0
    for number in range(200):
        for strike in draw(9, number).strikes:
            if strike.fault.name in claimed:
                shared += 1
                assert strike.fault.null_ms == claimed[strike.fault.name]
    assert shared > 100


def test_every_bound_says_what_it_consists_of_and_stands_in_the_table() -> None:
    known = [value for value in vars(bounds).values() if isinstance(value, Bound)]
    assert sorted(bounds.TABLE.values()) == sorted(known)
    assert all(each.ms > 0.0 and each.why for each in known)


# -- promises --------------------------------------------------------------------------------------


def test_a_promise_falls_when_the_other_fault_takes_what_it_needs_and_that_one_s_holds() -> None:
    found = dict(null_deadlines([struck(KILLED, 100), struck(LOOP, 120)]))
    assert found == {"loop: SIGSTOP": 470 * MS}
    later = dict(null_deadlines([struck(KILLED, 100), struck(LOOP, 300)]))
    assert later == {"loop: SIGSTOP": 650 * MS, "supervisor: kill -9": 250 * MS}


def test_a_promise_counts_from_when_the_way_to_the_node_is_there_again() -> None:
    node = Fault("null", (), ("COMMAND_ECHO",), 20.0, frozenset({3}), needs=frozenset({"daq"}))
    brief = Fault("daq: exception for 185 ms", (), takes=frozenset({"daq"}), lasts_ms=185.0)
    found = dict(null_deadlines([struck(brief, 100), struck(node, 104)]))
    assert found == {"null": (100 + 185 + 20) * MS}
    over = dict(null_deadlines([struck(brief, 100), struck(node, 400)]))
    assert over == {"null": 420 * MS}


@pytest.mark.parametrize(
    ("answer", "is_struck"),
    [
        (bytes.fromhex("0001 0000 0003 01 90 04"), False),
        (b"", False),
        (bytes.fromhex("0001 0000 0006 01 10 0300 0001"), True),
        (bytes.fromhex("0001 0000 0003 01 90 06"), True),
        (bytes.fromhex("5554 0000 0006 01 10 0300 0001"), True),
    ],
    ids=["refused unread", "closed", "taken", "refused for its owner", "of another transaction"],
)
def test_a_request_that_the_other_fault_keeps_from_the_node_was_not_struck(
    answer: bytes, is_struck: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = socket.socketpair()
    theirs.sendall(answer)
    theirs.shutdown(socket.SHUT_WR)
    monkeypatch.setattr(strikes, "_connection", lambda stage: ours)
    stage: Any = SimpleNamespace(run=SimpleNamespace(poll=lambda: None), injected_ns=0)
    found = struck_at(stage, Strike(0.0, Fault("null", (strikes.null_request,))), 0.0)
    theirs.close()
    assert (found is not None) is is_struck


@pytest.mark.parametrize(
    ("printed", "cause"),
    [
        (
            "tripped by the loop: pressure_1_Pa repeats the same value where noise must show",
            "SENSOR_FROZEN",
        ),
        ("tripped: a channel is above its limit", "LIMIT_HIGH"),
        ("tripped by the supervisor: the recorder gives no sign of life", "RECORDER_LOST"),
        ("pressure_1_Pa repeats the same value where noise must show", ""),
    ],
)
def test_a_cause_is_read_from_the_terminal_where_nothing_else_could_be_written(
    printed: str, cause: str, tmp_path: Path
) -> None:
    assert cause_of(tmp_path, None, printed) == cause


def test_a_fault_that_a_run_outlives_promises_nothing() -> None:
    assert dict(null_deadlines([struck(NOISE, 5)])) == {}


def test_what_two_wrong_transducers_lead_to_may_be_a_cause_of_both_together() -> None:
    wrong = Fault("wrong", (), ("SENSOR_FROZEN",), 100.0, frozenset({3}), is_sensor=True)
    assert causes_of((wrong, NOISE)) == {"SENSOR_FROZEN"}
    assert "PRESSURES_CROSSED" in causes_of((wrong, wrong))


# -- verdicts --------------------------------------------------------------------------------------


def test_what_is_as_promised_is_no_violation() -> None:
    assert violations(evidence()) == []


@pytest.mark.parametrize(
    ("otherwise", "message"),
    [
        (
            {"events": events(1021, 1500, 1600)},
            "the valve is not at null in time after estop: 1 ms",
        ),
        ({"events": events(1001, 2502, 2600)}, "the bypass is safe 1 ms too late"),
        ({"events": events(1001, 1500, 3002)}, "the pump is safe 1 ms too late"),
        ({"events": events(1001, 1500, 1600)[:-1]}, "the pump is not safe"),
        ({"exit_code": 0}, "exit code 0, not 3"),
        ({"cause": "LOOP_LOST"}, "it tells of LOOP_LOST, not of ESTOP_OPEN"),
        ({"cause": ""}, "it tells of nothing, not of ESTOP_OPEN"),
        ({"printed": "Traceback (most recent call last)"}, "a traceback"),
        ({"results": None}, "there are no results"),
        ({"results": results("tripped", 0)}, "results.json tells exit code 0"),
        ({"results": results("passed", 3)}, "the test is called passed"),
        ({"journal_problem": "cut"}, "the journal cannot be read: cut"),
        ({"unfinished": (".x.partial",)}, "left half written: .x.partial"),
        ({"lost_s": 2.0}, "the last 2.0 s before the first fault are lost"),
        ({"lost_s": None}, "nothing of the recording can be read"),
        ({"alive": ("field",)}, "still alive: field"),
        ({"exit_code": None}, "the run did not end"),
    ],
)
def test_what_is_not_as_promised_is_said(otherwise: dict[str, Any], message: str) -> None:
    assert any(found.startswith(message) for found in violations(evidence(**otherwise)))


def test_a_valve_that_is_enabled_again_later_is_no_valve_at_null() -> None:
    again = (*events(1001, 1500, 1600), event(4000, "valve_enabled"))
    found = violations(evidence(events=again))
    assert "the valve is not at null in time after estop: for ever too late" in found
    assert "the trip report calls the valve confirmed safe, and it is not" in found
    spans = enabled_spans(again)
    assert spans == [(1 * MS, 1001 * MS), (4000 * MS, None)]


def test_a_pause_of_the_host_is_not_the_rig_s_and_only_its_length_is_allowed() -> None:
    paused = [(1010 * MS, 1050 * MS)]
    assert paused_ns(paused, 1000 * MS, 1020 * MS) == 10 * MS
    late = violations(evidence(events=events(1070, 1500, 1600), pauses=paused))
    assert late == ["the valve is not at null in time after estop: 50 ms too late"]
    assert violations(evidence(events=events(1055, 1500, 1600), pauses=paused)) == []


def test_a_cause_that_comes_after_the_null_cannot_be_the_first_out() -> None:
    late = struck(KILLED, 3000)
    found = violations(
        evidence(struck(ESTOP, 1000), late, cause="SUPERVISOR_LOST", exit_code=-9, results=None)
    )
    assert found == ["it tells of SUPERVISOR_LOST, not of  or ESTOP_OPEN"]


def test_a_run_that_ends_well_tells_of_no_trip() -> None:
    calm = {"exit_code": 0, "results": results("passed", 0), "confirmed": frozenset()}
    assert violations(evidence(struck(NOISE, 1000), cause="", trip_reports=0, **calm)) == []
    found = violations(evidence(struck(NOISE, 1000), **calm))
    assert found == ["the run ended as if all was well, and tells of ESTOP_OPEN"]


# -- going on --------------------------------------------------------------------------------------


def test_a_line_that_a_kill_cut_off_is_played_again(tmp_path: Path) -> None:
    path = tmp_path / "seed-1.jsonl"
    row = {"number": 1, "name": "a", "violations": [], "cause": "ESTOP_OPEN", "null_ms": 3.0}
    path.write_text(json.dumps(row) + "\n" + json.dumps(row | {"number": 2})[:-5])
    assert list(read_results(path)) == [1]
    assert read_results(tmp_path / "none") == {}
    assert RESULTS.parts[0] == "runs"
    head, body = summary([row, {"number": 3, "name": "b", "violations": ["late"]}])
    assert len(head) == 4
    assert body == [
        ("`ESTOP_OPEN`", "1", "1", "3"),
        ("ran on, or nobody is left to tell", "1", "0", ""),
    ]


@pytest.mark.long
@pytest.mark.parametrize("number", [1, 2, 4])
def test_a_drawn_case_holds(number: int) -> None:
    row = played(draw(20, number))
    assert not row["violations"], row
