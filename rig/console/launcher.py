"""Starts campaigns that were offered, and goes on with runs that were stopped.

Each is a `rig run` in a process of its own, which outlives the console; what it prints goes to a
file beside the run's folder. Only what was offered can be started: no path comes from the page.
"""

import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from rig.configuration import ConfigError, Problem, Sources, shipped_config_dir
from rig.control_socket import ask

JOURNAL: Final = "journal.jsonl"
MOST_RUNS: Final = 8
"""Unfinished runs that are offered, the newest."""
TAIL_BYTES: Final = 1 << 20
"""How much of a journal's end is read: its last line begins within. A first line is no longer,
either."""
LOG_BYTES: Final = 2000
ASK_S: Final = 1.0
"""How long a run may take to say that it stops, before it is interrupted."""
ASKED: Final = "asked to stop"
INTERRUPTED: Final = "interrupted"
ENDING: Final = "ending since the stop before, and interrupted as well"
ENDINGS: Final = {
    0: "all as expected",
    1: "a test failed or was skipped",
    2: "bad input",
    3: "tripped or stopped",
}

Open = Callable[..., "subprocess.Popen[bytes]"]


class LaunchRefused(Exception):  # noqa: N818 (a refusal, not a failure)
    """A campaign that is not started; says why."""


@dataclass(frozen=True)
class Offer:
    """A campaign that may be started.

    Attributes:
        reference: as `rig run` takes it.
        name: of the campaign; what the page asks for.
        description: in a line.
        rig: that it names.
        tests: how many, a matrix counted once.
    """

    reference: str
    name: str
    description: str
    rig: str
    tests: int


@dataclass
class Launched:
    """A process that was started here.

    Attributes:
        name: of the campaign, or of the folder gone on with.
        folder: of the run.
        rig: id of the rig it is on, as far as that is known; else empty.
        process: `rig run`.
        log: what it prints.
        started_ns: wall clock, ns since 1970.
        exit_code: None while it runs.
        asked: whether it has said that it stops.
    """

    name: str
    folder: Path
    rig: str
    process: "subprocess.Popen[bytes]"
    log: Path
    started_ns: int = field(default_factory=time.time_ns)
    exit_code: int | None = None
    asked: bool = False


def offers_of(references: Sequence[str]) -> tuple[Offer, ...]:
    """Return the campaigns in files, folders and among the shipped; all the shipped if none.

    Raises:
        ConfigError: every one that cannot be read.
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
    """Starts runs below a folder.

    Args:
        offers: what may be started.
        folder: in which each run gets a folder of its own.
        profile: of the stream that the runs are to have; empty: nothing may be started.
        rig: on which they run, instead of the campaign's own.
        say: is called with a sentence on what was started and how it ended.
        popen: starts a process.
    """

    def __init__(
        self,
        offers: Sequence[Offer],
        folder: Path,
        profile: str,
        rig: str | None,
        say: Callable[[str], None],
        popen: Open = subprocess.Popen,
    ) -> None:
        self.offers = {offer.name: offer for offer in offers}
        # Absolute: no folder's name is taken for an option of the command that is given it.
        self._folder = folder.absolute()
        self._profile = profile
        self._rig = rig
        self._say = say
        self._popen = popen
        self._launched: list[Launched] = []

    def start(self, name: str) -> None:
        """Start a campaign that is offered, in a new folder.

        Raises:
            LaunchRefused: it is not offered, or another one runs.
        """
        self._require_idle()
        offer = self.offers.get(name)
        if offer is None:
            raise LaunchRefused("this campaign is not offered")
        stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:80].strip("._-") or "run"
        folder = self._folder / f"{stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        rig = [] if self._rig is None else ["--rig", self._rig]
        on = Path(self.rig_of(name)).stem
        self._run(name, folder, on, [offer.reference, *rig, "--out", str(folder)])

    def go_on(self, name: str) -> None:
        """Go on with a run that is offered, by its folder's name.

        Raises:
            LaunchRefused: it is not offered, or another one runs.
        """
        self._require_idle()
        if name not in {run["folder"] for run in self.unfinished()}:
            raise LaunchRefused("there is no such unfinished run")
        folder = self._folder / name
        self._run(name, folder, self._rig_of_run(folder), [str(folder), "--resume"])

    def rig_of(self, name: str) -> str:
        """Return the rig on which an offered campaign runs; empty if there is no such offer."""
        offer = self.offers.get(name)
        return "" if offer is None else self._rig or offer.rig

    def _rig_of_run(self, folder: Path) -> str:
        """Return the id of the rig that a run is on, by its journal; empty if that is not known."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            with (folder / JOURNAL).open("rb") as file:
                begun = json.loads(file.readline(TAIL_BYTES))
            given = (begun.get("given") or {}).get("rig")
            offer = self.offers.get(str(begun["campaign"]))
            return Path(str(given or (offer.rig if offer else ""))).stem
        return ""

    def present(self) -> Launched | None:
        """Return what was started here and runs; None if nothing does."""
        running = [launched for launched in self._launched if launched.exit_code is None]
        return running[-1] if running else None

    def under_way(self) -> str:
        """Return the name of the folder of what runs here; empty if nothing does."""
        running = self.present()
        return "" if running is None else running.folder.name

    def stop(self, said: str) -> str:
        """Stop what runs here, and return how; empty if nothing runs.

        Its control port is asked first: then its journal shows who stopped it and why (`ASKED`).
        Where that does not take it within `ASK_S`, the process is interrupted, as by Ctrl-C
        (`INTERRUPTED`); so is one that has taken a stop before and still runs (`ENDING`).

        Args:
            said: who stops it, and why.
        """
        done = ""
        for launched in [each for each in self._launched if each.exit_code is None]:
            if not launched.asked and _takes_a_stop(launched.folder, said):
                launched.asked = True
                done = done or ASKED
                continue
            with suppress(ProcessLookupError):
                launched.process.send_signal(signal.SIGINT)
            done = done or ENDING if launched.asked else INTERRUPTED
        return done

    def was_stopped(self, folder: str) -> None:
        """Take note that the run in a folder of this name has taken a stop, by whatever way."""
        for launched in self._launched:
            if launched.folder.name == folder:
                launched.asked = True

    def look(self) -> None:
        """Take note of what has ended."""
        for launched in self._launched:
            if launched.exit_code is None:
                launched.exit_code = launched.process.poll()
                if launched.exit_code is not None:
                    self._say(f"{launched.name} has ended: {_ending(launched)}")

    def content(self) -> dict[str, Any]:
        """Return what may be started, what may be gone on with, and what runs here."""
        last = self._launched[-1] if self._launched else None
        offers = [
            {"name": offer.name, "description": offer.description, "tests": offer.tests,
             "rig": self._rig or offer.rig}
            for offer in self.offers.values()
        ]  # fmt: skip
        return {
            "allowed": bool(self._profile),
            "offers": offers if self._profile else [],
            "unfinished": self.unfinished() if self._profile else [],
            "last": None if last is None else _content(last),
        }

    def unfinished(self) -> list[dict[str, str]]:
        """Return the newest runs that were stopped or killed."""
        journals = sorted(self._folder.glob(f"*/{JOURNAL}"), key=_modified, reverse=True)
        found: list[dict[str, str]] = []
        for journal in journals[:50]:
            campaign = _unfinished_campaign(journal)
            if campaign is not None and len(found) < MOST_RUNS:
                found.append({"folder": journal.parent.name, "campaign": campaign})
        return found

    def _require_idle(self) -> None:
        self.look()
        if not self._profile:
            raise LaunchRefused("runs are started on the rig's own machine only")
        if any(launched.exit_code is None for launched in self._launched):
            raise LaunchRefused("a campaign that was started here still runs")

    def _run(self, name: str, folder: Path, rig: str, arguments: Sequence[str]) -> None:
        log = folder.with_name(f"{folder.name}.console.log")
        whole = ["run", *arguments, "--pace", "real", "--stream", self._profile]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with log.open("ab") as output:
                process = self._popen(
                    [sys.executable, "-m", "rig.cli", *whole],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    # A console that is ended with Ctrl-C ends no campaign.
                    start_new_session=True,
                )
        except OSError as error:
            raise LaunchRefused(f"it cannot be started: {error.strerror or error}") from None
        self._launched.append(Launched(name, folder, rig, process, log))
        del self._launched[:-20]


def _takes_a_stop(folder: Path, said: str) -> bool:
    """Return whether the run in a folder says within `ASK_S` that it stops; whatever happens."""
    answers: SimpleQueue[bool] = SimpleQueue()

    def asking() -> None:
        taken = False
        with suppress(Exception):  # whatever it is, the signal is left
            ask(folder, "abort", said, wait_s=ASK_S)
            taken = True
        answers.put(taken)

    # In a thread: opening the folder of a disk that hangs is waited for no longer than the answer.
    with suppress(Empty, RuntimeError):
        threading.Thread(target=asking, name="stop", daemon=True).start()
        return answers.get(timeout=ASK_S)
    return False


def _content(launched: Launched) -> dict[str, Any]:
    ended = launched.exit_code is not None
    return {
        "name": launched.name,
        "folder": launched.folder.name,
        "started_ms": launched.started_ns // 10**6,
        "exit_code": launched.exit_code,
        "ending": _ending(launched) if ended else "",
        "reason": _reason(launched) if ended else "",
        "said": "" if ended else (_last_lines(launched.log) or [""])[-1],
    }


def _ending(launched: Launched) -> str:
    code = launched.exit_code
    if code is not None and code < 0:
        return f"killed by {signal.Signals(-code).name}"
    text = f"exit code {code}, {ENDINGS.get(code or 0, 'crashed')}"
    reason = _reason(launched)
    return f"{text}: {reason}" if reason else text


def _reason(launched: Launched) -> str:
    """Return why a run ended that did not come to its end: by its journal, else by what it said."""
    end = _last_entry(launched.folder / JOURNAL)
    if end.get("kind") == "end" and end.get("exit_code") == launched.exit_code:
        return str(end.get("reason") or "")[:LOG_BYTES]
    return " ".join(_last_lines(launched.log)) if launched.exit_code else ""


def _last_lines(log: Path) -> list[str]:
    """Return what a run printed last, without what only draws: each line on one, the last last."""
    with suppress(OSError), log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LOG_BYTES))
        lines = file.read().decode(errors="replace").splitlines()
        return [" ".join(line.split()) for line in lines if line.strip()]
    return []


def _modified(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _unfinished_campaign(journal: Path) -> str | None:
    """Return the campaign of a run that can be gone on with; None of any other."""
    with suppress(OSError, ValueError, KeyError, TypeError), journal.open("rb") as file:
        begun = json.loads(file.readline(TAIL_BYTES))
        last = _last_entry(journal)
        if begun["kind"] == "begin" and not (last.get("kind") == "end" and not last["reason"]):
            return str(begun["campaign"])[:100]
    return None


def _last_entry(journal: Path) -> Mapping[str, Any]:
    """Return the last whole entry of a journal; empty if there is none."""
    with suppress(OSError), journal.open("rb") as file:
        file.seek(max(0, journal.stat().st_size - TAIL_BYTES))
        for line in reversed(file.read().splitlines()):
            with suppress(ValueError):
                entry = json.loads(line)
                return entry if isinstance(entry, dict) else {}
    return {}
