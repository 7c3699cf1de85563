"""Times rigs in lanes, as simulated seconds per second of one core, and the loop of a single rig.

`python -m tools.bench.lanes` runs the following in turn, for several rounds: the closed-loop test
of `tools.bench.campaign` in all lanes, where each rig has its own seed, leak and onset; rigs drawn
at random in mixed motion; and the compiled loop of one rig with the product filter. The first two
run without a filter and with the product filter. Processor times are measured, which a busy machine
disturbs little.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from estimator.filters.product_lanes import ProductLanes
from rig.lanes import LANES
from rig.plant import LEAKS, NO_FAULT, NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from tools.simulated.drawn_rigs import MIDDLE, drawn_rig, mixed_motion
from tools.simulated.lanes import SimulatedLanes

from .campaign import RIG_SECONDS, loop_alone

Array = NDArray[np.float64]

_BATCH: Final = 500


def campaign() -> tuple[SimulatedLanes, Array, Array]:
    """Return rigs with leaks of several sizes, places and onsets, for one closed-loop test.

    Returns:
        The rigs, their setpoint (ticks, LANES) in m, and (ticks, LANES) zeros: no open loop.
    """
    time_s = np.arange(round(RIG_SECONDS / TICK)) * TICK
    setpoint = np.repeat((0.3 + 0.2 * np.sin(np.pi * time_s + 0.1))[:, None], LANES, axis=1)
    faults = [NO_FAULT._replace(**{LEAKS[i % 3]: 1e-9 * i}) for i in range(LANES)]
    onsets = [10_000 + 1000 * i for i in range(LANES)]
    rigs = SimulatedLanes(
        [NOMINAL] * LANES, range(LANES), [MIDDLE] * LANES, faults=faults, onsets=onsets
    )
    return rigs, setpoint, np.zeros_like(setpoint)


def mixed() -> tuple[SimulatedLanes, Array, Array]:
    """Return rigs drawn at random, each with a mixed motion of its own.

    Returns:
        The rigs, their setpoint (ticks, LANES) in m or V, and (ticks, LANES), 1 in open loop.
    """
    generators = [np.random.default_rng(i) for i in range(LANES)]
    drawn: list[Parameters] = [drawn_rig(generator) for generator in generators]
    motions = [mixed_motion(generator, round(RIG_SECONDS / TICK)) for generator in generators]
    rigs = SimulatedLanes(drawn, range(LANES), [MIDDLE] * LANES)
    setpoint = np.stack([motion.setpoint for motion in motions], axis=1)
    is_open = np.stack([motion.open_loop for motion in motions], axis=1)
    return rigs, setpoint, is_open.astype(np.float64)


def in_lanes(setting: Callable[[], tuple[SimulatedLanes, Array, Array]], filtered: bool) -> float:
    """Run the rigs that `setting` returns, and return the processor time (s) of all together.

    If `filtered`, the product filter runs over their readings. The time to make the rigs is not
    counted.
    """
    rigs, setpoint, is_open = setting()
    filters = ProductLanes(Model()) if filtered else None
    start = time.process_time()
    for first in range(0, setpoint.shape[0], _BATCH):
        part = slice(first, first + _BATCH)
        readings = rigs.advance(setpoint[part], is_open[part])
        if filters is not None:
            filters.advance(readings)
    return time.process_time() - start


def alone() -> float:
    """Run the compiled loop of one rig with the product filter; return the processor time (s)."""
    start = time.process_time()
    loop_alone("product")
    return time.process_time() - start


def measure(rounds: int) -> Table:
    """Time every stage once in each round, and return the table of rates (medians and quartiles).

    Before the first round, every stage is run once without being timed, so that it is compiled.
    """
    stages: dict[str, tuple[Callable[[], float], int]] = {}
    for title, setting in (("campaign", campaign), ("mixed motion", mixed)):
        for filtered in (False, True):
            what = f"{title}, {LANES} lanes, {'product' if filtered else 'simulation alone'}"
            stages[what] = partial(in_lanes, setting, filtered), LANES
    stages["one rig in the loop, product"] = alone, 1
    times: dict[str, list[float]] = {what: [] for what in stages}
    for run, _ in stages.values():
        run()
    for _ in range(rounds):
        for what, (run, _) in stages.items():
            times[what].append(run())
    table = Table(title=f"Rig-seconds per second of one core, medians of {rounds} rounds")
    for column in ("what", "rig-s per s", "quartiles", "ns per tick"):
        table.add_column(column, justify="left" if column == "what" else "right")
    for what, (_, rigs) in stages.items():
        low, middle, high = np.percentile(rigs * RIG_SECONDS / np.array(times[what]), [25, 50, 75])
        table.add_row(what, f"{middle:.0f}", f"{low:.0f} to {high:.0f}", f"{1e6 / middle:.0f}")
    return table


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="how often each stage is timed")
    Console(width=110).print(measure(parser.parse_args().rounds))


if __name__ == "__main__":
    main()
