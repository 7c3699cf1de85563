"""The launcher starts offered campaigns, and resumes runs that were stopped or killed.

Each run is a `rig run` in a process of its own, which outlives the console; its output goes to a
file beside the run's folder. Only offered campaigns can be started, so that the page never gives a
path.
"""

import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rig.configuration import ConfigError, Problem, Sources, shipped_config_dir
from rig.control_socket import ControlError, ask, interrupted_by, note_interruption

from .past_runs import JOURNAL, PastRuns, ends_of, past_runs

LOG_BYTES: Final = 2000
ASK_S: Final = 1.0
"""Time in s within which a run must accept a stop on its control port; then it is interrupted."""
ACKNOWLEDGE_S: Final = 30.0
"""Time in s within which a run's journal must take an acknowledgement, by a program of its own."""
SET_S: Final = 5.0
"""Time in s within which a run must answer a request to set its control."""
ASKED: Final = "asked to stop"
INTERRUPTED: Final = "interrupted"
ENDING: Final = "ending since the stop before, and interrupted as well"
ENDINGS: Final = {
    0: "all as expected",
    1: "a test failed or was skipped",
    2: "bad input",
    3: "tripped or stopped",
}


class LaunchRefused(Exception):  # noqa: N818 (a refusal, not a failure)
    """The error of a campaign that is not started, or not resumed; its message is the reason."""


@dataclass(frozen=True)
class Offer:
    """A campaign that may be started.

    Attributes:
        reference: path or name of the campaign, as `rig run` takes it.
        name: name of the campaign, by which the page asks for it.
        description: description on one line, at most 200 characters.
        rig: path or name of the rig in the campaign's file.
        tests: number of tests in the file; a matrix counts as one.
    """

    reference: str
    name: str
    description: str
    rig: str
    tests: int


@dataclass(frozen=True)
class Served:
    """The settings by which a console starts campaigns.

    Attributes:
        offers: campaigns that may be started.
        folder: folder below which their runs are written.
        profile: profile of the runs' live stream; if empty, nothing may be started.
        rig: path or name of the rig on which they run; None for each campaign's own.
    """

    offers: tuple[Offer, ...] = ()
    folder: Path = Path("runs")
    profile: str = ""
    rig: str | None = None


@dataclass
class Launched:
    """A run that this console started.

    Attributes:
        name: name of the campaign.
        folder: folder of the run.
        rig: id of the rig that it runs on; empty if that is not known.
        process: the process of `rig run`.
        log: file that takes the process's output.
        started_ns: wall clock at its start, ns since 1970.
        exit_code: exit code of the process; None while it runs.
        asked: whether the run has accepted a stop.
        stopped: who has stopped it, by asking or by interrupting it, and why; empty if nobody has.
        heard: whether its stream has told of it.
        log_begins: size of the output's file as the run began, which may go on with an older one.
        resumed: whether it goes on with a run that was begun before.
    """

    name: str
    folder: Path
    rig: str
    process: "subprocess.Popen[bytes]"
    log: Path
    started_ns: int = field(default_factory=time.time_ns)
    exit_code: int | None = None
    asked: bool = False
    stopped: str = ""
    heard: bool = False
    log_begins: int = 0
    resumed: bool = False


def offers_of(references: Sequence[str]) -> tuple[Offer, ...]:
    """Return the offered campaigns, sorted by name.

    Args:
        references: paths of campaign files, folders with such files, or names of shipped campaigns.
            If there are none, all shipped campaigns are offered.

    Raises:
        ConfigError: lists every reference that does not exist; or else every file that cannot be
            read, and every name that occurs twice.
    """
    shipped = shipped_config_dir() / "campaigns"
    found: dict[str, Offer] = {}
    problems = []
    for path in _files(references or [str(shipped)], shipped):
        sources = Sources()
        root = sources.read_yaml(path)
        problems += sources.problems.found
        if root is None:
            continue
        given = {key: root.get(key) for key in ("name", "description", "rig", "tests")}
        values = {key: item.value for key, item in given.items() if item is not None}
        name = str(values.get("name") or path.stem)
        tests = values.get("tests")
        if name in found:
            problems.append(_problem(path, f"{name} is there twice", "give each another name"))
        reference = path.stem if path.parent == shipped else str(path.resolve())
        rig, description = str(values.get("rig", "")), str(values.get("description", ""))
        count = len(tests) if isinstance(tests, list) else 0
        found[name] = Offer(reference, name, " ".join(description.split())[:200], rig, count)
    if problems:
        raise ConfigError(problems)
    return tuple(sorted(found.values(), key=lambda offer: offer.name))


def _files(references: Sequence[str], shipped: Path) -> list[Path]:
    found, problems = [], []
    for reference in references:
        path = Path(reference)
        if path.is_dir():
            found += sorted(file for file in path.iterdir() if file.suffix in (".yaml", ".yml"))
        elif path.is_file():
            found.append(path)
        elif (shipped / f"{reference}.yaml").is_file() and "/" not in reference:
            found.append(shipped / f"{reference}.yaml")
        else:
            remedy = "give a file, a folder of campaigns, or a shipped name"
            problems.append(_problem(path, "does not exist", remedy))
    if problems:
        raise ConfigError(problems)
    return found


def _problem(path: Path, limit: str, remedy: str) -> Problem:
    return Problem(str(path), 0, 0, "campaign", "", limit, remedy)


class Launcher:
    """A launcher of runs, whose folders are made below one folder.

    Args:
        served: which campaigns may be started, and how.
        say: is called with a sentence on each run that has ended.
    """

    def __init__(self, served: Served, say: Callable[[str], None]) -> None:
        self.offers = {offer.name: offer for offer in served.offers}
        # The path is absolute so that a folder such as "-x" is not read as a command-line option.
        self._folder = served.folder.absolute()
        self._profile = served.profile
        self._rig = served.rig
        self._say = say
        self._last: Launched | None = None
        """The run that was started last; all earlier ones have ended."""

    def start(self, name: str, by: str) -> None:
        """Start an offered campaign, by its name, in a new folder; do not wait for its end.

        Args:
            name: name of the campaign.
            by: who starts it, for the run's journal.

        Raises:
            LaunchRefused: the campaign is not offered, nothing may be started here, another run
                that was started here is still going on, or the process cannot be started.
        """
        self._require_idle()
        offer = self.offers.get(name)
        if offer is None:
            raise LaunchRefused("this campaign is not offered")
        stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:80].strip("._-") or "run"
        folder = self._folder / f"{stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        rig = [] if self._rig is None else ["--rig", self._rig]
        on = Path(self.rig_of(name)).stem
        self._run(name, folder, on, [offer.reference, *rig, "--out", str(folder), f"--by={by}"])

    def go_on(self, name: str, by: str) -> None:
        """Resume one of the unfinished `past_runs`, which is given by its folder's name.

        `by` is who goes on with it, for the run's journal.

        If another process is running in the folder, the started one is refused the lock on the
        journal, touches nothing, and ends with exit code 2, which `look` reports.

        Raises:
            LaunchRefused: there is no such unfinished run, nothing may be started here, another run
                that was started here is still going on, or the process cannot be started.
        """
        self._require_idle()
        unfinished = past_runs(self._folder).unfinished
        campaigns = {run["folder"]: run["campaign"] for run in unfinished}
        if name not in campaigns:
            raise LaunchRefused("there is no such unfinished run")
        folder = self._folder / name
        arguments = [str(folder), "--resume", f"--by={by}"]
        self._run(campaigns[name], folder, self._rig_of_run(folder), arguments, resumed=True)

    def acknowledge(self, name: str, text: str, by: str) -> None:
        """Have a run that has ended keep in its journal that somebody has seen how it ended.

        Args:
            name: name of the run's folder, one of the unseen `past_runs`.
            text: a remark; may be empty.
            by: who has seen it.

        Raises:
            LaunchRefused: there is no such run, or its journal cannot be written.
        """
        if name not in {run["folder"] for run in past_runs(self._folder).unseen}:
            raise LaunchRefused("there is no run of this name that wants to be acknowledged")
        words = ["control", str(self._folder / name), "acknowledge", f"--by={by}"]
        command = [sys.executable, "-m", "rig.cli", *words, *(["--", text] if text else [])]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=ACKNOWLEDGE_S,
                check=False,
            )  # fmt: skip
        except (OSError, subprocess.SubprocessError) as error:
            raise LaunchRefused(f"it cannot be recorded: {error}") from None
        if done.returncode:
            last = done.stderr.decode(errors="replace").splitlines()[-1:] or ["no reason is given"]
            raise LaunchRefused(f"it cannot be recorded: {last[0]}")

    def set_control(self, name: str, text: str, by: str) -> None:
        """Change the control of the test that runs, as `rig control DIR set` does.

        Args:
            name: name of the run's folder, which lies directly below the launcher's.
            text: what is set, such as "gain=80 V/m".
            by: who sets it, for the run's journal.

        Raises:
            LaunchRefused: there is no such run here, or it refuses, with its reason.
        """
        folder = self._folder / name
        if not name or Path(name).name != name or not (folder / JOURNAL).is_file():
            raise LaunchRefused("control can be set of runs in this console's folder only")
        try:
            ask(folder, "set", text, wait_s=SET_S, person=by)
        except ControlError as error:
            raise LaunchRefused("; ".join(error.problems)) from None

    @property
    def may_start(self) -> bool:
        """Whether campaigns may be started here."""
        return bool(self._profile)

    def to_check(self, name: str) -> list[str] | None:
        """Return an offered campaign with its options as `rig check` takes them; None if not."""
        offer = self.offers.get(name)
        if offer is None or not self.may_start:
            return None
        return [offer.reference, *([] if self._rig is None else ["--rig", self._rig])]

    def rig_of(self, name: str) -> str:
        """Return path or name of the rig on which a campaign would run; "" if it is not offered."""
        offer = self.offers.get(name)
        return "" if offer is None else self._rig or offer.rig

    def _rig_of_run(self, folder: Path) -> str:
        """Return the id of a run's rig by the first line of its journal; "" if it is not known."""
        begun = ends_of(folder / JOURNAL).begun
        given = begun.get("given")
        given = given if isinstance(given, dict) else {}
        offer = self.offers.get(str(begun.get("campaign")))
        return Path(str(given.get("rig") or (offer.rig if offer else ""))).stem

    def present(self) -> Launched | None:
        """Return the run that was started here and had not ended at the last `look`, or None."""
        last = self._last
        return last if last is not None and last.exit_code is None else None

    def under_way(self) -> str:
        """Return the name of the folder of the run that `present` returns; "" if it is None."""
        running = self.present()
        return "" if running is None else running.folder.name

    def stop(self, said: str, by: str = "") -> str:
        """Stop the run that was started here; return by which way, or "" if none is going on.

        Its control port is asked first, so that its journal records who stopped it and why
        (`ASKED`). If the port does not accept the stop within `ASK_S`, the process is interrupted,
        as by Ctrl-C (`INTERRUPTED`). A run that accepted a stop before and still runs is
        interrupted too (`ENDING`).

        Args:
            said: text for the journal: who stops the run, and why.
            by: who stops it.
        """
        running = self.present()
        if running is None:
            return ""
        running.stopped = said
        if not running.asked and _takes_a_stop(running.folder, said, by):
            running.asked = True
            return ASKED
        with suppress(ProcessLookupError):
            running.process.send_signal(signal.SIGINT)
        return ENDING if running.asked else INTERRUPTED

    def look(self) -> None:
        """Check whether the run that was started here has ended; report that once by `say`."""
        running = self.present()
        if running is not None:
            running.exit_code = running.process.poll()
            if running.exit_code is not None:
                self._say(f"{running.name} has ended: {_ending(running)}")

    def content(self) -> dict[str, Any]:
        """Return the offers, past runs by kind (`PastRuns`), and the run started last, as JSON.

        If nothing may be started here, offers and past runs are empty.
        """
        allowed = bool(self._profile)
        past = past_runs(self._folder) if allowed else PastRuns([], [], [])
        offers = [
            {"name": offer.name, "description": offer.description, "tests": offer.tests,
             "rig": self._rig or offer.rig}
            for offer in self.offers.values() if allowed
        ]  # fmt: skip
        return {
            "allowed": allowed,
            "offers": offers,
            "unfinished": past.unfinished,
            "unseen": [
                run | {"on": self._rig_of_run(self._folder / run["folder"])} for run in past.unseen
            ],
            "seen": past.seen,
            "last": None if self._last is None else _content(self._last),
        }

    def _require_idle(self) -> None:
        self.look()
        if not self._profile:
            raise LaunchRefused("runs are started on the rig's own machine only")
        if self.present() is not None:
            raise LaunchRefused("a campaign that was started here still runs")

    def _run(
        self, name: str, folder: Path, rig: str, arguments: Sequence[str], *, resumed: bool = False
    ) -> None:
        log = folder.with_name(f"{folder.name}.console.log")
        whole = ["run", *arguments, "--pace", "real", "--stream", self._profile]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with log.open("ab") as output:
                begins = output.tell()
                process = subprocess.Popen(
                    [sys.executable, "-m", "rig.cli", *whole],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    # In a session of its own, the campaign survives a Ctrl-C that ends the console.
                    start_new_session=True,
                )
        except OSError as error:
            raise LaunchRefused(f"it cannot be started: {error.strerror or error}") from None
        self._last = Launched(name, folder, rig, process, log, log_begins=begins, resumed=resumed)


def _takes_a_stop(folder: Path, said: str, by: str) -> bool:
    """Ask the run in a folder to stop; return whether it accepts that within `ASK_S`.

    Args:
        folder: folder of the run.
        said: text for the journal: who stops the run, and why.
        by: who stops it.

    Returns:
        Whether the run has accepted the stop; False after any error.
    """
    taken = threading.Event()

    def asking() -> None:
        with suppress(Exception):  # after any error the caller sends a signal instead
            # A run that is interrupted reads there who has done that, for its journal.
            note_interruption(folder, said)
            ask(folder, "abort", said, wait_s=ASK_S, person=by)
            taken.set()
            interrupted_by(folder)  # it has taken the stop, so that nobody need interrupt it

    # It asks in a thread, so that a disk that hangs delays the stop by no more than `ASK_S`.
    thread = threading.Thread(target=asking, name="stop", daemon=True)
    with suppress(RuntimeError):
        thread.start()
        thread.join(ASK_S)
    return taken.is_set()


def _content(launched: Launched) -> dict[str, Any]:
    ended = launched.exit_code is not None
    return {
        "name": launched.name,
        "folder": launched.folder.name,
        "resumed": launched.resumed,
        "on": launched.rig,
        "heard": launched.heard,
        "stopped": launched.stopped,
        "started_ms": launched.started_ns // 10**6,
        "exit_code": launched.exit_code,
        "ending": _ending(launched) if ended else "",
        "reason": _reason(launched) if ended else "",
        "said": "" if ended else (_last_lines(launched) or [""])[-1],
    }


def killed_by(code: int | None) -> str:
    """Return by which signal a process was killed, in words; "" if its exit code tells of none."""
    return f"killed by {signal.Signals(-code).name}" if code is not None and code < 0 else ""


def _ending(launched: Launched) -> str:
    code = launched.exit_code
    if killed := killed_by(code):
        return killed
    text = f"exit code {code}, {ENDINGS.get(code or 0, 'crashed')}"
    reason = _reason(launched)
    return f"{text}: {reason}" if reason else text


def _reason(launched: Launched) -> str:
    """Return why a run ended early, by its journal, else by its last output; "" if it did not."""
    end = ends_of(launched.folder / JOURNAL).last
    if end.get("kind") == "end" and end.get("exit_code") == launched.exit_code:
        return str(end.get("reason") or "")[:LOG_BYTES]
    if launched.exit_code and launched.stopped:
        return f"stopped by {launched.stopped} before it began"
    return " ".join(_last_lines(launched)) if launched.exit_code else ""


def _last_lines(launched: Launched) -> list[str]:
    """Return the non-empty lines in the last `LOG_BYTES` of a run's output, with single spaces.

    The oldest comes first; [] if the output cannot be read. What an earlier part of a run that is
    gone on with has printed is not among them.
    """
    log = launched.log
    with suppress(OSError), log.open("rb") as file:
        file.seek(max(launched.log_begins, log.stat().st_size - LOG_BYTES))
        lines = file.read().decode(errors="replace").splitlines()
        return [" ".join(line.split()) for line in lines if line.strip()]
    return []
