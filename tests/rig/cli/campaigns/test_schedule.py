"""`rig schedule`: a schedule run in earnest, added to, listed, and gone on with."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.configuration.reading.lookup import shipped_config_dir
from rig.runner.campaign.campaign_test_run import CLEANUP_S
from rig.runner.run_folder.journal import Journal

Invoke = Callable[..., Any]

SCHEDULE = """
name: night
runs: out
stream: off
hook: [{python}, -c, "import sys; open('hooked', 'w').write(' '.join(sys.argv[1:]))", "{{entry}}",
       "{{exit_code}}", "{{verdicts}}"]
entries:
  - {{name: never, campaign: ./short.yaml, at: 2126-01-01 00:00}}
"""


@pytest.fixture
def schedule(campaign_file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "night.yaml"
    path.write_text(SCHEDULE.format(python=sys.executable))
    return path


def test_what_is_added_runs_is_listed_and_followed_by_trend_page_and_hook(
    invoke: Invoke, schedule: Path, tmp_path: Path
) -> None:
    added = invoke("schedule", "add", schedule, "short.yaml", "--name", "now")
    assert (added.code, added.err) == (0, "")
    # What nobody has taken yet waits as well.
    asked = "waits: now, added and not taken yet, "
    assert asked in invoke("schedule", "list", schedule).out
    assert invoke("schedule", "run", schedule, "--until-idle").code == 0
    assert asked not in invoke("schedule", "list", schedule).out
    reported = json.loads(invoke("schedule", "list", schedule, "--json").out)
    (ended,) = reported["history"]
    assert (ended["entry"], ended["exit_code"]) == ("now", 0)
    assert reported["entries"][0]["next"] == "2126-01-01T00:00:00Z"
    folder = Path(ended["folder"])
    for name in ("junit.xml", "report.html", "results.json", "journal.jsonl"):
        assert (folder / name).stat().st_size > 0
    page = (folder.parent / "trend.html").read_text()
    assert "residual pressure 1" in page
    assert (tmp_path / "hooked").read_text() == "now 0 external_leakage_1,healthy"
    shown = invoke("schedule", "list", schedule).out
    assert "now: exit code 0" in shown
    assert invoke("schedule", "resume", schedule).code == 2
    # It is not run again at the next start.
    assert invoke("schedule", "run", schedule, "--until-idle").code == 0
    assert len(json.loads(invoke("schedule", "list", schedule, "--json").out)["history"]) == 1


def test_a_schedule_or_campaign_with_mistakes_is_bad_input(
    invoke: Invoke, schedule: Path, tmp_path: Path
) -> None:
    assert invoke("schedule", "add", schedule, "nothing").code == 2
    schedule.write_text(schedule.read_text().replace("stream: off", "stream: ./nowhere.yaml"))
    assert "nowhere.yaml" in invoke("schedule", "run", schedule).err
    schedule.write_text("name: night\n")
    done = invoke("schedule", "run", schedule)
    assert done.code == 2
    assert "entries" in done.err
    assert not (tmp_path / "out").exists()


def test_the_list_is_true_after_a_kill_and_in_the_zone_of_the_file(
    invoke: Invoke, schedule: Path, tmp_path: Path
) -> None:
    schedule.write_text(schedule.read_text() + "timezone: Europe/Helsinki\n")
    folder = tmp_path / "out"
    folder.mkdir()
    due: dict[str, Any] = {"id": "a", "entry": "now", "campaign": "short.yaml", "rig": None,
           "due": "2026-11-27T10:00:00+00:00", "attempt": 1, "not_before": None}  # fmt: skip
    with Journal(folder, name="schedule.jsonl") as journal:
        journal.write("added", **due)
        journal.write("added", **due | {"id": "b", "entry": "later"})
        journal.write("busy", id="b", why="daq is in use")
        journal.write("begun", id="a", folder=str(folder / "now-1"))
        running = json.loads(invoke("schedule", "list", schedule, "--json").out)
    assert (running["running"], running["present"]["state"]) == (True, "running")
    shown = invoke("schedule", "list", schedule).out
    assert "not running; rig schedule run" in shown
    assert f"interrupted: now in {folder / 'now-1'}" in shown
    assert "never: next 2126-01-01 00:00:00 EET" in shown
    assert "waits: later, due 2026-11-27 12:00:00 EET, attempt 1; its rig is busy, daq" in shown


UNIT = shipped_config_dir() / "systemd" / "rig-schedule@.service"


def setting_of(name: str) -> str:
    (line,) = [line for line in UNIT.read_text().splitlines() if line.startswith(f"{name}=")]
    return line.partition("=")[2]


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed"
)
def test_systemd_takes_the_shipped_unit(tmp_path: Path) -> None:
    # It looks whether the program is there, which it is elsewhere.
    unit = tmp_path / UNIT.name
    program = setting_of("ExecStart").split()[0]
    unit.write_text(UNIT.read_text().replace(program, sys.executable))
    command = ["systemd-analyze", "verify", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_shipped_unit_runs_what_there_is_and_lets_a_stop_end_in_its_own_time(
    invoke: Invoke, schedule: Path
) -> None:
    words = setting_of("ExecStart").replace("/etc/rig/schedules/%i.yaml", str(schedule)).split()
    assert invoke(*words[1:], "--until-idle").code == 0
    assert float(setting_of("TimeoutStopSec")) > CLEANUP_S
    assert setting_of("KillSignal") == "SIGTERM"
    assert setting_of("KillMode") == "mixed"  # the schedule alone is asked, and asks its run
