import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.io.limits import ChannelLimit
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.loop.interlocks.passings import RungPassed
from rig.recording.reading import read_recording
from rig.supervisor.processes.child import News
from rig.supervisor.processes.driven import Driven
from rig.supervisor.processes.health import trips_of
from rig.supervisor.trip_report import TripReport, kept_trip_report, write_trip_report

MS = 1_000_000
AT = 10_000 * MS
CHANNELS = ("time_s", "pressure_1_Pa", "valve_enabled", "wakeup_s", "exchange_s", "action")


def rows() -> np.ndarray:
    """Return two seconds in which chamber 1 rises to 20.5 MPa and trips, then falls."""
    table = np.zeros((2000, len(CHANNELS)))
    table[:, 0] = np.arange(2000) * 1e-3
    table[:, 1] = 1e7
    table[1990, 1] = 20.5e6
    table[1991:, 1] = np.nan
    table[:, 2] = 1.0
    table[:, 3], table[:, 4] = 20e-6, 80e-6
    table[1990:, 5] = 4.0
    return table


REPORT = TripReport(
    trips={
        "loop": (Cause.LIMIT_HIGH, AT),
        "field": (Cause.BYPASS_STUCK, AT + 12 * MS),
        "supervisor": (Cause.LOOP_LOST, AT + 200 * MS),
    },
    confirmations={
        "valve null": AT + 3 * MS,
        "bypass shut": AT + 412 * MS,
        "pump unloaded": 0,
    },
    notes=(News(AT - 1200 * MS, "campaign", "run test healthy"), News(AT, "loop", "trip")),
    channels=CHANNELS,
    rows=rows(),
    channel="pressure_1_Pa",
    limits=(
        ChannelLimit("pressure_1_Pa", high=1.9e7, action="hold"),
        ChannelLimit("pressure_1_Pa", high=2.0e7),
        ChannelLimit("pressure_2_Pa", high=1.0e7),
    ),
)


def test_the_earliest_trip_is_the_cause_whoever_reported_it() -> None:
    board = Board.create(1)
    words = board.words
    words[Word.SUPERVISOR_TRIP], words[Word.SUPERVISOR_TRIP_AT] = Cause.LOOP_LOST, AT + 200 * MS
    words[Word.LOOP_TRIP], words[Word.LOOP_TRIP_AT] = Cause.LIMIT_HIGH, AT
    report = replace(REPORT, trips=trips_of(board))
    assert report.first == ("loop", Cause.LIMIT_HIGH, AT)
    words[Word.FIELD_TRIP], words[Word.FIELD_TRIP_AT] = Cause.PUMP_FAULT, AT - MS
    assert replace(REPORT, trips=trips_of(board)).first == ("field", Cause.PUMP_FAULT, AT - MS)
    os.close(board.fd)


def test_the_cause_is_reported_in_words_with_value_and_limit() -> None:
    assert REPORT.sentence == "pressure_1_Pa is above its limit: 20.5 MPa, limit 20 MPa"


def test_a_cause_of_another_process_does_not_borrow_the_loops_channel() -> None:
    report = replace(REPORT, trips={"field": (Cause.PUMP_FAULT, AT)})
    assert report.sentence == "the pump unit reports a fault"
    assert report.document()["channel"] is None


def test_a_switch_is_named_without_a_value() -> None:
    trips = {"loop": (Cause.ESTOP_OPEN, AT)}
    report = replace(REPORT, trips=trips, channel="estop_closed")
    assert report.sentence == "the emergency stop is open"


def test_what_another_master_drove_is_reported_with_how_often_and_when() -> None:
    found = Driven(
        AT + 900 * MS, "loop", "enabled, output at 5.00 V", "valve", 12, AT + 120 * MS,
        AT + 870 * MS,
    )  # fmt: skip
    report = replace(REPORT, driven=(found,))
    (line,) = [line for line in report.lines() if "another master" in line]
    assert line == (
        "  valve driven by another master: enabled, output at 5.00 V, 12 times, "
        "+120 ms to +870 ms; its safe state was commanded each time"
    )
    (told,) = report.document()["driven_by_another_master"]
    assert told == {
        "part": "valve",
        "what": "enabled, output at 5.00 V",
        "times": 12,
        "first_after_s": pytest.approx(0.12),
        "last_after_s": pytest.approx(0.87),
        "brought_back_by": "loop",
    }
    assert REPORT.document()["driven_by_another_master"] == []


def test_a_report_that_was_written_before_is_written_anew_under_its_number(tmp_path: Path) -> None:
    path = write_trip_report(REPORT, tmp_path)
    assert write_trip_report(replace(REPORT, notes=()), tmp_path, path) == path
    assert json.loads(path.read_text())["notes"] == []
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "trip-1.csv", "trip-1.json", "trip-1.txt"
    ]  # fmt: skip


def test_each_step_is_confirmed_with_its_time_or_reported_with_what_to_do() -> None:
    text = "\n".join(REPORT.lines())
    assert "valve null confirmed +3 ms" in text
    assert "bypass shut confirmed +412 ms" in text
    assert "pump unloaded NOT CONFIRMED: switch the pump off by hand" in text


def test_no_remedy_is_given_for_what_the_supervisor_made_safe_itself() -> None:
    report = replace(REPORT, made_safe={"bypass shut": AT + MS, "pump unloaded": AT + 612 * MS})
    lines = [line.strip() for line in report.lines()]
    assert (
        "pump unloaded NOT CONFIRMED to the field process, but to the supervisor +612 ms" in lines
    )
    # What its own process got confirmed counts.
    assert "bypass shut confirmed +412 ms" in lines
    told = report.document()["confirmations"]
    assert [step["to_supervisor_after_s"] for step in told] == [None, 0.001, pytest.approx(0.612)]


def test_the_text_says_who_asked_what_and_what_followed() -> None:
    lines = REPORT.lines()
    assert lines[0].startswith("tripped by the loop: pressure_1_Pa")
    assert "  -1200 ms campaign: run test healthy" in lines
    follow = [line for line in lines if line.startswith("  then")]
    assert [line.split()[2] for line in follow] == ["field", "supervisor"]
    assert "  exchange: p50 80 us, p99 80 us, max 80 us" in lines


def test_the_report_is_written_with_the_last_rows_beside_it(tmp_path: Path) -> None:
    path = write_trip_report(REPORT, tmp_path)
    document = json.loads(path.read_text())
    assert path.name == "trip-1.json"
    assert (document["cause"], document["by"]) == ("LIMIT_HIGH", "loop")
    assert (document["value"], document["limit"]) == (20.5e6, 2.0e7)
    assert [step["after_s"] for step in document["confirmations"]] == [
        pytest.approx(0.003),
        pytest.approx(0.412),
        None,
    ]
    assert (tmp_path / "trip-1.txt").read_text().startswith("tripped by the loop")
    recording = read_recording(tmp_path / "trip-1.csv", required=("time_s",))
    np.testing.assert_array_equal(recording["pressure_1_Pa"], REPORT.rows[:, 1])


def test_a_second_trip_does_not_replace_the_first(tmp_path: Path) -> None:
    write_trip_report(REPORT, tmp_path)
    assert write_trip_report(REPORT, tmp_path).name == "trip-2.json"
    assert (tmp_path / "trip-1.json").exists()


def test_nothing_half_written_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def disk_full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rig.supervisor.trip_report.os.replace", disk_full)
    with pytest.raises(OSError, match="No space"):
        write_trip_report(REPORT, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_trip_before_the_first_row_is_reported_too(tmp_path: Path) -> None:
    report = replace(REPORT, rows=np.empty((0, len(CHANNELS))))
    document = json.loads(write_trip_report(report, tmp_path).read_text())
    assert document["value"] is None
    assert not (tmp_path / "trip-1.csv").exists()


def test_limits_of_the_test_stand_beside_those_of_the_rig_with_what_was_passed() -> None:
    own = ChannelLimit("following_error_m", high=5e-3, action="ramp_down", for_s=0.2)
    passed = (RungPassed(4, 900, 3, 6e-3), RungPassed(4, 1990, 1, 2.05e7))
    report = replace(REPORT, limits=(*REPORT.limits, own), of_test=1, passed=passed)
    limits = report.document()["limits"]
    assert [each["of"] for each in limits] == ["rig", "rig", "rig", "test"]
    assert [each["passed"] is None for each in limits] == [True, False, True, False]
    assert limits[3]["passed"] == {"value": 6e-3, "at_s": 0.9, "since_s": pytest.approx(0.7)}
    lines = "\n".join(report.lines())
    told = "limit of the test: following_error_m 6 mm above 5 mm at 0.900 s, since 0.700 s"
    assert f"{told}: ramp_down" in lines
    assert "limit of the rig: pressure_1_Pa 20.5 MPa above 20 MPa at 1.990 s" in lines


def test_a_report_that_cannot_be_written_is_told_as_one_text_and_floods_no_list(
    tmp_path: Path,
) -> None:
    said: list[str] = []
    report = REPORT
    written: list[str] = []
    gone = tmp_path / "gone"
    assert kept_trip_report(report, gone, said.append, journal=written.append) is None
    assert said[0].startswith("the trip report cannot be written")
    assert said[1:] == ["\n".join(report.lines())]
    assert written == [f"{said[0]}; its cause: {report.sentence}"]


def test_no_error_of_a_report_keeps_what_follows_a_trip_from_being_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def short(*_: object) -> Path:
        raise MemoryError("no more")

    monkeypatch.setattr("rig.supervisor.trip_report.write_trip_report", short)
    said: list[str] = []
    assert kept_trip_report(REPORT, tmp_path, said.append) is None
    assert "MemoryError: no more" in said[0]
