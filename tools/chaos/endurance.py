"""Kills a campaign on the emulated rig at random points, goes on with it, and looks at its record.

Run as `python -m tools.chaos.endurance [--points N] [--seed N] [PART ...]`; parts are supervisor,
recorder and everything.
"""

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path
from signal import SIGKILL
from typing import Any, Final

from .records import finished_in, record_problems
from .stage import FIRST_FAULT, TEST, Stage, StageError

PARTS: Final = {
    "supervisor": ("supervisor",),
    "recorder": ("recorder",),
    "everything": ("supervisor", "loop", "field", "recorder"),
}
TESTS: Final = tuple(
    {
        "name": f"test {number}",
        **TEST,
        "duration": "6 s",
        "faults": [{**FIRST_FAULT, "until": "4 s"}],
        "expect": "inconclusive",
    }
    for number in range(3)
)
CAMPAIGN_S: Final = 21.0
"""How long it takes from its first leak on, about."""


def killed_at(part: str, at_s: float, folder: Path) -> list[str]:
    """Kill a part so long after the first leak; return what was wrong in the end.

    Raises:
        StageError: the rig did not become safe, or the campaign did not end.
    """
    with Stage(folder, tests=TESTS) as stage:
        time.sleep(at_s)
        if stage.run.poll() is None:
            stage.send(SIGKILL, *(each for each in PARTS[part] if each in stage.living()))
        # A recorder's end is a trip, by which the run ends by itself.
        stage.wait(lambda: stage.run.poll() is not None, "`rig run` to end")
        before: dict[int, Any] = finished_in(stage.out)
        code = stage.resume()
        if code not in (0, 1):
            return [f"exit code {code}: {stage.printed[-2000:]}"]
        stage.wait(stage.is_safe, "the safe state at the end")
        return record_problems(stage.out, [before], len(TESTS))


def main() -> int:
    """Kill each part at random points; return how many of them went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    given = parser.parse_args()
    random_ = random.Random(given.seed)
    failures = 0
    for part in given.parts or PARTS:
        for point in range(1, given.points + 1):
            at_s = random_.uniform(0.0, CAMPAIGN_S)
            with tempfile.TemporaryDirectory(prefix="rig-endurance-") as folder:
                try:
                    found = killed_at(part, at_s, Path(folder))
                except StageError as error:
                    found = [str(error)]
            failures += bool(found)
            told = "FAILED: " + "; ".join(found) if found else "nothing lost, nothing repeated"
            print(f"{part}: kill {point} of {given.points}, after {at_s:.1f} s: {told}", flush=True)
    print(f"{failures} failed")
    return failures


if __name__ == "__main__":
    sys.exit(main())
