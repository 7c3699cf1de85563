"""All benchmarks in one run: filters, plant, campaigns, lanes and start-up, as ratios or rates."""

import sys

from tools import bench_campaign, bench_filters, bench_lanes, bench_plant


def main() -> None:
    """Run every benchmark with its defaults, one after the other."""
    sys.argv = sys.argv[:1]
    for benchmark in (bench_filters, bench_plant, bench_campaign, bench_lanes):
        benchmark.main()


if __name__ == "__main__":
    main()
