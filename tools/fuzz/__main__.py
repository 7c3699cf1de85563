"""Fuzzes all readers of files and protocols, guided by coverage, and keeps what it finds.

Run as `python -m tools.fuzz [--minutes M] [--seed S] [--out DIR] [TARGET ...]`. The time is shared
equally among the targets. It needs atheris, which `make fuzz` installs. The exit code is the number
of finds.
"""

import argparse
import os
import re
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .guides import GUIDES
from .target import Target

START_S: Final = 600.0
"""s that a target's process may take beyond its time, for compiling and for an input that hangs."""
_POLL_S: Final = 0.1
_RUNS: Final = re.compile(r"stat::number_of_executed_units:\s*(\d+)")
_COVERED: Final = re.compile(r"cov: (\d+)")


@dataclass(frozen=True)
class Fuzzed:
    """What came of a target: inputs that were tried, branches that were taken, and finds."""

    name: str
    runs: int
    covered: int
    finds: tuple[str, ...]

    def __str__(self) -> str:
        finds = "".join(f"\n  FOUND {find}" for find in self.finds)
        return f"{self.name}: {self.runs} inputs, {self.covered} branches{finds}"


def fuzzed(target: Target, folder: Path, seconds: float, seed: int) -> Fuzzed:
    """Fuzz a target for some time in a fork, and return what came of it.

    Finds are kept in its folder; those of an earlier time are removed.
    """
    from .guided import fuzz

    folder.mkdir(parents=True, exist_ok=True)
    for earlier in folder.glob("*-*"):
        if earlier.is_file():
            earlier.unlink()
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        try:
            fuzz(target, folder.absolute(), seconds, seed)
        finally:
            os._exit(70)
    code = _waited(pid, seconds + START_S)
    told = (folder / "log.txt").read_text(errors="replace")
    finds = [
        f"{path.with_suffix('')}: {path.read_text().strip()}"
        for path in sorted(folder.glob("find-*.txt"))
    ]
    ended = [path for path in sorted(folder.glob("*-*")) if _ended_by(path)]
    finds += [f"{path}: hung, or took too much memory" for path in ended]
    runs, covered = _RUNS.search(told), _COVERED.findall(told)
    if code and not ended:
        finds.append(f"the process ended with {code}: {told.strip()[-500:]}")
    return Fuzzed(
        target.name, int(runs[1]) if runs else 0, int(covered[-1]) if covered else 0, (*finds,)
    )


def _waited(pid: int, patience_s: float) -> int:
    """Return the exit code of a child, which is killed after some time."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(_POLL_S)
    os.kill(pid, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _ended_by(path: Path) -> bool:
    return path.name.startswith(("timeout-", "oom-", "crash-", "leak-"))


def main() -> int:
    """Fuzz the targets that are asked for; return the number of finds."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    minutes = "minutes for all targets together (default: %(default)g)"
    parser.add_argument("--minutes", type=float, default=10.0, help=minutes)
    seed = "of what is drawn (default: %(default)s)"
    parser.add_argument("--seed", type=int, default=1, help=seed)
    out = "folder for finds (default: %(default)s)"
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz"), help=out)
    targets_help = f"{', '.join(GUIDES)} (default: all)"
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=targets_help)
    given = parser.parse_args()
    unknown = set(given.targets) - set(GUIDES)
    if unknown:
        parser.error(f"no such target: {', '.join(sorted(unknown))}; there are {', '.join(GUIDES)}")
    from .guided import load

    targets = load()
    names = given.targets or list(GUIDES)
    seconds = 60.0 * given.minutes / len(names)
    finds = runs = 0
    for name in names:
        result = fuzzed(targets[name], given.out / name, seconds, given.seed)
        print(result, flush=True)
        finds, runs = finds + len(result.finds), runs + result.runs
    print(f"{runs} inputs, {finds} found")
    return min(finds, 100)


if __name__ == "__main__":
    sys.exit(main())
