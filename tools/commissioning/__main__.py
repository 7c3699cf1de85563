"""Commissions emulated rigs drawn at random, one after the other, and prints what came of each.

    python -m tools.commissioning --seed 1 --rigs 10 --out DIR

With `--whole`, friction and baseline are measured too, which takes 14 minutes more for each.
"""

import argparse
import sys
from pathlib import Path

from .drawing import drawn
from .trial import trial


def main() -> int:
    """Run the trials; return 0 if every rig came out right."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rigs", type=int, default=10)
    parser.add_argument("--only", type=int, action="append", help="the rig of this number")
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    given = parser.parse_args()
    options = () if given.whole else ("--skip", "friction", "--skip", "baseline")
    numbers, good = given.only or range(given.rigs), 0
    for number in numbers:
        folder = given.out / f"{given.seed}-{number}"
        folder.mkdir(parents=True)
        rig = drawn(given.seed, number)
        judged = trial(rig, folder, options)
        good += judged.good
        print(
            f"{number}: {', '.join(rig.wrong)}; from {rig.start_m:.3f} m: "
            f"{'all found' if judged.good else 'NOT GOOD'}, exit {judged.code}, "
            f"missed {judged.missed or 'nothing'}, trips {judged.trips or 'none'}, at most "
            f"{1e3 * judged.speed:.0f} mm/s and {1e-6 * judged.pressure:.1f} MPa, "
            f"{judged.seconds:.0f} s",
            flush=True,
        )
        if judged.said:
            print(judged.said, flush=True)
    print(f"{good} of {len(numbers)} rigs: all found, no trip, never faster than 60 mm/s")
    return 0 if good == len(numbers) else 1


if __name__ == "__main__":
    sys.exit(main())
