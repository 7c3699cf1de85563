"""Draws cases of two faults, plays them on the emulated rig, and judges them.

Run as `python -m tools.chaos.drawn [--seed S] [--count N] [--first N] [--case N ...]`. Each case
that is played is added to a file, so that the same command goes on after a kill with the next one;
`--case` plays given numbers alone, and adds nothing. With `--list`, cases are told and not played.
"""

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from tools.chaos.signals import end_by_signals
from tools.chaos.stage import StageError
from tools.pages.marked_tables import markdown

from .fault import Case
from .grammar import draw
from .pauses import paused_ns
from .play import Evidence, play
from .verdict import null_ns, violations

RESULTS: Final = Path("runs") / "chaos-drawn"
"""Folder of the files to which cases are added, by seed."""


def main() -> int:
    """Play the cases that were asked for; return how many did not hold."""
    end_by_signals()
    given = _arguments()
    numbers = given.case or range(given.first, given.first + given.count)
    if given.list:
        for number in numbers:
            print(f"{number}: {draw(given.seed, number).name}")
        return 0
    path = given.results or RESULTS / f"seed-{given.seed}.jsonl"
    known = {} if given.case else read_results(path)
    rows = []
    for number in numbers:
        if number not in known:
            case = draw(given.seed, number)
            print(f"{number}: {case.name} ... ", end="", flush=True)
            known[number] = played(case, given.keep)
            print(told(known[number]), flush=True)
            if not given.case:
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(known[number]) + "\n")
        rows.append(known[number])
    print(markdown(*summary(rows)))
    failed = [row["number"] for row in rows if row["violations"]]
    print(f"{len(rows) - len(failed)} of {len(rows)} hold")
    if failed:
        print(f"again: python -m tools.chaos.drawn --seed {given.seed} --case {_listed(failed)}")
    return len(failed)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.chaos.drawn", description=__doc__)
    seed = "what the cases are drawn from (default: %(default)s)"
    parser.add_argument("--seed", type=int, default=1, help=seed)
    count = "number of cases to have played in all (default: %(default)s)"
    parser.add_argument("--count", type=int, default=300, help=count)
    first = "number of the first of them (default: %(default)s)"
    parser.add_argument("--first", type=int, default=1, help=first)
    parser.add_argument("--case", type=int, nargs="+", help="play these numbers alone")
    parser.add_argument("--list", action="store_true", help="tell the cases, and play none")
    parser.add_argument(
        "--results",
        type=Path,
        help=f"file to which cases are added (default: {RESULTS}/seed-SEED.jsonl)",
    )
    parser.add_argument("--keep", type=Path, help="folder for all files of cases that fail")
    return parser.parse_args()


def _listed(numbers: list[int]) -> str:
    return " ".join(map(str, numbers))


def read_results(path: Path) -> dict[int, dict[str, Any]]:
    """Return the cases in a file by number; a last line that a kill cut off is left out."""
    found = {}
    lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
    for line in lines:
        row = json.loads(line)
        found[int(row["number"])] = row
    return found


def played(case: Case, keep: Path | None = None) -> dict[str, Any]:
    """Play a case in a folder of its own; return its row of the results, as JSON values."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rig-drawn-") as folder:
        try:
            evidence = play(case, Path(folder))
        except StageError as error:
            return {"number": case.number, "name": case.name, "violations": [str(error)]}
        found = violations(evidence)
        if found and keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            Path(folder).rename(keep / f"seed-{case.seed}-case-{case.number}")
            Path(folder).mkdir()
    return row_of(case, evidence, found) | {"wall_s": round(time.monotonic() - began_s, 1)}


def row_of(case: Case, evidence: Evidence, found: list[str]) -> dict[str, Any]:
    """Return a case's row of the results: what failed, what came of it, and what did not hold."""
    nulled_ns = null_ns(evidence)
    begun = [each.at_ns for each in evidence.struck if each.fault.null_ms is not None]
    # A fault that comes later cannot be why the valve is at null.
    begun = [at_ns for at_ns in begun if nulled_ns is not None and at_ns <= nulled_ns]
    null_ms = None if nulled_ns is None or not begun else 1e-6 * (nulled_ns - min(begun))
    since_ns = min((each.at_ns for each in evidence.struck), default=0)
    return {
        "number": case.number,
        "name": case.name,
        "struck": len(evidence.struck),
        "exit_code": evidence.exit_code,
        "cause": evidence.cause,
        "null_ms": null_ms,
        "lost_s": evidence.lost_s,
        "host_paused_ms": 1e-6 * paused_ns(evidence.pauses, since_ns, since_ns + 10_000_000_000),
        "violations": found,
    }


def told(row: Mapping[str, Any]) -> str:
    """Return what came of a case, in a line."""
    if row["violations"]:
        return "FAILED: " + "; ".join(row["violations"])
    null = "" if row["null_ms"] is None else f", null {row['null_ms']:.0f} ms after"
    paused = f", host paused for {row['host_paused_ms']:.0f} ms" if row["host_paused_ms"] else ""
    cause = row["cause"] or "ran on"
    return f"{cause}, exit code {row['exit_code']}{null}{paused}: holds in {row['wall_s']:.0f} s"


def summary(rows: list[dict[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows of the table that counts the cases by what came of them."""
    causes = Counter(_cause(row) for row in rows)
    body: list[tuple[str, ...]] = []
    for cause, count in causes.most_common():
        of_it = [row for row in rows if _cause(row) == cause]
        nulls = [row["null_ms"] for row in of_it if row.get("null_ms") is not None]
        held = sum(not row["violations"] for row in of_it)
        shown = f"`{cause}`" if cause.isupper() else cause
        body.append((shown, str(count), str(held), f"{max(nulls):.0f}" if nulls else ""))
    head = (
        "first-out cause",
        "cases",
        "hold",
        "valve null at the latest, ms after the first fault",
    )
    return head, body


def _cause(row: Mapping[str, Any]) -> str:
    return row.get("cause") or "ran on, or nobody is left to tell"


if __name__ == "__main__":
    sys.exit(main())
