"""A small compressed setpoint file cannot fill the memory, and damage to it is told."""

import gzip
from pathlib import Path

import pytest

from control.setpoints import lines
from control.setpoints.lines import SetpointFileError


def refusal(path: Path) -> str:
    with pytest.raises(SetpointFileError) as caught:
        lines._read_file(path, "position")
    return str(caught.value)


def test_a_line_without_end_is_read_no_further_than_a_megabyte(tmp_path: Path) -> None:
    path = tmp_path / "zeros.csv.gz"
    path.write_bytes(gzip.compress(bytes(8 << 20)))
    assert "a line is longer than 1048576 characters" in refusal(path)


def test_rows_without_end_are_read_no_further_than_a_motion_may_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lines, "MOST_ROWS", 100)
    path = tmp_path / "rows.csv"
    path.write_text("time_s,position_m\n" + "".join(f"{k},0.1\n" for k in range(200)))
    assert "rows.csv:102" in refusal(path)
    assert "more than 100" in refusal(path)


def test_wrong_rows_without_end_are_counted_no_further_than_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lines, "_MOST_FOUND", 50)
    path = tmp_path / "rows.csv"
    path.write_text("time_s,position_m\n" + "0,x\n" * 200)
    assert "more than 3" in refusal(path)


def test_compressed_data_that_are_damaged_are_told(tmp_path: Path) -> None:
    path = tmp_path / "damaged.csv.gz"
    content = bytearray(gzip.compress(b"time_s,position_m\n0,0.1\n1,0.2\n"))
    for place in range(10, len(content)):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        assert "damaged.csv.gz" in refusal(path)
