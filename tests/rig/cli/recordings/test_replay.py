import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.leaks.detection import Decision
from rig.cli.recordings.replay import Replayed, advice, json_object, row_of
from rig.recording import Recording, export, read_recording

Invoke = Callable[..., Any]

KEYS = {
    "recording",
    "verdict",
    "onset_s",
    "detected_at_s",
    "leak_L_per_min",
    "leak_std_L_per_min",
    "leak_coefficient",
}
NULL_WHEN_HEALTHY = KEYS - {"recording", "verdict"}


@pytest.fixture
def recordings(short_run: Path, tmp_path: Path) -> Path:
    """The folder with the recordings and results of the short campaign, `run` from here."""
    (tmp_path / "run").symlink_to(short_run)
    return tmp_path / "run"


def altered(recording: Recording, path: Path, **columns: np.ndarray[Any, Any] | None) -> Path:
    """Write the columns that replay reads to CSV, some replaced, or left out if None."""
    names = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
    table = {name: columns.get(name, recording[name]) for name in names}
    kept = {name: values for name, values in table.items() if values is not None}
    text = np.column_stack(list(kept.values()))
    np.savetxt(path, text, delimiter=",", header=",".join(kept), comments="")
    return path


def test_json_is_an_object_a_line_with_the_promised_keys(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    done = invoke("replay", "--json", "run/healthy.mcap", "run/leak_low.mcap")
    assert done.code == 0
    assert done.err == ""
    healthy, leak = (json.loads(line) for line in done.out.splitlines())
    assert set(healthy) >= KEYS
    assert healthy["recording"] == "run/healthy.mcap"
    assert healthy["verdict"] == "healthy"
    assert {healthy[key] for key in NULL_WHEN_HEALTHY} == {None}
    assert leak["verdict"] == "external_leakage_1"
    assert leak["onset_s"] == pytest.approx(8.0, abs=0.5)
    assert leak["detected_at_s"] > leak["onset_s"]
    assert leak["leak_coefficient"] == pytest.approx(0.8 / 6e4 / 6.9e6**0.5, rel=0.05)


def test_a_replay_finds_what_the_run_found(invoke: Invoke, recordings: Path) -> None:
    done = invoke("replay", "--json", recordings / "leak_low.mcap")
    found = json.loads((recordings / "results.json").read_text())["tests"][1]["found"]
    replayed = json.loads(done.out)
    assert {key: replayed[key] for key in KEYS - {"recording"}} == {
        key: found[key] for key in KEYS - {"recording"}
    }


def test_csv_and_mcap_of_a_recording_give_the_same_verdict_to_the_last_bit(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    mcap = recordings / "leak_low.mcap"
    export(read_recording(mcap), tmp_path / "leak.csv.gz")
    lines = invoke("replay", "--json", mcap, tmp_path / "leak.csv.gz").out.splitlines()
    first, second = ({**json.loads(line), "recording": ""} for line in lines)
    assert first == second


def test_the_table_has_a_row_a_recording(invoke: Invoke, recordings: Path) -> None:
    done = invoke("replay", "run/healthy.mcap", "run/leak_low.mcap")
    assert done.code == 0
    (row,) = [line for line in done.out.splitlines() if "leak_low" in line]
    assert "external_leakage_1" in row
    assert "± " in row
    assert "/" in row


def test_a_filter_that_was_lost_is_reported() -> None:
    lost = Replayed("one.mcap", "product", Decision("healthy"), None, (1.5, 12.0))
    assert str(row_of(lost)[1]) == "healthy; filter lost at 1.50 s, 2 times"
    assert json_object(lost)["filter_resets_s"] == [1.5, 12.0]


@pytest.mark.parametrize("name", ["thesis-6", "thesis-7"])
def test_the_thesis_s_filters_replay_too(invoke: Invoke, recordings: Path, name: str) -> None:
    done = invoke("replay", "--json", "--filter", name, recordings / "leak_low.mcap")
    assert done.code == 0
    assert json.loads(done.out)["filter"] == name


def test_an_inconclusive_recording_says_what_would_help(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    whole = read_recording(recordings / "healthy.mcap")
    short = {name: values[:1500] for name, values in whole.channels.items()}
    export(Recording(short), tmp_path / "short.csv")
    done = invoke("replay", tmp_path / "short.csv")
    assert done.code == 0
    assert "inconclusive: record for longer" in done.out


@pytest.mark.parametrize(
    ("details", "reported"),
    [
        ({}, "record for longer"),
        ({"travel_m": 1e-3, "travel_needed_m": 3e-3}, "move the ram by more than 3 mm"),
        (
            {
                "travel_m": 0.1,
                "travel_needed_m": 3e-3,
                "smallest_internal_leakage_m3_per_s": 1.2 / 6e4,
                "smallest_external_leakage_1_m3_per_s": 0.1 / 6e4,
            },
            "internal_leakage up to 1.2 L/min would not have shown",
        ),
    ],
)
def test_the_advice_follows_what_was_lacking(details: dict[str, float], reported: str) -> None:
    assert reported in advice(Decision("inconclusive", details=details))


def test_of_bad_recordings_every_problem_is_reported_and_nothing_else(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    good = read_recording(recordings / "healthy.mcap")
    time_s, position = good["time_s"], good["position_m"]
    gap = altered(good, tmp_path / "gap.csv", time_s=np.where(time_s < 2, time_s, time_s + 700))
    back = altered(good, tmp_path / "back.csv", time_s=np.where(time_s < 2, time_s, time_s - 0.5))
    rate = altered(good, tmp_path / "rate.csv", time_s=200.0 * time_s)
    hole = altered(good, tmp_path / "inf.csv", position_m=np.where(time_s == 3, np.inf, position))
    columns = altered(good, tmp_path / "columns.csv", pressure_2_Pa=None)
    missing = tmp_path / "nowhere.csv"
    done = invoke(
        "replay", "--json", recordings / "healthy.mcap", gap, back, rate, hole, columns, missing,
        "--model", "unheard_of", "--filter", "thesis-8",
    )  # fmt: skip
    assert done.code == 2
    assert done.out == ""
    lines = done.err.splitlines()
    assert any(line.startswith(f"{gap}:2002: time_s: gap of 700.001 s") for line in lines)
    assert any(line.startswith(f"{back}:2002: time_s: 1.5 s after 1.999 s") for line in lines)
    assert any(line.startswith(f"{rate}: time_s: a row every 200 ms") for line in lines)
    assert any(line.startswith(f"{hole}:3002: position_m: inf") for line in lines)
    assert any(line.startswith(f"{columns}: pressure_2_Pa: missing column") for line in lines)
    assert any(line.startswith(f"{missing}: file: does not exist") for line in lines)
    assert any("unheard_of is not a known model" in line for line in lines)
    assert any(line.startswith("--filter: no filter 'thesis-8'") for line in lines)
    assert "Traceback" not in done.err


def of_rows(recording: Recording, path: Path, rows: np.ndarray[Any, Any]) -> Path:
    """Write some rows of the columns that replay reads to CSV."""
    channels = {name: values[rows] for name, values in recording.channels.items()}
    return altered(Recording(channels), path)


@pytest.mark.parametrize(
    "rows",
    [slice(None, None, 2), slice(None, None, 4), np.r_[0:3000, 3400:9000, 9030:20000], "uneven"],
    ids=["500 Hz", "250 Hz", "two gaps", "uneven"],
)
def test_a_leak_is_found_at_other_rates_and_beside_gaps(
    invoke: Invoke, recordings: Path, tmp_path: Path, rows: Any
) -> None:
    whole = read_recording(recordings / "leak_low.mcap")
    if isinstance(rows, str):
        rows = np.flatnonzero(np.random.default_rng(1).random(len(whole)) < 0.8)
    kept = np.arange(len(whole))[rows if isinstance(rows, slice) else rows[rows < len(whole)]]
    file = of_rows(whole, tmp_path / "leak.csv", kept)
    told, asked = (
        json.loads(invoke("replay", "--json", path).out)
        for path in (file, recordings / "leak_low.mcap")
    )
    assert told["verdict"] == asked["verdict"] == "external_leakage_1"
    assert told["onset_s"] == pytest.approx(asked["onset_s"], abs=0.5)
    assert told["leak_L_per_min"] == pytest.approx(asked["leak_L_per_min"], rel=0.05)
    assert told["sampling"]
    assert asked["sampling"] == []


@pytest.mark.parametrize(
    ("held", "words"), [(True, "repeats each reading"), (False, "by straight lines")]
)
def test_readings_between_true_ones_make_no_verdict(
    invoke: Invoke, recordings: Path, tmp_path: Path, *, held: bool, words: str
) -> None:
    whole = read_recording(recordings / "leak_low.mcap")
    at = np.arange(0, len(whole), 10)
    slow = {
        name: whole[name][at].repeat(10)[: len(whole)]
        if held
        else np.interp(whole.time_s, whole.time_s[at], whole[name][at])
        for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
    }
    file = altered(whole, tmp_path / "slow.csv", **slow)
    told = json.loads(invoke("replay", "--json", file).out)
    assert told["verdict"] == "inconclusive"
    assert words in told["reason"]
    assert told["onset_s"] is None
    assert words in " ".join(invoke("replay", file).out.split())


def test_a_row_every_10_ms_is_too_slow_and_told_so(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    whole = read_recording(recordings / "leak_low.mcap")
    file = of_rows(whole, tmp_path / "slow.csv", np.arange(0, len(whole), 10))
    told = json.loads(invoke("replay", "--json", file).out)
    assert told["verdict"] == "inconclusive"
    assert told["reason"].startswith("a row every 10 ms is too slow")


def test_a_filter_of_the_thesis_needs_a_row_every_ms(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    whole = read_recording(recordings / "leak_low.mcap")
    file = of_rows(whole, tmp_path / "slow.csv", np.arange(0, len(whole), 2))
    told = json.loads(invoke("replay", "--json", "--filter", "thesis-6", file).out)
    assert told["verdict"] == "inconclusive"
    assert told["reason"].startswith("thesis-6 needs a row every ms")


def test_columns_may_have_other_names_and_units(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    whole = read_recording(recordings / "leak_low.mcap")
    text = np.column_stack(
        [1e3 * whole.time_s, whole["command_V"], 1e3 * whole["position_m"],
         1e-5 * whole["pressure_1_Pa"], whole["pressure_2_Pa"] / 6895.0]
    )  # fmt: skip
    np.savetxt(tmp_path / "log.csv", text, "%.12g", ",", header="t,u,q,pa,pb", comments="")
    (tmp_path / "map.yaml").write_text(
        "time_s: {column: t, unit: ms}\ncommand_V: u\nposition_m: {column: q, unit: mm}\n"
        "pressure_1_Pa: {column: pa, unit: bar}\npressure_2_Pa: {column: pb, scale: 6895}\n"
    )
    done = invoke("replay", "--json", tmp_path / "log.csv", "--columns", tmp_path / "map.yaml")
    assert json.loads(done.out)["verdict"] == "external_leakage_1"


def test_all_mistakes_of_a_file_of_columns_are_told_with_their_lines(
    invoke: Invoke, recordings: Path, tmp_path: Path
) -> None:
    (tmp_path / "map.yaml").write_text(
        "positoin_m: q\nposition_m: {column: q, unit: bar}\n"
        "pressure_1_Pa: {colum: p}\ncommand_V: {column: u, unit: V, scale: 2}\n"
        "spool_m: 3\n"
    )
    path = tmp_path / "map.yaml"
    done = invoke("replay", recordings / "healthy.mcap", "--columns", path)
    assert done.code == 2
    lines = [line for line in done.err.splitlines() if "map.yaml" in line]
    assert [int(line.split("map.yaml:")[1].split(":")[0]) for line in lines] == [1, 2, 3, 4, 5]
    gone = invoke("replay", recordings / "healthy.mcap", "--columns", tmp_path / "gone.yaml")
    assert "--columns" in gone.err
    assert "does not exist" in gone.err


@pytest.mark.parametrize("rate", ["0", "nan", "inf"])
def test_a_false_alarm_rate_out_of_range_is_bad_input(
    invoke: Invoke, recordings: Path, rate: str
) -> None:
    done = invoke("replay", "--false-alarms-per-day", rate, recordings / "healthy.mcap")
    assert done.code == 2
    assert "0.001<=x<=1000" in done.err


def test_rarer_alarms_take_a_higher_threshold(invoke: Invoke, recordings: Path) -> None:
    def threshold(rate: str) -> float:
        path = recordings / "healthy.mcap"
        done = invoke("replay", "--json", "--false-alarms-per-day", rate, path)
        return float(json.loads(done.out)["threshold"])

    assert threshold("0.01") > threshold("1")
