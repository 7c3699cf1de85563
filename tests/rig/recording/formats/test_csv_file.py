"""CSV as programs and people write it: read where it is clear, refused with its line where not."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.recording import Recording, RecordingProblem, read_recording

Judge = Callable[..., list[RecordingProblem]]


def only(problems: list[RecordingProblem]) -> RecordingProblem:
    assert len(problems) == 1, [str(problem) for problem in problems]
    return problems[0]


@pytest.mark.parametrize(
    "rewrite",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace(",", " , "),
        lambda text: text + "\n\n",
        lambda text: text.replace("time_s", '"time_s"'),
        lambda text: text.replace("\n0.0,", "\n+0.0,", 1),
        lambda text: text.replace("\n", "\n\n", 3),
        lambda text: text.rstrip("\n"),
    ],
    ids=["CRLF", "BOM", "spaces", "blank end", "quotes", "plus sign", "blank lines", "no newline"],
)
def test_harmless_habits_of_other_programs_change_nothing(
    tmp_path: Path,
    healthy: Recording,
    healthy_csv: list[str],
    rewrite: Callable[[str], str],
) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(rewrite("\n".join(healthy_csv) + "\n").encode())
    assert read_recording(path).content_hash() == healthy.content_hash()


def test_an_empty_cell_of_an_optional_column_is_a_missing_sample(
    tmp_path: Path, healthy_csv: list[str]
) -> None:
    path = tmp_path / "run.csv"
    lines = healthy_csv.copy()
    lines[9] = lines[9].rpartition(",")[0] + ","
    path.write_text("\n".join(lines))
    spool_m = read_recording(path)["spool_m"]
    assert np.flatnonzero(np.isnan(spool_m)).tolist() == [8]


def test_time_comes_first_whatever_the_order_of_columns(
    tmp_path: Path, healthy: Recording, healthy_csv: list[str]
) -> None:
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(reversed(line.split(","))) for line in healthy_csv))
    recording = read_recording(path)
    assert list(recording.channels)[:2] == ["time_s", "spool_m"]
    assert recording.content_hash() == healthy.content_hash()


def test_channels_are_contiguous_and_writable_as_compiled_filters_want_them(
    tmp_path: Path, healthy_csv: list[str]
) -> None:
    path = tmp_path / "run.csv.gz"
    path.write_bytes(gzip.compress("\n".join(healthy_csv).encode()))
    flags = [values.flags for values in read_recording(path).channels.values()]
    assert all(flag.c_contiguous and flag.writeable for flag in flags)


@pytest.mark.parametrize("cell", ["stuck", "1.2.3", "1_000", "0x10", "--", "NA", "\u22121"])
def test_a_cell_that_is_no_number_is_refused_with_its_line_and_text(
    judge: Judge, healthy_csv: list[str], cell: str
) -> None:
    cells = healthy_csv[49].split(",")
    lines = [*healthy_csv[:49], ",".join([*cells[:2], cell, *cells[3:]]), *healthy_csv[50:]]
    problem = only(judge("\n".join(lines)))
    assert (problem.line, problem.field) == (50, "position_m")
    assert problem.value == f"{cell!r} is not a number"


def test_a_column_of_text_is_one_problem(judge: Judge, healthy_csv: list[str]) -> None:
    lines = [healthy_csv[0] + ",state", *(line + ",running" for line in healthy_csv[1:])]
    problem = only(judge("\n".join(lines)))
    assert (problem.line, problem.field) == (2, "state")
    assert "delete the column" in problem.remedy


def test_a_row_with_cells_missing_is_reported_once(judge: Judge, healthy_csv: list[str]) -> None:
    lines = [*healthy_csv[:49], healthy_csv[49].rpartition(",")[0], *healthy_csv[50:]]
    problem = only(judge("\n".join(lines)))
    assert (problem.line, problem.value) == (50, "5 cells")
    assert problem.limit == "the header has 6"


def test_a_file_cut_off_in_its_last_line_says_so(judge: Judge, healthy_csv: list[str]) -> None:
    problem = only(judge("\n".join(healthy_csv)[:-60]))
    assert problem.line == len(healthy_csv)
    assert "cut off" in problem.remedy


@pytest.mark.parametrize(
    ("delimiter", "called"), [(";", "semicolons"), ("\t", "tabs"), ("|", "bars"), (" ", "spaces")]
)
def test_another_delimiter_is_recognised(
    judge: Judge, healthy_csv: list[str], delimiter: str, called: str
) -> None:
    problem = only(judge("\n".join(healthy_csv).replace(",", delimiter)))
    assert (problem.line, problem.value) == (1, f"separated by {called}")
    assert "comma" in problem.remedy


def test_a_column_named_twice_is_refused(judge: Judge, healthy_csv: list[str]) -> None:
    lines = [healthy_csv[0].replace("spool_m", "position_m"), *healthy_csv[1:]]
    problem = only(judge("\n".join(lines)))
    assert (problem.line, problem.field) == (1, "position_m")
    assert problem.value == "columns 3 and 6 have this name"


def test_a_column_without_a_name_is_refused(judge: Judge, healthy_csv: list[str]) -> None:
    lines = ["," + healthy_csv[0], *(f"{k},{line}" for k, line in enumerate(healthy_csv[1:]))]
    problem = only(judge("\n".join(lines)))
    assert (problem.line, problem.field, problem.value) == (1, "column 1", "has no name")


def test_numbers_without_a_header_are_refused(judge: Judge, healthy_csv: list[str]) -> None:
    problem = only(judge("\n".join(healthy_csv[1:])))
    assert (problem.line, problem.value) == (1, "has numbers only")


@pytest.mark.parametrize("name", ["run.csv", "run.csv.gz", "run.mcap", "run.parquet"])
def test_an_empty_file_is_called_empty(judge: Judge, name: str) -> None:
    assert only(judge(b"", name)).value.startswith(("empty", "cannot be read as Parquet"))


def test_bytes_that_are_no_text_are_refused(judge: Judge) -> None:
    assert only(judge(b"\xff\xfet\x00i\x00m\x00e\x00")).value == "not text"


def test_a_gzip_file_cut_short_or_damaged_is_refused_with_how_to_salvage_it(
    judge: Judge, healthy_csv: list[str]
) -> None:
    packed = gzip.compress("\n".join(healthy_csv).encode())
    cut = only(judge(packed[:-1000], "run.csv.gz"))
    assert cut.value == "gzip data is cut off"
    damaged = only(judge(packed[:5000] + b"\0" * 50 + packed[5050:], "run.csv.gz"))
    assert damaged.value.startswith("gzip data is corrupt")
    assert "zcat" in cut.remedy


def test_compression_must_be_as_the_extension_says(judge: Judge, healthy_csv: list[str]) -> None:
    text = "\n".join(healthy_csv).encode()
    plain = only(judge(text, "run.csv.gz"))
    assert plain.value == "not gzip-compressed"
    assert plain.remedy.endswith("run.csv")
    packed = only(judge(gzip.compress(text), "run.csv"))
    assert packed.value == "gzip-compressed"
    assert packed.remedy.endswith("run.csv.gz")
