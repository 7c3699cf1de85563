"""Past runs: found, shown, compared and pruned, by their folders alone."""

import errno
import json
import re
import shutil
import warnings
import zlib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.loop.timing import STAGES
from rig.runner.outcomes.figures import Figure, figures_of
from rig.runner.run_folder.acknowledging import acknowledge_ended
from rig.runner.run_folder.archive import RunError, prunable, read_run, run_named, runs_below
from rig.runner.run_folder.comparing import ANYTHING, TOLERANCES, Tolerance, compare, tolerance_of

Invoke = Callable[..., Any]


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one leak."""
    from rig.configuration import load_campaign
    from rig.runner import run_campaign

    folder = tmp_path_factory.mktemp("template")
    (folder / "leak.yaml").write_text(
        "name: leak\nrig: simulated\ntests:\n  - name: leak [low]\n    duration: 14 s\n"
        "    settle: 0.5 s\n"
        "    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}\n"
        "    faults: [{type: external_leakage_1, at: 8 s, flow: 0.8 L/min, pressure: 6.9 MPa}]\n"
    )
    campaign, rig = load_campaign(folder / "leak.yaml")
    run_campaign(campaign, rig, folder / "run")
    return folder / "run"


@pytest.fixture
def make_run(template: Path, tmp_path: Path) -> Callable[..., Path]:
    """Copy the run, begun some days ago, with changed results."""

    def make(name: str, days_ago: float = 0.0, change: Callable[[Any], None] | None = None) -> Path:
        folder = tmp_path / "runs" / name
        shutil.copytree(template, folder)
        results = json.loads((folder / "results.json").read_text())
        started = datetime.now(UTC) - timedelta(days=days_ago)
        results["started"] = started.isoformat(timespec="seconds")
        if change is not None:
            change(results)
        (folder / "results.json").write_text(json.dumps(results))
        return folder

    return make


MakeRun = Callable[..., Path]


def leak(value: float) -> Callable[[Any], None]:
    def change(results: Any) -> None:
        results["tests"][0]["figures"]["leak"]["value"] = value

    return change


def test_a_run_shows_the_figures_to_follow(template: Path) -> None:
    (test,) = read_run(template).tests
    figures = test["figures"]
    assert figures["leak"]["unit"] == "L/min"
    assert 0.0 < figures["leak"]["standard_error"] < figures["leak"]["value"]
    for chamber in (1, 2):
        level = figures[f"residual_pressure_{chamber}"]
        assert 0.0 < level["standard_error"] < level["value"] < 1e6


def test_runs_are_found_by_date_campaign_rig_and_verdict(invoke: Invoke, make_run: MakeRun) -> None:
    make_run("old", 40.0)
    make_run("new", 1.0, lambda results: results.update(rig="other"))
    (make_run("broken") / "results.json").write_text("{")

    def found(*options: str) -> list[str]:
        lines = invoke("runs", "list", "--json", *options).out.splitlines()
        return [Path(json.loads(line)["folder"]).name for line in lines]

    assert found() == ["old", "new"]
    assert found("--since", "7 d") == ["new"]
    assert found("--until", "7 d") == ["old"]
    assert found("--rig", "other") == ["new"]
    assert found("--campaign", "nothing") == []
    assert found("--verdict", "external_leakage_1") == ["old", "new"]
    assert found("--verdict", "healthy") == []
    assert found("--state", "unfinished") == []
    table = invoke("runs", "list").out
    assert "external_leakage_1" in table
    assert "2 runs below runs" in table
    assert invoke("runs", "list", "--since", "yesterday").code == 2


def test_a_run_is_shown_by_name_and_by_path(invoke: Invoke, make_run: MakeRun) -> None:
    folder = make_run("one")
    by_name, by_path = invoke("runs", "show", "one"), invoke("runs", "show", folder)
    assert by_name.code == by_path.code == 0
    assert "leak [low]: passed, external_leakage_1 0." in by_name.out
    assert json.loads(invoke("runs", "show", "one", "--json").out)["state"] == "ended"
    assert invoke("runs", "show", "two").code == 2


def test_who_has_acknowledged_a_run_after_its_end_is_shown_and_the_run_has_ended(
    invoke: Invoke, make_run: MakeRun
) -> None:
    acknowledge_ended(make_run("one"), "root", "Anna: it was me", "Anna")
    shown = invoke("runs", "show", "one").out
    assert re.search(r"\d\d:\d\d:\d\d Anna: acknowledge: it was me$", shown.strip())
    assert json.loads(invoke("runs", "show", "one", "--json").out)["state"] == "ended"


@pytest.mark.parametrize("command", [("show", "one"), ("prune", "--keep", "0")])
def test_a_file_that_may_not_be_read_is_named(
    invoke: Invoke, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    def denied(file: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied", str(file))

    make_run("one")
    monkeypatch.setattr("rig.runner.run_folder.directory._is_ours", denied)
    done = invoke("runs", *command)
    assert done.code == 2
    assert "mcap: cannot be read: permission denied; let this user read it" in done.err


def test_results_whose_exit_code_is_no_number_are_damaged(
    invoke: Invoke, make_run: MakeRun
) -> None:
    make_run("one", 0.0, lambda results: results.update(exit_code="0"))
    done = invoke("runs", "show", "one")
    assert (done.code, "the exit code '0'" in done.err) == (2, True)


def test_two_equal_runs_do_not_differ(invoke: Invoke, make_run: MakeRun, tmp_path: Path) -> None:
    make_run("one"), make_run("two")
    done = invoke("runs", "compare", "one", "two", "--out", "page.html")
    assert done.code == 0
    assert "0 of " in done.out
    assert "Nothing moved" in (tmp_path / "page.html").read_text()


def test_a_figure_that_moved_beyond_its_tolerance_fails_the_gate(
    invoke: Invoke, make_run: MakeRun, tmp_path: Path
) -> None:
    value = read_run(make_run("one")).tests[0]["figures"]["leak"]["value"]
    make_run("near", 0.0, leak(1.01 * value))
    make_run("far", 0.0, leak(2.0 * value))
    assert invoke("runs", "compare", "one", "near").code == 0
    done = invoke("runs", "compare", "one", "far", "--out", "page.html")
    assert done.code == 1
    (row,) = [line for line in done.out.splitlines() if "leak [low]" in line]
    assert "| leak " in row
    assert "1 of " in done.out
    assert "1 of " in (tmp_path / "page.html").read_text()
    lines = [
        json.loads(x)
        for x in invoke("runs", "compare", "one", "far", "--json").out.split("\n")
        if x
    ]
    assert [line["figure"] for line in lines if line["standing"] == "moved"] == ["leak"]

    (tmp_path / "loose.yaml").write_text("leak: {relative: 2}\n")
    assert invoke("runs", "compare", "one", "far", "--tolerances", "loose.yaml").code == 0
    (tmp_path / "loose.yaml").write_text("leak: ignore\n")
    assert invoke("runs", "compare", "one", "far", "--tolerances", "loose.yaml").code == 0
    (tmp_path / "tight.yaml").write_text("leak: {sigmas: 0}\n")
    assert invoke("runs", "compare", "one", "near", "--tolerances", "tight.yaml").code == 1
    (tmp_path / "wrong.yaml").write_text(
        "leek: ignore\nleak: {relatve: 1, absolute: -1}\nonset: 3\n"
    )
    wrong = invoke("runs", "compare", "one", "near", "--tolerances", "wrong.yaml")
    assert wrong.code == 2
    assert len(wrong.err.splitlines()) == 4


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("a verdict", lambda results: results["tests"][0]["found"].update(verdict="healthy")),
        ("a status", lambda results: results["tests"][0].update(status="failed")),
        ("a figure that is gone", lambda results: results["tests"][0]["figures"].pop("leak")),
        ("a test that is gone", lambda results: results["tests"].clear()),
    ],
)
def test_a_change_without_a_number_fails_the_gate_too(
    make_run: MakeRun, what: str, change: Callable[[Any], None]
) -> None:
    reference = read_run(make_run("one"))
    candidate = read_run(make_run("two", 0.0, change))
    assert compare(reference, candidate).moved, what
    # What is only in the candidate is new, and no harm.
    assert what != "a figure that is gone" or not compare(candidate, reference).moved


def test_the_longest_name_that_fits_gives_the_tolerance() -> None:
    known = {"loop": Tolerance(1.0), "loop_missed": Tolerance(2.0)}
    assert tolerance_of("loop_missed", known) == Tolerance(2.0)
    assert tolerance_of("loop_wakeup_p99", known) == Tolerance(1.0)
    assert tolerance_of("loops", known) == Tolerance()
    assert ANYTHING.of(1.0, 0.0) == float("inf")


def missed(stalls: list[int]) -> Figure:
    """Return the figure of a run of 60 s of which stalls of the machine took so many ticks each."""
    stages = {name: {"p50_s": None, "p99_s": None} for name in STAGES}
    squares = sum(stall**2 for stall in stalls)
    timing = {"ticks": 60_000, "missed": sum(stalls), "missed_squares": squares, "stages": stages}
    return figures_of(None, np.empty((0, 2)), None, timing)["loop_missed"]


@pytest.mark.parametrize(
    ("what", "reference", "candidate", "is_luck"),
    [
        ("one stall of 0.2 s", [], [200], True),
        ("three stalls and four others", [90, 210, 60], [150, 30, 30, 220], True),
        ("a tick in fifty, one by one", [200], [1] * 1200, False),
        ("thirty stalls instead of one", [100], [100] * 30, False),
    ],
)
def test_two_good_runs_differ_in_missed_ticks_by_the_luck_of_the_machine_only(
    what: str, reference: list[int], candidate: list[int], is_luck: bool
) -> None:
    old, new = missed(reference), missed(candidate)
    error = hypot(old.standard_error or 0.0, new.standard_error or 0.0)
    tolerated = tolerance_of("loop_missed", TOLERANCES).of(old.value, error)
    assert (abs(new.value - old.value) <= tolerated) is is_luck, what


def test_pruning_shows_first_and_removes_only_what_runs_wrote(
    invoke: Invoke, make_run: MakeRun
) -> None:
    old, middle, new = (make_run(name, days) for name, days in (("a", 90), ("b", 60), ("c", 1)))
    (old / "photo.jpg").write_text("of the leak")
    reported = invoke("runs", "prune", "--keep", "1")
    assert reported.out.count("would remove") == 2
    assert (old / "results.json").exists()
    done = invoke("runs", "prune", "--keep", "1", "--older-than", "70 d", "--delete")
    assert done.code == 0
    assert [file.name for file in old.iterdir()] == ["photo.jpg"]
    assert "photo.jpg" in done.err
    assert (middle / "results.json").exists()
    assert invoke("runs", "prune", "--keep", "1", "--delete").code == 0
    assert not middle.exists()
    assert new.exists()


def test_what_could_be_resumed_is_not_pruned(make_run: MakeRun, tmp_path: Path) -> None:
    make_run("a", 90.0, lambda results: results["tests"][0].update(status="not_run"))
    make_run("b", 80.0)
    runs = list(runs_below(tmp_path / "runs"))
    assert [run.state for run in runs] == ["unfinished", "ended"]
    going = prunable(runs, keep=0, older_than=None, now=datetime.now(UTC))
    assert [run.folder.name for run in going] == ["b"]


@pytest.mark.parametrize("name", ["../secret", "..", ".", "", "/etc", "a/b", "a\\b", "a\0b"])
def test_a_name_that_leads_elsewhere_is_refused(
    make_run: MakeRun, tmp_path: Path, name: str
) -> None:
    shutil.move(make_run("one"), tmp_path / "secret")
    with pytest.raises(RunError, match="is not the name of a run"):
        run_named(name, tmp_path / "runs")


def test_a_link_to_elsewhere_is_no_run(make_run: MakeRun, tmp_path: Path) -> None:
    shutil.move(make_run("one"), tmp_path / "secret")
    (tmp_path / "runs" / "link").symlink_to(tmp_path / "secret")
    with pytest.raises(RunError, match="is a link"):
        run_named("link", tmp_path / "runs")


@pytest.mark.parametrize("recording", ["../../etc/passwd", "/etc/passwd", "..", "a\\b.mcap"])
def test_results_that_name_files_elsewhere_are_refused(
    invoke: Invoke, make_run: MakeRun, recording: str
) -> None:
    folder = make_run("one", 0.0, lambda results: results["tests"][0].update(recording=recording))
    with pytest.raises(RunError, match="is no file of it"):
        read_run(folder)
    assert invoke("export", folder, "out").code == 2


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": "rig-results"}', "[" * 100_000, '{"schema": 1e999}']
)
def test_results_that_are_none_are_refused_in_a_sentence(
    invoke: Invoke, make_run: MakeRun, text: str
) -> None:
    (make_run("one") / "results.json").write_text(text)
    done = invoke("runs", "show", "one")
    assert done.code == 2
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("extension", ["mf4", "parquet", "csv"])
def test_a_whole_run_is_exported_by_one_command(
    invoke: Invoke, make_run: MakeRun, tmp_path: Path, extension: str
) -> None:
    folder = make_run("one")
    done = invoke("export", folder, "out", "--format", extension)
    assert done.code == 0
    assert (tmp_path / "out" / f"leak_low.{extension}").stat().st_size > 10_000
    assert "14000 samples" in done.out


def test_the_recordings_of_a_run_and_their_exports_are_verified(
    invoke: Invoke, make_run: MakeRun
) -> None:
    folder = make_run("one")
    (recording,) = folder.glob("*.mcap")
    for end in ("parquet", "csv"):
        assert invoke("export", recording, recording.with_suffix(f".{end}")).code == 0
    verified = invoke("runs", "show", "one", "--verify")
    assert verified.code == 0
    assert verified.out.startswith("1 recordings and 2 exports are undamaged\n")
    table = recording.with_suffix(".csv")
    table.write_text(table.read_text().rpartition(",")[0] + ",1\n")
    content = bytearray(recording.with_suffix(".parquet").read_bytes())
    content[len(content) // 2] ^= 1
    recording.with_suffix(".parquet").write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        damaged = invoke("runs", "show", "one", "--verify")
    assert damaged.code == 2
    first, second, warning = sorted(damaged.err.splitlines())
    assert "describes other data" in warning
    assert f"{table.name}: file: has other names or values than {recording.name}" in first
    assert "could not verify page integrity" in second


def test_a_changed_metadata_value_and_a_recording_that_is_gone_are_told_by_verify(
    invoke: Invoke, make_run: MakeRun
) -> None:
    (recording,) = make_run("one").glob("*.mcap")
    content = recording.read_bytes()
    start = content.index(b'"bulk_modulus": ') + len(b'"bulk_modulus": ')
    changed = content[:start] + b"9" + content[start + 1 :]
    assert changed != content
    recording.write_bytes(changed)
    verified = invoke("runs", "show", "one", "--verify")
    assert verified.code == 2
    assert "the checksum of all data is wrong" in verified.err
    recording.unlink()
    verified = invoke("runs", "show", "one", "--verify")
    assert verified.code == 2
    assert f"{recording.name}: file: is gone" in verified.err


def test_names_that_would_steer_a_terminal_are_refused(invoke: Invoke, make_run: MakeRun) -> None:
    path = make_run("one") / "results.json"
    results = json.loads(path.read_text())
    results["tests"][0]["name"] = "a\x1b[31m\nall passed"
    path.write_text(json.dumps(results))
    shown = invoke("runs", "show", "one")
    assert shown.code == 2
    assert "characters that cannot be shown" in shown.err
    assert "\x1b" not in shown.err + shown.out


def test_a_journal_that_no_run_could_be_resumed_from_is_told_by_verify(
    invoke: Invoke, make_run: MakeRun
) -> None:
    journal = make_run("one") / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(b"0", b"1", 1)
    journal.write_bytes(b"".join(lines))
    verified = invoke("runs", "show", "one", "--verify")
    assert verified.code == 2
    assert "journal.jsonl:2: journal: is damaged, and lines follow it" in verified.err
    foreign = b'{"n": 0, "at": "", "kind": "collected"}'
    sealed = foreign[:-1] + b', "crc": "%08x"}\n' % zlib.crc32(foreign)
    for content, said in ((b"", "is empty"), (sealed, "is not a campaign's"), (None, "is gone")):
        journal.unlink() if content is None else journal.write_bytes(content)
        verified = invoke("runs", "show", "one", "--verify")
        assert (verified.code, f"journal: {said}" in verified.err) == (2, True)


@pytest.mark.parametrize(
    "malformed",
    [
        {"history": True},
        {"history": [{"at": 1, "who": "x", "what": "y"}]},
        {"tests": [{"name": "a", "status": "passed", "recording": None, "found": [1]}]},
        {"name": {}, "started": []},
    ],
    ids=["no history", "no time", "no finding", "no start"],
)
def test_results_that_are_not_as_they_are_written_are_damaged(
    invoke: Invoke, make_run: MakeRun, malformed: dict[str, Any]
) -> None:
    make_run("one", 1.0, lambda results: results.update(malformed))
    shown = invoke("runs", "show", "one")
    assert shown.code == 2
    assert "results.json: is damaged" in shown.err
