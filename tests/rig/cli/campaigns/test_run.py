import errno
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from junitparser import JUnitXml

import rig.report
from rig.recording import McapWriter, read_recording
from rig.runner import CampaignOutcome
from tests.waiting import COMPILE_S, until

Invoke = Callable[..., Any]


SLOW = """
name: slow
rig: simulated
tests:
  - name: endless
    duration: 600 s
    settle: 0 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
  - name: second
    duration: 5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
"""


@pytest.fixture
def plain_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have runs write a report without plots, which take half of the time of a short run."""

    def write(outcome: CampaignOutcome, directory: Path, kept: object) -> Path:
        page = directory / "report.html"
        page.write_text("<p>no plots</p>")
        return page

    monkeypatch.setattr(rig.report, "write_report", write)


def test_a_campaign_ends_with_verdict_table_counts_and_report(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    assert done.code == 0
    assert done.err == ""
    lines = done.out.splitlines()
    assert "[2/2] leak [low]: passed, external_leakage_1 after 14 s" in lines
    (row,) = [line for line in lines if line.startswith("| leak [low]")]
    _, test, injected, found, onset, latency, result, _ = (part.strip() for part in row.split("|"))
    assert test == "leak [low]"
    assert injected.startswith("external_leakage_1 0.")
    assert injected.endswith("L/min at 8 s")
    assert found.startswith("external_leakage_1 > 99.9 % 0.")
    assert "±" in found
    assert onset.startswith(("7.", "8."))
    assert latency.endswith(" s")
    assert result == "passed"
    assert lines[-3] == "2 tests: 2 passed"
    assert lines[-2].endswith("rig-seconds per second")
    assert lines[-1] == f"report: {tmp_path / 'out' / 'report.html'}"
    assert (tmp_path / "out" / "report.html").stat().st_size > 0


@pytest.mark.usefixtures("plain_report")
def test_a_terminal_shows_a_bar_with_the_live_verdict_and_gets_its_cursor_back(
    invoke: Invoke, campaign_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stdout", terminal)
    assert invoke("run", campaign_file).code == 0
    shown = terminal.getvalue()
    assert "━" in shown
    assert "of 14 s" in shown
    assert shown.rindex("\x1b[?25h") > shown.rindex("\x1b[?25l")


@pytest.mark.usefixtures("plain_report")
def test_without_out_results_go_to_a_new_folder_below_runs_and_a_log_holds_no_control_codes(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    done = invoke("run", campaign_file)
    assert not [code for code in done.out if ord(code) < 32 and code != "\n"]
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("short-2")
    assert (folder / "results.json").exists()


@pytest.mark.usefixtures("plain_report")
def test_a_verdict_other_than_expected_is_exit_1(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    text = campaign_file.read_text().replace("    faults:", "    expect: healthy\n    faults:")
    campaign_file.write_text(text)
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    assert done.code == 1
    assert "failed, expected healthy" in done.out
    assert "2 tests: 1 passed, 1 failed" in done.out


@pytest.mark.usefixtures("plain_report")
def test_another_rig_can_be_named_and_the_report_shows_to_run_it_again_on_the_same(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    invoke("run", campaign_file, "--rig", "ideal", "--out", tmp_path / "out")
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["rig"] == "ideal"
    reported = results["provenance"]["command"]
    assert reported == ["rig", "run", str(campaign_file), "--rig", "ideal"]


def test_a_report_that_cannot_be_made_costs_no_results(
    invoke: Invoke, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(outcome: CampaignOutcome, directory: Path, kept: object) -> Path:
        raise RuntimeError("no ink")

    monkeypatch.setattr(rig.report, "write_report", fail)
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    log = tmp_path / "out" / "errors.log"
    assert done.code == 1
    assert done.err == f"rig: no report: RuntimeError: no ink; traceback in {log}\n"
    assert "no ink" in log.read_text()
    assert len(JUnitXml.fromfile(str(tmp_path / "out" / "junit.xml"))) == 1


def test_a_report_for_which_there_is_no_space_is_told_with_the_way_to_write_it_later(
    invoke: Invoke, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(outcome: CampaignOutcome, directory: Path, kept: object) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device", str(directory / "report.html"))

    monkeypatch.setattr(rig.report, "write_report", fail)
    out = tmp_path / "out"
    done = invoke("run", campaign_file, "--out", out)
    assert done.code == 1
    state = f"{out / 'report.html'}: no space left on device; free space, or give another --out"
    assert done.err == f"rig: no report: {state}; then write it: rig run --resume {out}\n"


def test_what_is_not_the_run_s_own_file_is_named_where_it_cannot_be_opened(
    invoke: Invoke, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> CampaignOutcome:
        raise OSError(errno.EMFILE, "Too many open files", "/elsewhere")

    monkeypatch.setattr("rig.cli.campaigns.run.run_campaign", fail)
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    assert done.code == 3
    assert done.err.startswith("rig: /elsewhere: too many open files; allow this program")


def test_results_that_cannot_be_written_are_said_in_a_sentence(
    invoke: Invoke, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> CampaignOutcome:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("rig.cli.campaigns.run.run_campaign", fail)
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    assert done.code == 3
    state = f"results cannot be written to {tmp_path / 'out'}: No space left on device"
    assert done.err == f"rig: {state}; free space, or give another --out\n"


BAD_FILES = {
    "an unknown key": ("duration: 14 s", "durration: 14 s", ":10:5 durration:"),
    "a wrong unit": ("duration: 14 s", "duration: 14 V", ":10:5 duration: 14 V is not a time"),
    "a value out of range": ("duration: 14 s", "duration: 2 h", ":10:5 duration: 2 h is above"),
    "a missing file": (
        "{type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}\n    faults",
        "{type: file, path: nowhere.csv}\n    faults",
        ":12:28 path:",
    ),
    "a leak on a rig without that bypass": (
        "rig: simulated",
        "rig: ./bare.yaml",
        "needs a bypass valve that the rig bare lacks",
    ),
    "a setpoint beyond the stroke": (
        "mean: 0.3 m",
        "mean: 0.5 m",
        ":8:5 setpoint: 0.7 m at 0.500 s is above",
    ),
}


@pytest.mark.parametrize("mistake", BAD_FILES)
def test_of_bad_input_line_field_and_remedy_are_reported_and_nothing_is_written(
    invoke: Invoke, campaign_file: Path, tmp_path: Path, mistake: str
) -> None:
    (tmp_path / "bare.yaml").write_text("name: bare\nparent: simulated\nbypass_valves: {}\n")
    old, new, expected = BAD_FILES[mistake]
    campaign_file.write_text(campaign_file.read_text().replace(old, new))
    before = sorted(tmp_path.rglob("*"))
    done = invoke("run", campaign_file, "--out", tmp_path / "out")
    assert done.code == 2
    assert done.out == ""
    assert f"{campaign_file.name}:" in done.err
    assert expected in done.err
    assert "Traceback" not in done.err
    assert sorted(tmp_path.rglob("*")) == before


def test_all_mistakes_are_reported_at_once(invoke: Invoke, campaign_file: Path) -> None:
    text = campaign_file.read_text()
    for old, new, _ in BAD_FILES.values():
        text = text.replace(old, new) if "rig:" not in old else text
    campaign_file.write_text(text + "  - name: third\n    duration: 5\n")
    done = invoke("run", campaign_file)
    assert done.code == 2
    assert len(done.err.splitlines()) >= 4


def test_a_folder_that_is_no_run_s_is_bad_input(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    done = invoke("run", campaign_file, "--out", tmp_path)
    assert done.code == 2
    assert f"{tmp_path}: holds short.yaml" in done.err
    assert [file.name for file in tmp_path.iterdir()] == ["short.yaml"]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """`rig run` at the wall clock in a process of its own, two seconds into an endless test."""
    (tmp_path / "slow.yaml").write_text(SLOW)
    # A test run in the background has SIGINT ignored, and its children with it.
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from rig.cli import main; main(['run', 'slow.yaml', '--pace', 'real', '--out', 'out'])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:

            def recorded() -> bool:
                assert process.poll() is None, process.communicate()
                return has_samples(tmp_path / "out" / "endless.mcap")

            until(recorded, "samples", patience_s=COMPILE_S)
            yield process
        finally:
            process.kill()


def has_samples(recording: Path) -> bool:
    """Return whether a recording holds its first second: one chunk, far larger than metadata."""
    return recording.exists() and recording.stat().st_size > 200_000


def test_a_signal_ends_a_run_with_a_partial_report_and_intact_recordings(
    running: subprocess.Popen[str], tmp_path: Path
) -> None:
    for _ in range(2):  # who presses Ctrl-C presses it again
        running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=COMPILE_S)
    assert running.returncode == 3
    is_left_whole_by(signal.SIGINT, out, err, tmp_path / "out")


def test_so_does_sigterm(invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = McapWriter.write
    written: list[int] = []

    def write_and_terminate(self: McapWriter, rows: Any) -> None:
        write(self, rows)
        written.append(len(rows))
        if sum(written) > 2000 >= sum(written[:-1]):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(McapWriter, "write", write_and_terminate)
    (tmp_path / "slow.yaml").write_text(SLOW)
    done = invoke("run", "slow.yaml", "--out", "out")
    assert done.code == 3
    is_left_whole_by(signal.SIGTERM, done.out, done.err, tmp_path / "out")


def is_left_whole_by(number: signal.Signals, out: str, err: str, folder: Path) -> None:
    """Assert what a stopped run leaves of the slow campaign, and says."""
    assert err == ""
    assert "endless: aborted, " in out
    assert "2 tests: 1 aborted, 1 not run" in out
    assert (folder / "report.html").stat().st_size > 0
    recording = read_recording(folder / "endless.mcap")
    assert recording.events[-1].kind == "abort"
    assert recording.events[-1].text == f"stopped by {number.name}"
    written = json.loads((folder / "results.json").read_text())
    assert [test["status"] for test in written["tests"]] == ["aborted", "not_run"]
    assert written["tests"][0]["recorded_s"] == pytest.approx(len(recording) * 1e-3)
    suite = next(iter(JUnitXml.fromfile(str(folder / "junit.xml"))))
    assert (suite.errors, suite.skipped) == (1, 1)


def test_a_run_whose_output_nobody_reads_stops_and_keeps_its_results(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    program = f"from rig.cli import main; main(['run', {str(campaign_file)!r}, '--out', 'out'])"
    with subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 3
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert {test["status"] for test in written["tests"]} <= {"not_run", "aborted", "passed"}
    assert (tmp_path / "out" / "report.html").exists()


LIMITED_RIG = """
name: limited
parent: simulated
limits:
  position: [5 mm, 0.6 m]
  command: 10 V
  pressure: 20 MPa
  channels:
    - {channel: pressure_1_Pa, high: 8 MPa, action: trip, for: 3 ms}
"""

LIMITED = """
name: limited
rig: limited.yaml
tests:
  - name: too_much
    duration: 5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}
  - name: never
    duration: 5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
"""


def test_a_simulated_campaign_that_exceeds_a_limit_ends_with_exit_code_3_and_a_trip_report(
    invoke: Invoke, tmp_path: Path
) -> None:
    (tmp_path / "limited.yaml").write_text(LIMITED_RIG)
    campaign = tmp_path / "campaign.yaml"
    campaign.write_text(LIMITED)
    done = invoke("run", campaign, "--out", tmp_path / "out")
    assert done.code == 3
    assert "; pressure_1_Pa is above its limit: 8." in done.out
    assert "limit 8 MPa" in done.out
    assert json.loads((tmp_path / "out" / "trip-1.json").read_text())["cause"] == "LIMIT_HIGH"
    reported = json.loads((tmp_path / "out" / "results.json").read_text())["tests"]
    assert [test["status"] for test in reported] == ["tripped", "not_run"]
    assert (tmp_path / "out" / "report.html").stat().st_size > 0
