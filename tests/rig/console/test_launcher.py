"""The console starts what was offered, and nothing else; what it started outlives it."""

import json
import signal
import socket
import subprocess
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.configuration.reading.problems import ConfigError
from rig.console.launcher import (
    ASKED,
    ENDING,
    INTERRUPTED,
    Launcher,
    LaunchRefused,
    Served,
    offers_of,
)
from rig.control_socket import INTERRUPTED_BY, SOCKET, interrupted_by
from rig.runner.campaign.control_port import ControlPort
from rig.runner.campaign.operator_requests import Desk
from rig.runner.campaign.stopping import StopFlag

from .fakes import start_by, until

CAMPAIGN = (
    "name: {name}\ndescription: |\n  Two\n  lines.\nrig: bench\ntests:\n  - name: a\n  - name: b\n"
)


class Process:
    """A process that ends when it is asked to."""

    def __init__(self, arguments: list[str], **options: Any) -> None:
        self.arguments, self.options = arguments, options
        self.exit_code: int | None = None
        self.signals: list[signal.Signals] = []
        options["stdout"].write(b"rig: it\nis wrong\n")

    def poll(self) -> int | None:
        return self.exit_code

    def send_signal(self, number: signal.Signals) -> None:
        self.signals.append(number)


@pytest.fixture
def started() -> list[Process]:
    return []


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def launcher(
    tmp_path: Path, started: list[Process], said: list[str], monkeypatch: pytest.MonkeyPatch
) -> Launcher:
    (tmp_path / "leaks.yaml").write_text(CAMPAIGN.format(name="leaks"))

    def popen(*given: Any, **options: Any) -> Any:
        started.append(Process(*given, **options))
        return started[-1]

    served = Served(offers_of([str(tmp_path)]), tmp_path / "runs", "loopback", "bench.yaml")
    start_by(monkeypatch, popen)
    return Launcher(served, said.append)


def run_of(folder: Path, name: str, *kinds: dict[str, Any]) -> None:
    """Write the journal of a run."""
    (folder / "runs" / name).mkdir(parents=True)
    lines = [{"kind": "begin", "campaign": "leaks"}, *kinds]
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (folder / "runs" / name / "journal.jsonl").write_text(text)


def test_the_shipped_campaigns_are_offered_unless_others_are_given(tmp_path: Path) -> None:
    offers = {offer.name: offer for offer in offers_of([])}
    assert offers["quickstart"].reference == "quickstart"
    assert len(offers) >= 8
    (tmp_path / "mine.yaml").write_text(CAMPAIGN.format(name="mine"))
    (mine,) = offers_of([str(tmp_path / "mine.yaml")])
    assert (mine.reference, mine.rig, mine.tests) == (str(tmp_path / "mine.yaml"), "bench", 2)
    assert mine.description == "Two lines."


def test_campaigns_that_cannot_be_offered_are_all_reported(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("- no mapping\n")
    for name in ("b", "c"):
        (tmp_path / f"{name}.yaml").write_text(CAMPAIGN.format(name="twin"))
    with pytest.raises(ConfigError, match=r"(?s)a.yaml.*c.yaml.*is there twice"):
        offers_of([str(tmp_path)])
    with pytest.raises(ConfigError, match="does not exist"):
        offers_of(["../quickstart"])


def test_an_offer_is_started_in_a_process_and_a_folder_of_its_own(
    launcher: Launcher, started: list[Process], tmp_path: Path
) -> None:
    launcher.start("leaks", "Anna")
    (process,) = started
    assert process.arguments[1:5] == ["-m", "rig.cli", "run", str(tmp_path / "leaks.yaml")]
    assert process.arguments[5:7] == ["--rig", "bench.yaml"]
    assert "--by=Anna" in process.arguments
    assert process.arguments[-4:] == ["--pace", "real", "--stream", "loopback"]
    assert Path(process.arguments[8]).parent == tmp_path / "runs"
    assert process.options["start_new_session"]
    assert process.options["stdin"] is subprocess.DEVNULL


@pytest.mark.parametrize("name", ["", "other", "../leaks", "/etc/passwd", "leaks.yaml", "--help"])
def test_nothing_else_is_started(launcher: Launcher, started: list[Process], name: str) -> None:
    with pytest.raises(LaunchRefused, match="not offered"):
        launcher.start(name, "Anna")
    with pytest.raises(LaunchRefused, match="no such unfinished run"):
        launcher.go_on(name, "Anna")
    assert started == []


def test_one_runs_at_a_time_and_its_end_is_reported(
    launcher: Launcher, started: list[Process], said: list[str]
) -> None:
    launcher.start("leaks", "Anna")
    with pytest.raises(LaunchRefused, match="still runs"):
        launcher.start("leaks", "Anna")
    started[0].exit_code = 2
    launcher.look()
    assert said == ["leaks has ended: exit code 2, bad input: rig: it is wrong"]
    assert launcher.content()["last"]["exit_code"] == 2
    launcher.start("leaks", "Anna")
    started[1].exit_code = -9
    launcher.look()
    assert said[-1] == "leaks has ended: killed by SIGKILL"


def test_why_a_run_did_not_begin_is_reported_as_its_journal_has_it(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    assert launcher.content()["last"]["said"] == "is wrong"
    end = {"kind": "end", "reason": "the rig: the emergency stop is open", "exit_code": 3}
    (running / "journal.jsonl").write_text(json.dumps(end) + "\n")
    started[0].exit_code = 3
    launcher.look()
    last = launcher.content()["last"]
    assert (last["reason"], last["said"]) == ("the rig: the emergency stop is open", "")


def test_runs_that_were_stopped_or_killed_can_be_gone_on_with(
    launcher: Launcher, started: list[Process], tmp_path: Path
) -> None:
    run_of(tmp_path, "done", {"kind": "end", "reason": "", "exit_code": 0})
    run_of(tmp_path, "stopped", {"kind": "end", "reason": "Anna", "exit_code": 3})
    run_of(tmp_path, "killed", {"kind": "phase"})
    with (tmp_path / "runs" / "killed" / "journal.jsonl").open("a") as journal:
        journal.write('{"kind": "outc')
    run_of(tmp_path, "nonsense")
    (tmp_path / "runs" / "nonsense" / "journal.jsonl").write_text("[]\n")
    assert {run["folder"] for run in launcher.content()["unfinished"]} == {"stopped", "killed"}
    launcher.go_on("stopped", "Anna")
    assert started[0].arguments[4:6] == [str(tmp_path / "runs" / "stopped"), "--resume"]
    last = launcher.content()["last"]
    assert (last["name"], last["folder"], last["resumed"]) == ("leaks", "stopped", True)


def test_a_run_that_ended_badly_wants_to_be_acknowledged_once_and_can_still_be_gone_on_with(
    launcher: Launcher, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end = {"kind": "end", "reason": "a trip", "exit_code": 3}
    seen = {"kind": "operator", "request": "acknowledge", "who": "root", "person": "Anna",
            "at": "2026-11-28T12:00:00+00:00", "text": "Anna: it was me"}  # fmt: skip
    run_of(tmp_path, "tripped", end)
    run_of(tmp_path, "seen", end, seen)
    run_of(tmp_path, "passed", {"kind": "end", "reason": "", "exit_code": 0})
    content = launcher.content()
    assert [run["folder"] for run in content["unseen"]] == ["tripped"]
    assert {run["folder"] for run in content["unfinished"]} == {"tripped", "seen"}
    (known,) = content["seen"]
    assert (known["folder"], known["by"], known["at"], known["text"]) == (
        "seen", "Anna", seen["at"], "it was me",
    )  # fmt: skip
    asked: list[list[str]] = []

    def run(command: list[str], **_: Any) -> Any:
        asked.append(command)
        return SimpleNamespace(returncode=0)

    names = {"run": run, "DEVNULL": None, "SubprocessError": subprocess.SubprocessError}
    monkeypatch.setattr("rig.console.launcher.subprocess", SimpleNamespace(**names))
    launcher.acknowledge("tripped", "-- it was me", "Anna")
    folder = str(tmp_path / "runs" / "tripped")
    assert asked[0][3:] == ["control", folder, "acknowledge", "--by=Anna", "--", "-- it was me"]
    with pytest.raises(LaunchRefused, match="wants to be acknowledged"):
        launcher.acknowledge("passed", "", "Anna")


def test_it_is_known_on_which_rig_a_run_is_that_goes_on(
    launcher: Launcher, started: list[Process], tmp_path: Path
) -> None:
    for name, given in (("own", None), ("given", {"rig": "/rigs/annex.yaml"})):
        (tmp_path / "runs" / name).mkdir(parents=True)
        begun = {"kind": "begin", "campaign": "leaks", "given": given}
        (tmp_path / "runs" / name / "journal.jsonl").write_text(json.dumps(begun) + "\n")
    for name, rig in (("own", "bench"), ("given", "annex")):
        launcher.go_on(name, "Anna")
        running = launcher.present()
        assert running is not None
        assert running.rig == rig
        started[-1].exit_code = 0
        launcher.look()
    assert launcher.present() is None


@pytest.fixture
def running(launcher: Launcher) -> Path:
    """Return the folder of a run that was started."""
    launcher.start("leaks", "Anna")
    present = launcher.present()
    assert present is not None
    present.folder.mkdir()
    return present.folder


def test_a_run_that_answers_is_stopped_with_its_reason_and_not_interrupted(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    desk, stop, written = Desk(), StopFlag(), []
    desk.open(["one"], {}, lambda kind, **told: written.append(told["text"]), stop)
    with ControlPort(running, desk, written.append):
        assert launcher.stop("Anna: enough") == ASKED
    assert (written, stop.requested) == (["Anna: enough"], True)
    assert started[0].signals == []
    until(lambda: not (running / INTERRUPTED_BY).exists(), "the note to be taken away")


def test_a_run_that_has_said_that_it_stops_and_runs_on_is_interrupted(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    desk = Desk()
    desk.open(["one"], {}, lambda kind, **told: None, StopFlag())
    with ControlPort(running, desk, lambda why: None):
        assert [launcher.stop("Anna"), launcher.stop("Anna")] == [ASKED, ENDING]
    assert started[0].signals == [signal.SIGINT]


def test_a_run_that_took_a_stop_by_the_stream_is_ending(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    present = launcher.present()
    assert present is not None
    present.asked = True
    assert launcher.stop("Anna") == ENDING
    assert started[0].signals == [signal.SIGINT]


def test_a_run_without_a_control_port_is_interrupted_at_once(
    launcher: Launcher, started: list[Process]
) -> None:
    assert launcher.stop("Anna") == ""
    launcher.start("leaks", "Anna")
    assert launcher.stop("Anna") == INTERRUPTED
    assert started[0].signals == [signal.SIGINT]
    started[0].exit_code = 130
    launcher.look()
    assert launcher.content()["last"]["reason"] == "stopped by Anna before it began"


def test_a_run_that_is_gone_on_with_says_nothing_of_what_it_said_before(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    begun = {"kind": "begin", "campaign": "leaks", "given": None}
    (running / "journal.jsonl").write_text(json.dumps(begun) + "\n")
    assert launcher.content()["last"]["said"] == "is wrong"
    started[0].exit_code = 3
    launcher.look()
    log = running.with_name(f"{running.name}.console.log")
    with log.open("ab") as output:
        output.write(b"[2/2] leak: tripped after 3 s\n")
    launcher.go_on(running.name, "Bo")
    log.write_bytes(log.read_bytes()[: -len(b"rig: it\nis wrong\n")])  # it has said nothing yet
    assert launcher.content()["last"]["said"] == ""


def test_a_run_that_takes_no_requests_is_interrupted(
    launcher: Launcher, started: list[Process], running: Path
) -> None:
    with ControlPort(running, Desk(), lambda why: None):
        assert launcher.stop("Anna: enough") == INTERRUPTED
    assert started[0].signals == [signal.SIGINT]
    assert interrupted_by(running) == "Anna: enough"


def test_a_run_that_hangs_is_interrupted(
    launcher: Launcher,
    started: list[Process],
    running: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.console.launcher.ASK_S", 0.05)
    with socket.socket(socket.AF_UNIX) as listener:
        monkeypatch.chdir(running)
        listener.bind(SOCKET)
        listener.listen(1)  # and never answers
        assert launcher.stop("Anna") == INTERRUPTED
    assert started[0].signals == [signal.SIGINT]


@pytest.mark.parametrize("how", ["fails", "hangs"])
def test_whatever_comes_of_asking_the_run_is_interrupted(
    launcher: Launcher,
    started: list[Process],
    running: Path,
    monkeypatch: pytest.MonkeyPatch,
    how: str,
) -> None:
    released = threading.Event()

    def ask(*_: object, **__: object) -> None:
        if how == "hangs":  # as a disk that does not answer: no timeout of the socket ends it
            released.wait(30)
        raise RuntimeError(how)

    monkeypatch.setattr("rig.console.launcher.ask", ask)
    monkeypatch.setattr("rig.console.launcher.ASK_S", 0.05 if how == "hangs" else 30.0)
    try:
        assert launcher.stop("Anna") == INTERRUPTED
        assert started[0].signals == [signal.SIGINT]
    finally:
        released.set()


def test_away_from_the_rigs_machine_nothing_is_started(tmp_path: Path) -> None:
    launcher = Launcher(Served(offers_of([]), tmp_path), print)
    assert launcher.content()["offers"] == []
    with pytest.raises(LaunchRefused, match="on the rig's own machine"):
        launcher.start("quickstart", "Anna")
