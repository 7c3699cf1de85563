"""Tries one failure after another on the simulated rig, and says of each what came of it."""

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from .injection import Order, Site
from .judging import ENDINGS, Ended, problems_of, rows_of
from .simulated import CAMPAIGN, Runner, arguments_of, in_fork, in_process

_OUT_OF_MEMORY: Final = "OpenBLAS error: Memory allocation"
"""What numpy's library of linear algebra prints before it ends the process with exit code 1."""
RECORDINGS: Final = ("one.mcap", "two.mcap")


@dataclass(frozen=True)
class Tried:
    """What came of a failure.

    Attributes:
        name: what failed.
        group: what it is counted with in the table: kind of call, or `memory`.
        process: the process in which it failed.
        exit_code: exit code of the run; None if it hung.
        resumed: exit code of `--resume`, or of a run anew where there is nothing to resume; None
            where the run had come to its end by itself.
        told: last line that the run printed.
        problems: in which points it was not as it should be.
        killed: whether a library ended the run for want of memory.
    """

    name: str
    group: str
    process: str
    exit_code: int | None
    resumed: int | None
    told: str
    problems: tuple[str, ...]
    killed: bool = False


class SimulatedTrials:
    """A folder in which a campaign is run again and again on the simulated rig.

    Args:
        folder: an empty folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._campaign = folder / "campaign.yaml"
        self._campaign.write_text(CAMPAIGN)
        self._out, self._printed = folder / "out", folder / "printed.txt"
        self._notes = folder / "notes.jsonl"
        self._rows: dict[str, int] = {}

    def sites(self) -> tuple[dict[Site, int], dict[Site, int]]:
        """Return how often a run reaches each site: a warm process, and those of loading only.

        Raises:
            RuntimeError: an untroubled run does not pass.
        """
        cold = self._reached(in_process)
        load_everything(self._campaign, self._folder / "loaded", self._folder / "loading.txt")
        warm = self._reached(in_fork)
        return warm, {site: count for site, count in cold.items() if site not in warm}

    def _reached(self, runner: Runner) -> dict[Site, int]:
        self._clear()
        ended = self._run(runner, Order(str(self._notes)))
        self._rows = {name: rows_of(self._out / name) or 0 for name in RECORDINGS}
        if ended.exit_code or problems_of(ended, self._out, self._rows):
            raise RuntimeError(f"an untroubled run ended with {ended.exit_code}: {ended.printed}")
        return Counter(site for site, _ in noted(self._notes))

    def tried(self, site: Site, after: int = 0, *, cold: bool = False) -> Tried | None:
        """Let a site fail, go on with the run, and return what came of it.

        It is None if the site was not reached as often this time, as threads differ in that.

        Args:
            site: the site.
            after: how often it is reached before it fails.
            cold: whether it is reached only in a process that has to load everything.
        """
        runner: Runner = in_process if cold else in_fork
        self._clear()
        ended = self._run(runner, Order(str(self._notes), site, after))
        found = problems_of(ended, self._out, self._rows)
        if not any(fails for _, fails in noted(self._notes)):
            if after:
                return None
            found.append("it was not reached")
        return self._gone_on(named(site, after), site.kind, ended, found)

    def with_address_space(self, limit: int) -> Tried:
        """Run with a limit on the address space, in bytes, go on without, and return what came."""
        self._clear()
        ended = self._run(in_process, Order(str(self._notes), None, 0, limit))
        ended = without_aborts(ended)
        found = problems_of(ended, self._out, self._rows)
        return self._gone_on(of_address_space(limit), "memory", ended, found)

    def _gone_on(self, name: str, group: str, ended: Ended, found: list[str]) -> Tried:
        resumed: Ended | None = None
        if ended.exit_code:
            begun = (self._out / "journal.jsonl").is_file()
            resumed = self._run(in_fork, None, *(["--resume"] if begun else []))
            if resumed.exit_code == 2 and begun and not _has_begun(self._out):
                # A run whose journal has no line cannot be resumed, and is begun anew.
                resumed = self._run(in_fork, None)
            again = problems_of(resumed, self._out, self._rows)
            if resumed.exit_code != 0:
                again.append(f"exit code {resumed.exit_code}")
            found += [f"after going on: {problem}" for problem in again]
        lines = ended.printed.strip().splitlines()
        code = None if resumed is None else resumed.exit_code
        told = " / ".join(lines[-3:])
        return Tried(
            name, group, "supervisor", ended.exit_code, code, told, tuple(found), ended.killed
        )

    def _run(self, runner: Runner, order: Order | None, *options: str) -> Ended:
        return runner(arguments_of(self._campaign, self._out, *options), order, self._printed)

    def _clear(self) -> None:
        shutil.rmtree(self._out, ignore_errors=True)
        self._notes.unlink(missing_ok=True)


def load_everything(campaign: Path, out: Path, printed: Path) -> None:
    """Run a campaign in this process, so that all that a run loads is there for its forks."""
    from contextlib import redirect_stderr, redirect_stdout

    from rig.cli.application import main

    with printed.open("w") as file, redirect_stdout(file), redirect_stderr(file):
        try:
            main(arguments_of(campaign, out))
        except SystemExit as ended:
            if ended.code:
                raise RuntimeError(f"an untroubled run ended with {ended.code}") from None


def without_aborts(ended: Ended) -> Ended:
    """Return an end in which a kill by a library that found no memory is a plain one.

    The compiler's library aborts a process then, and numpy's ends it. To a run it is what a kill
    of its supervisor is.
    """
    code = ended.exit_code
    aborted = code is not None and code not in ENDINGS
    return replace(ended, killed=aborted or _OUT_OF_MEMORY in ended.printed)


def named(site: Site, after: int) -> str:
    """Return the name of a failure: where, and whether it is not the first time there."""
    return f"{site}{f', time {after + 1}' if after else ''}"


def of_address_space(limit: int) -> str:
    """Return the name of a limit of the address space, in bytes."""
    return f"address space of {limit / 2**20:.0f} MiB"


def noted(notes: Path) -> Iterator[tuple[Site, bool]]:
    """Yield each site in a file of notes, and whether it failed."""
    for line in notes.read_text().splitlines() if notes.exists() else ():
        *site, fails = json.loads(line)
        yield Site(*site), fails


def _has_begun(folder: Path) -> bool:
    return bool((folder / "journal.jsonl").read_bytes())
