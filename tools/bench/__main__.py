"""Runs the benchmarks of filters, plant, campaigns (with start-up) and lanes, one after another.

With `--against FOLDER`, the quickstart campaign is run by another checkout and by this one in turn.
"""

import sys

from . import campaign, filters, lanes, plant


def main() -> None:
    """Run these four benchmarks with their defaults; compare with a checkout if one is given."""
    given, sys.argv = sys.argv, sys.argv[:1]
    for benchmark in (filters, plant, campaign, lanes):
        benchmark.main()
    if given[1:]:
        sys.argv = given
        campaign.main()


if __name__ == "__main__":
    main()
