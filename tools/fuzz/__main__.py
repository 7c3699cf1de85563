"""Fuzzes all readers of files and protocols, guided by coverage, and keeps what it finds.

Run as `python -m tools.fuzz [--minutes M] [--seed S] [--out DIR] [TARGET ...]`. The time is shared
equally among the targets. It needs atheris (`pip install hydraulic-rig[fuzz]`; `make fuzz` sees to
it). The exit code is the number of finds.
"""

import argparse
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .guides import GUIDES

ROOT: Final = Path(__file__).parents[2]
START_S: Final = 120.0
"""s that a target's process may take beyond its time, for loading and compiling."""
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


def fuzzed(name: str, folder: Path, seconds: float, seed: int) -> Fuzzed:
    """Fuzz a target for some time, and return what came of it; finds are kept in its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    scratch = folder / "scratch"
    scratch.mkdir(exist_ok=True)
    log = folder / "log.txt"
    arguments = [name, str(folder), f"{seconds:.0f}", str(seed)]
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    with log.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "tools.fuzz.guided", *arguments],
            env=os.environ | {"TMPDIR": str(scratch), "PYTHONPATH": paths},
            stdout=file,
            stderr=subprocess.STDOUT,
        )
        try:
            code = process.wait(seconds + START_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
    told = log.read_text(errors="replace")
    finds = [
        f"{path.with_suffix('')}: {path.read_text().strip()}"
        for path in sorted(folder.glob("find-*.txt"))
    ]
    ended = [str(path) for path in sorted(folder.glob("*-*")) if _ended_by(path)]
    finds += [f"{path}: hung, or took too much memory" for path in ended]
    runs, covered = _RUNS.search(told), _COVERED.findall(told)
    if code and not ended:
        finds.append(f"{log}: the process ended with {code}: {told.strip()[-300:]}")
    return Fuzzed(name, int(runs[1]) if runs else 0, int(covered[-1]) if covered else 0, (*finds,))


def _ended_by(path: Path) -> bool:
    return path.name.startswith(("timeout-", "oom-", "crash-", "leak-"))


def main() -> int:
    """Fuzz the targets that are asked for; return the number of finds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="for all targets together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz"), help="folder for finds")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(GUIDES))
    given = parser.parse_args()
    unknown = set(given.targets) - set(GUIDES)
    if unknown:
        parser.error(f"no such target: {', '.join(sorted(unknown))}; there are {', '.join(GUIDES)}")
    names = given.targets or list(GUIDES)
    seconds = 60.0 * given.minutes / len(names)
    finds = runs = 0
    for name in names:
        result = fuzzed(name, given.out / name, seconds, given.seed)
        print(result, flush=True)
        finds, runs = finds + len(result.finds), runs + result.runs
    print(f"{runs} inputs, {finds} found")
    return min(finds, 100)


if __name__ == "__main__":
    sys.exit(main())
