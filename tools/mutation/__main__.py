"""Tries the mutants of the code that keeps the rig safe.

Run as `make mutation`, or `NUMBA_DISABLE_JIT=1 python -m tools.mutation [--every N] [NAME ...]`.
A survivor is told with its line; those that do not matter stand with the reason in `harmless.py`.
If all mutants of all modules were tried, the table of docs/safety.md is written.
"""

import argparse
import ast
import os
import sys
import time
from itertools import chain, islice
from pathlib import Path
from typing import Final

from tools.pages.marked_tables import fill, markdown

from .harmless import HARMLESS
from .mutants import Mutant, mutants_of
from .subjects import ROOT, SUBJECTS, Subject
from .trying import prepare, try_all

PAGE: Final = ROOT / "docs" / "safety.md"
LEAST: Final = 0.9
"""Share of the mutants that tests must notice; what does not matter counts as not noticed."""
_HEAD: Final = ("module", "mutants", "noticed", "share", "do not matter", "left")


def main() -> int:
    """Try the mutants that were asked for; return how many modules have too many survivors.

    A survivor without a reason in `HARMLESS` does not make it fail as long as enough are noticed.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.mutation", description=__doc__)
    every = "try one mutant in so many only (default: %(default)s)"
    parser.add_argument("--every", type=int, default=1, help=every)
    modules = f"{', '.join(subject.name for subject in SUBJECTS)} (default: all)"
    parser.add_argument("names", nargs="*", metavar="NAME", help=modules)
    given = parser.parse_args()
    unknown = set(given.names) - {subject.name for subject in SUBJECTS}
    if unknown or given.every < 1:
        parser.error(
            f"no such module: {', '.join(sorted(unknown))}" if unknown else "--every is 1 or more"
        )
    os.chdir(ROOT)
    prepare()
    rows, poor = [], 0
    for subject in SUBJECTS:
        if given.names and subject.name not in given.names:
            continue
        tried, survivors = _try(subject, given.every)
        harmless = [each for each in survivors if each.name in HARMLESS]
        share = 1.0 - len(survivors) / max(tried, 1)
        poor += share < LEAST
        rows.append(
            (
                f"{subject.name}: `{subject.path.relative_to(ROOT)}`", str(tried),
                str(tried - len(survivors)), f"{share:.1%}", str(len(harmless)),
                str(len(survivors) - len(harmless)),
            )
        )  # fmt: skip
    print(markdown(_HEAD, rows))
    if not given.names and given.every == 1:
        fill(PAGE, {"mutation": markdown(_HEAD, rows)})
    return poor


def _try(subject: Subject, every: int) -> tuple[int, list[Mutant]]:
    """Try the mutants of a module; return how many there were, and the survivors."""
    source = subject.path.read_text(encoding="utf-8")
    began_s = time.monotonic()
    mutants = list(islice(mutants_of(source), 0, None, every))
    survivors: list[Mutant] = []
    fails: list[bool] = []

    def found(number: int, noticed: bool) -> None:
        if number == 0:
            fails.append(noticed)
        elif not noticed:
            mutant = mutants[number - 1]
            survivors.append(mutant)
            reason = HARMLESS.get(mutant.name, "")
            print(f"{_place(subject.path)}:{mutant.line}: {mutant.name}  {reason}", flush=True)

    trees = chain([ast.parse(source)], (mutant.tree for mutant in mutants))
    try_all(subject.module, subject.path, trees, subject.tests, found)
    if fails != [False]:
        sys.exit(f"{subject.name}: its tests fail without any change, with the JIT off")
    spent_s = time.monotonic() - began_s
    print(f"{subject.name}: {len(mutants)} mutants in {spent_s:.0f} s, {len(survivors)} survive")
    return len(mutants), survivors


def _place(path: Path) -> str:
    return str(path.relative_to(ROOT))


if __name__ == "__main__":
    sys.exit(main())
