"""Tests locked cylinders drawn at random for leaks, and prints how many were found.

    python -m tools.leak_test --seed 1 --count 400

Healthy rigs come first, then each place at each size. A thousand tests take about 5 s.
"""

import argparse
import sys

from rig.plant import LEAKS

from .trials import scored

SIZES = (0.0005, 0.00075, 0.001)


def main() -> int:
    """Run the trials; return 0 if 95 of 100 leaks of the largest size are found, 1 of 100 false."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=400, help="tests of each place and size")
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES, help="L/min")
    given = parser.parse_args()
    print("| place | leak, L/min | found | elsewhere | in its interval | rms error, L/min |")
    print("| :-- | --: | --: | --: | --: | --: |")
    good = True
    for place, size in [("healthy", 0.0), *((p, s) for s in given.sizes for p in LEAKS)]:
        score = scored(place, size, given.count, given.seed)
        print(
            f"| {place} | {size:g} | {score.found} of {score.trials} | {score.elsewhere} | "
            f"{score.covered} | {score.scatter:.2g} |",
            flush=True,
        )
        if place == "healthy":
            good &= score.found <= 0.01 * score.trials
        elif size == max(given.sizes):
            good &= score.found >= 0.95 * score.trials
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
