import json
from pathlib import Path
from typing import Any

from rig.emulator.record import Record


def test_every_event_is_in_the_file_before_the_next_thing_happens(
    tmp_path: Path, clock: Any
) -> None:
    path = tmp_path / "record.jsonl"
    record = Record(path, clock=clock)
    record.note("valve_enabled", command_V=1.5)
    record.note("watchdog_trip", at_ns=7)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    record.close()
    assert lines == [
        {"at_ns": clock(), "event": "valve_enabled", "command_V": 1.5},
        {"at_ns": 7, "event": "watchdog_trip"},
    ]


def test_a_record_goes_on_where_an_earlier_one_ended(tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    for event in ("first", "second"):
        record = Record(path)
        record.note(event)
        record.close()
    assert [json.loads(line)["event"] for line in path.read_text().splitlines()] == [
        "first",
        "second",
    ]


def test_the_trace_holds_every_command_and_what_became_of_it(tmp_path: Path, clock: Any) -> None:
    path = tmp_path / "trace.csv"
    record = Record(trace=path, clock=clock)
    record.command(5, 2.5, 0.0, False)
    record.command(6, 2.5, 2.5, True)
    record.flush()
    text = path.read_text()
    record.close()
    record.close()
    assert text == "time_ns,command_V,output_V,valve_enabled\n5,2.5,0,0\n6,2.5,2.5,1\n"
