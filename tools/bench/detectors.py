"""Times the detectors of a sweep in lanes against one detector after another, on the same cases.

`python -m tools.bench.detectors` draws some chunks of a sweep that is judged by the product's
filter. It judges each group of cases twice in turn: as `rig sweep` does, and with one
`OilAccountDetector` for each lane, which is the detector of `rig run` and `rig replay`. It prints
the simulated seconds per second of processor time of both ways, the ratio, and how many verdicts
differ. Plants and filters, which both ways share, are included.
"""

import argparse
import time
from collections.abc import Sequence
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from estimator.leak_lanes.lane_detectors import LaneDetectors, samples_of_lane
from estimator.leaks.detection import OilAccountDetector
from rig.configuration.sweeps.sweep import load_sweep
from rig.lanes import LANES
from rig.plant import Model
from rig.sweep import product_lanes
from rig.sweep.drawing import Cases
from rig.sweep.group import Figures, Group, Setting, groups_of, setting_of
from rig.sweep.run_cases import run_chunk
from rig.sweep.running import drawn_chunks

Array = NDArray[np.float64]


class DetectorsInTurn:
    """One detector for each lane, each of which takes its half second by itself."""

    def __init__(self, model: Model, false_alarms_per_day: float) -> None:
        self.each = [
            OilAccountDetector(model, false_alarms_per_day, returning=False) for _ in range(LANES)
        ]

    def update(self, time_s: Array, readings: Array, states: Array) -> None:
        """Give each detector the next half second; arguments as of `LaneDetectors.update`."""
        for lane, detector in enumerate(self.each):
            detector.update(*samples_of_lane(time_s, readings, states, lane))


def judged(group: Group, detectors: type) -> tuple[Figures, float]:
    """Judge a group with detectors of a class; return its columns and the processor time in s."""
    start = time.process_time()
    with patch.object(product_lanes, "LaneDetectors", detectors):
        figures = product_lanes.judged_by_product(group)
    return figures, time.process_time() - start


def compare(setting: Setting, chunks: Sequence[Cases], console: Console) -> None:
    """Judge all cases of the chunks both ways, and print a table with a line for each chunk."""
    run_chunk(setting, chunks[0])
    table = Table(title="rig-seconds per second of processor time, plant and filter included")
    for column in ("chunk", "cases", "one by one", "in lanes", "ratio", "verdicts that differ"):
        table.add_column(column, justify="right")
    total = np.zeros(4)
    for cases in chunks:
        found = np.zeros(4)
        for at in groups_of(cases):
            after, in_lanes_s = judged(Group(setting, cases, at), LaneDetectors)
            before, in_turn_s = judged(Group(setting, cases, at), DetectorsInTurn)
            differ = np.count_nonzero(before["verdict"] != after["verdict"])
            found += np.array([LANES, in_turn_s, in_lanes_s, differ], dtype=np.float64)
        total += found
        table.add_row(f"{cases.chunk}", *_cells(found, setting))
    table.add_row("all", *_cells(total, setting))
    console.print(table)


def _cells(found: Array, setting: Setting) -> tuple[str, ...]:
    count, in_turn_s, in_lanes_s, differ = found.tolist()
    rig_s = count * setting.blocks * 0.5
    return (
        f"{count:.0f}", f"{rig_s / in_turn_s:.0f}", f"{rig_s / in_lanes_s:.0f}",
        f"{in_turn_s / in_lanes_s:.2f}", f"{differ:.0f}",
    )  # fmt: skip


def main() -> None:
    """Run the benchmark that the command line asks for, and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweep", default="detector", help="which one (default detector)")
    parser.add_argument(
        "--chunks", type=int, nargs="+", default=[0, 4, 8, 12], help="numbers of its chunks"
    )
    options = parser.parse_args()
    sweep = load_sweep(options.sweep)
    if sweep.filter_name != "product":
        parser.error(f"--sweep: {sweep.name} is judged by {sweep.filter_name}; name one by product")
    chunks = list(drawn_chunks(sweep, set(options.chunks)))
    if not chunks:
        parser.error(f"--chunks: {sweep.name} has none of the chunks {options.chunks}")
    compare(setting_of(sweep), chunks, Console(width=110))


if __name__ == "__main__":
    main()
