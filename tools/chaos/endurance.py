"""Kills parts of campaigns at random times, resumes the campaigns, and checks their records.

Run as `python -m tools.chaos.endurance [--points N] [--seed N] [PART ...]`. If no PART is given,
all parts are killed, on the emulated rig and on the simulated one, and the table of docs/safety.md
is written.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from tools.pages.marked_tables import fill, markdown
from tools.pages.safety import PAGE

from .relay import OUTLIVED, PARTS, Record, relay
from .signals import end_by_signals

RIGS: Final = {"emulated": tuple(PARTS), "simulated": ("supervisor", "publisher", "everything")}
"""The parts that are killed on each rig; on the simulated one the supervisor itself records."""
_HEAD: Final = (
    "rig, what is killed", "kills: in which phase", "tests finished", "lost or repeated",
    "attempts", "valve null, s", "bypass shut, s", "pump unloaded, s", "end of recordings lost, s",
    "trips by a stalled machine",
)  # fmt: skip


def told(rig: str, part: str, record: Record, wall_s: float) -> str:
    """Return a line of text that states the outcome and the duration of the kills of a part."""
    cells = row(rig, part, record)
    found = "FAILED: " + "; ".join(record.problems) if record.problems else "as claimed"
    return f"{found} in {wall_s:.0f} s: {' | '.join(cells)}"


def row(rig: str, part: str, record: Record) -> tuple[str, ...]:
    """Return the cells, in the order of `_HEAD`, of the table's row on one part of one rig.

    The times of the devices are empty on the simulated rig. They and the time lost are empty for
    parts without which a run goes on (`OUTLIVED`).
    """
    phases = Counter(kill.rpartition(", ")[2] or "between tests" for kill in record.kills)
    where = ", ".join(f"{phase} {count}" for phase, count in phases.most_common())
    stalls = ", ".join(f"`{cause}` {n}" for cause, n in Counter(record.stalls).most_common())
    is_told = rig != "simulated" and part not in OUTLIVED
    safe = [
        _most(each.get(device) for each in record.safe_s) if is_told else ""
        for device in ("valve", "bypass", "pump")
    ]
    return (
        f"{rig}: {part}",
        f"{len(record.kills)}: {where}",
        f"{record.tests} in {record.campaigns} campaigns",
        "see above" if record.problems else "none",
        str(record.attempts),
        *safe,
        "" if part in OUTLIVED else _most(record.lost_s),
        stalls or "none",
    )


def _most(values: Iterable[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{max(known):.2f}" if known else "none"


def main() -> int:
    """Kill each part at random times; return for how many parts something was not as claimed.

    A part on the other rig counts anew. The table is written only if no part and no rig was chosen
    and everything was as claimed. Files of a part are kept only if something was not.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10, help="kills of each part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rig", choices=RIGS, help="one of them only")
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    given = parser.parse_args()
    unknown = set(given.parts) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(unknown)}; there are {', '.join(PARTS)}")
    end_by_signals()
    rows, failures = [], 0
    for rig, parts in RIGS.items():
        for part in parts if given.rig in (None, rig) else ():
            if given.parts and part not in given.parts:
                continue
            print(f"{rig}: {part}", flush=True)
            began = time.monotonic()
            folder = Path(tempfile.mkdtemp(prefix="rig-endurance-"))
            record = relay(
                folder,
                part,
                given.points,
                given.seed,
                emulated=rig == "emulated",
                tell=lambda text: print(f"  {text}", flush=True),
            )
            if record.problems:
                print(f"  everything of it is in {folder}")
            else:
                shutil.rmtree(folder)
            print(told(rig, part, record, time.monotonic() - began), flush=True)
            rows.append(row(rig, part, record))
            failures += bool(record.problems)
    print(f"{failures} failed")
    if not (failures or given.parts or given.rig):
        fill(PAGE, {"endurance": markdown(_HEAD, rows)})
    return failures


if __name__ == "__main__":
    sys.exit(main())
