"""Runs the benchmarks of filters, plant, campaigns (with start-up) and lanes, one after another."""

import sys

from . import campaign, filters, lanes, plant


def main() -> None:
    """Run these four benchmarks with their defaults, one after the other."""
    sys.argv = sys.argv[:1]
    for benchmark in (filters, plant, campaign, lanes):
        benchmark.main()


if __name__ == "__main__":
    main()
