"""A run is followed, and stopped, from another process; a dead stream is shown as dead."""

import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from rig.cli import main
from rig.cli.live.monitor import document, line, screen
from rig.recording import read_recording
from rig.stream.known import Snapshot
from tests.waiting import COMPILE_S, PATIENCE_S, until

PAGE = Path(__file__).parents[4] / "docs" / "stream.md"
RIG = str(Path(sys.executable).with_name("rig"))
CAMPAIGN = """
name: followed
rig: simulated
model: nominal
defaults:
  duration: 600 s
  settle: 0.1 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.05 m, frequency: 0.5 Hz}
tests:
  - name: first
"""
PROFILE = (
    "name: here\nlisten: [tcp/127.0.0.1:{port}]\n"
    "commands: [{{operator: local, allow: [abort, hold, resume]}}]\n"
)


def invoked(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run `rig` within this process: to start another one takes a second of a processor."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main(list(arguments))
    code = ended.value.code
    assert isinstance(code, int)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


@dataclass
class Run:
    """A run of ten minutes, with a stream on a port of its own."""

    folder: Path
    port: int
    process: subprocess.Popen[str]

    def monitor(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Follow the run; from this process, but from another one than the run's."""
        profile = str(self.folder / "here.yaml")
        patience = ("--wait", f"{PATIENCE_S:g}")
        return invoked("monitor", "--profile", profile, *patience, *arguments)

    def until_judged(self) -> None:
        """Wait until the monitor shows that the detector has decided something."""

        def judged() -> bool:
            assert self.process.poll() is None, self.process.communicate()
            reported = self.monitor("--once", "--json").stdout
            return bool(reported and json.loads(reported)["decision"])

        until(judged, "a decision", patience_s=COMPILE_S)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    import socket

    folder = tmp_path_factory.mktemp("run")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    (folder / "here.yaml").write_text(PROFILE.format(port=port))
    process = subprocess.Popen(
        [RIG, "run", "campaign.yaml", "--pace", "real", "--out", "out", "--stream", "here.yaml"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    run = Run(folder, port, process)
    try:
        run.until_judged()
        yield run
    finally:
        process.kill()
        process.communicate()


def test_a_run_is_followed_live(run: Run) -> None:
    reported = json.loads(run.monitor("--once", "--json").stdout)
    assert reported["rig"] == "simulated"
    assert reported["alive"]
    assert reported["units"]["pressure_1_Pa"] == "Pa"
    assert 1e5 < reported["latest"]["pressure_1_Pa"] < 2e7
    assert reported["progress"]["name"] == "first"
    assert reported["decision"]["threshold"] > 0.0
    assert reported["rate_hz"] > 0.0


def test_a_log_has_a_line_a_rig(run: Run) -> None:
    shown = run.monitor("--once")
    assert shown.returncode == 0
    assert re.fullmatch(r"simulated: live, \d+ samples a second, \[1/1\] first, .*\n", shown.stdout)


def test_the_ten_lines_of_the_page_follow_it(run: Run) -> None:
    (code,) = re.findall(r"ten lines\n.*?```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    lines = [
        reported for reported in code.splitlines() if reported and not reported.startswith("import")
    ]
    assert len(lines) <= 10
    process = subprocess.Popen(
        [sys.executable, "-c", code.replace("7447", str(run.port))],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    patience = threading.Timer(PATIENCE_S, process.kill)
    patience.start()
    lines = [process.stdout.readline() for _ in range(3)]
    patience.cancel()
    process.kill()
    process.communicate()
    assert all("'position_m'" in reported for reported in lines)


def test_a_hold_pauses_the_campaign_and_a_resume_goes_on(run: Run) -> None:
    assert run.monitor("--send", "resume").returncode == 1
    assert run.monitor("--send", "hold", "--text", "lunch").stdout == "hold: obeyed\n"
    assert run.monitor("--send", "resume").stdout == "resume: obeyed\n"
    denied = run.monitor("--send", "acknowledge")
    assert (denied.returncode, "may not acknowledge" in denied.stdout) == (1, True)


def test_the_example_of_the_client_stops_the_run(run: Run) -> None:
    (code,) = re.findall(r"From Python\n.*?```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    ran = subprocess.run(
        [sys.executable, "-c", code.replace('"loopback"', '"here.yaml"')],
        cwd=run.folder, capture_output=True, text=True, timeout=COMPILE_S, check=False,
    )  # fmt: skip
    assert "accepted=True" in ran.stdout, ran.stderr
    output, _ = run.process.communicate(timeout=COMPILE_S)
    assert run.process.returncode == 3
    assert "abort by local" in output
    assert "stopped by" in output
    assert '"who": "local"' in (run.folder / "out" / "journal.jsonl").read_text()
    recording = read_recording(run.folder / "out" / "first.mcap")
    assert [event.kind for event in recording.events][-1] == "abort"
    shown = run.monitor("--once", "--wait", "0.5")
    assert (shown.returncode, "no rig is heard of" in shown.stderr) == (1, True)


def test_a_wrong_endpoint_is_bad_input(run: Run) -> None:
    shown = run.monitor("--connect", "127.0.0.1:7447")
    assert shown.returncode == 2
    assert "write like tcp/127.0.0.1:7447" in shown.stderr


def test_a_missing_certificate_is_reported_before_a_run_begins(tmp_path: Path) -> None:
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    out = str(tmp_path / "out")
    ran = invoked("run", str(tmp_path / "campaign.yaml"), "--out", out, "--stream", "mtls")
    assert ran.returncode == 2
    assert "cannot be read" in ran.stderr
    assert not (tmp_path / "out").exists()


DEAD = Snapshot(
    rig="bench",
    alive=False,
    age_s=12.34,
    latest={"position_m": 0.3, "load_N": float("nan")},
    names=("position_m", "load_N"),
    units=("m", "N"),
    time_s=3.0,
    decision={"verdict": "internal_leakage", "statistic": 9.0, "threshold": None,
              "probabilities": {"internal_leakage": 0.97}, "leak_m3_per_s": 5e-6},
    health={
        "timing": {"wakeup": {"p50_s": 2e-5, "p99_s": 3e-5, "max_s": 1e-3}},
        "trips": {"first_out": [{"by": "loop", "sentence": "it fell", "remedy": "lift it"}]},
    },
    events=({"kind": "refused", "text": "forged", "time_s": None},),
    missing={"rows": 20},
)  # fmt: skip


def shown(snapshot: Snapshot) -> str:
    console = Console(width=120, no_color=True)
    with console.capture() as capture:
        console.print(screen(snapshot))
    return capture.get()


def test_a_dead_stream_is_shown_as_dead_with_its_age() -> None:
    assert "DEAD for 12.3 s" in line(DEAD)
    assert "DEAD for 12.3 s" in shown(DEAD)
    assert not document(DEAD)["alive"]
    assert document(DEAD)["life"] == "dead"
    ended = replace(DEAD, campaign={"status": "ended"})
    assert "ended 12.3 s ago" in line(ended)
    assert "DEAD" not in shown(ended)


def test_a_leak_that_comes_and_goes_is_never_said_to_be_gone() -> None:
    decision = {"verdict": "internal_leakage", "probabilities": {}, "intermittent": True,
                "duty": 0.2, "ended_s": 88.0}  # fmt: skip
    told = line(Snapshot("bench", decision=decision))
    assert "comes and goes, open 20 % of the time, last open until 88.0 s" in told
    assert "gone again" not in told
    stayed = line(Snapshot("bench", decision=decision | {"intermittent": False}))
    assert "gone again at 88.0 s" in stayed


def test_the_tank_is_shown_in_degrees_where_it_is_measured() -> None:
    warm = replace(DEAD, latest={"tank_temperature_K": 313.15})
    assert "tank 40.00 °C" in line(warm)
    assert "40.00 °C" in shown(warm)
    assert "tank" not in line(DEAD)


def test_the_screen_shows_what_an_operator_asks_for() -> None:
    text = shown(DEAD)
    for reported in ("300.00 mm", "internal_leakage 97 %, 0.300 L/min", "9.00 of -", "p99 30 us",
                 "by loop: it fell; lift it", "20 rows", "refused: forged"):  # fmt: skip
        assert reported in text


def test_a_stream_that_sent_nothing_yet_is_shown() -> None:
    assert "nothing heard yet" in shown(Snapshot("bench"))
    assert document(Snapshot("bench"))["time_s"] is None


def test_what_programs_read_is_json() -> None:
    reported = json.loads(json.dumps(document(DEAD), allow_nan=False))
    assert reported["latest"] == {"position_m": 0.3, "load_N": None}
