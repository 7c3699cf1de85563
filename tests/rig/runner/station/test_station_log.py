"""What a station keeps does not grow without end."""

import os
from pathlib import Path

from rig.runner.station.station_log import LOG, LONGEST, TRIP_REPORTS, StationLog, keep_newest


def test_the_log_is_begun_anew_and_the_one_before_is_kept(tmp_path: Path) -> None:
    log = StationLog(tmp_path, lambda line: None, longest=1000)
    for number in range(100):
        log.write("told", f"line {number}")
    sizes = [path.stat().st_size for path in tmp_path.iterdir()]
    assert len(sizes) == 2
    assert max(sizes) < 1200
    kept = "".join(path.read_text() for path in tmp_path.iterdir())
    assert "line 99" in kept
    assert "line 0" not in kept


def test_a_log_that_cannot_be_written_is_told_once_and_ends_nothing(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / LOG).mkdir()
    log = StationLog(tmp_path, said.append)
    log.write("told", "one")
    log.write("told", "two")
    assert [line for line in said if "cannot be written" in line] == said[1:2]
    assert "--out" not in said[1]
    assert said[0] == "one"
    assert said[2] == "two"


def test_the_newest_trip_reports_and_a_bounded_session_log_are_kept(tmp_path: Path) -> None:
    for number in range(TRIP_REPORTS + 3):
        for suffix in ("json", "txt", "csv"):
            path = tmp_path / f"trip-{number}.{suffix}"
            path.touch()
            os.utime(path, (number, number))
    (tmp_path / "session.log").write_bytes(bytes(LONGEST + 1))
    keep_newest(tmp_path, "session.log")
    left = {path.stem for path in tmp_path.glob("trip*")}
    assert left == {f"trip-{number}" for number in range(3, TRIP_REPORTS + 3)}
    assert not (tmp_path / "session.log").exists()
    assert (tmp_path / "session.log.1").exists()
