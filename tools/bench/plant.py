"""Times the plant's integrator, and scipy's LSODA on the same equations at the same accuracy.

`python -m tools.bench.plant` lets both integrate the same motions in turn, for several rounds, and
prints the median times in ns for a tick of 1 ms, and their ratio. LSODA calls the compiled time
derivatives and starts anew at each tick, because the command jumps there. Its tolerance is the
loosest one with which its pressures come as close to a precise reference as ours do, in short runs
of 20 ms.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.integrate import odeint

from rig.jit import njit
from rig.plant import NO_FAULT, NOMINAL, Model
from rig.plant.dynamics import PlantState, rates
from rig.plant.integrator import TICK
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TICKS: Final = 10_000
HORIZON: Final = 20
HORIZONS: Final = 12
TOLERANCES: Final = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
REFERENCE_TOLERANCE: Final = 1e-11
# Typical size (SI) of each state, in the order of `PlantState`, for LSODA's absolute tolerance.
SCALE: Final = np.array([1e-4, 0.1, 1e7, 1e7, 0.1, 0.1, 1e-4, 1e7, 1e6])


@dataclass(frozen=True)
class Course:
    """A motion of the nominal rig.

    Attributes:
        name: of the motion, for the table.
        command: (ticks,) V.
        along: (ticks, 9) states by our integrator, in the order of `PlantState`.
    """

    name: str
    command: Array
    along: Array

    @property
    def starts(self) -> list[int]:
        """The first ticks of the short runs in which LSODA is compared and timed."""
        return np.linspace(500, self.command.size - HORIZON - 1, HORIZONS).astype(int).tolist()


def course(name: str, command: Array) -> Course:
    """Return the motion of the nominal rig from mid stroke under a command (ticks,), V.

    The rig has bristle friction.
    """
    run = simulate(Model(), command)
    return Course(name, command, np.stack([run[key] for key in PlantState._fields], axis=1))


def courses(ticks: int = TICKS) -> list[Course]:
    """Return the motions that are compared: at rest, sliding, and with stick-slip."""
    seconds = np.arange(ticks) * TICK
    return [
        course("at rest", 0.01 * np.sin(seconds)),
        course("sliding, 8 V at 2 Hz", 8.0 * np.sin(4.0 * np.pi * seconds)),
        course("stick-slip, 3 V at 1 Hz", 3.0 * np.sin(2.0 * np.pi * seconds)),
    ]


def right_hand_side() -> Callable[[Array, float, float], Array]:
    """Return a compiled function for odeint: time derivatives (9,) of y (9,), t and command (V)."""
    parameters, fault = NOMINAL, NO_FAULT

    @njit(error_model="numpy")
    def derivative(y, t, u):
        return np.array(
            rates(y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7], y[8], u, parameters, fault)
        )

    derivative(np.zeros(9) + 0.1, 0.0, 0.0)
    return derivative


def lsoda(derivative: Any, start: Array, command: Array, tolerance: float) -> Array:
    """Return the states (ticks, 9) at the beginning of each tick, by LSODA.

    Args:
        derivative: see `right_hand_side`.
        start: (9,) states at the first tick.
        command: (ticks,) V.
        tolerance: relative tolerance; times `SCALE`, it is the absolute one.
    """
    states = np.empty((command.size, start.size))
    states[0] = start
    span = np.array([0.0, TICK])
    for k in range(command.size - 1):
        states[k + 1] = odeint(
            derivative, states[k], span, (command[k],), rtol=tolerance, atol=tolerance * SCALE
        )[1]
    return states


def pressure_error(found: Array, reference: Array) -> float:
    """Return the largest difference (Pa) of the chamber pressures of two runs, (ticks, 9) each."""
    return float(np.abs(found - reference)[:, 2:4].max())


def accuracies(derivative: Any, motion: Course) -> tuple[float, float, float]:
    """Return our error (Pa), LSODA's error (Pa) and the tolerance with which LSODA has it.

    Errors are medians over the short runs of the largest pressure difference from LSODA at
    `REFERENCE_TOLERANCE`. The tolerance is the loosest of `TOLERANCES` with which LSODA's error is
    not above ours, or the tightest one if there is none.
    """
    pieces = [(motion.along[k], motion.command[k : k + HORIZON]) for k in motion.starts]
    reference = [lsoda(derivative, *piece, REFERENCE_TOLERANCE) for piece in pieces]
    own = [
        pressure_error(motion.along[k : k + HORIZON], exact)
        for k, exact in zip(motion.starts, reference, strict=True)
    ]
    ours = float(np.median(own))
    for tolerance in TOLERANCES:
        errors = [
            pressure_error(lsoda(derivative, *piece, tolerance), exact)
            for piece, exact in zip(pieces, reference, strict=True)
        ]
        theirs = float(np.median(errors))
        if theirs <= ours:
            break
    return ours, theirs, tolerance


def _ns(run: Callable[[], object], ticks: int) -> float:
    start = time.perf_counter_ns()
    run()
    return (time.perf_counter_ns() - start) / ticks


def measure(motions: list[Course], rounds: int) -> Table:
    """Time both integrators on every motion once in each round, and return the table of medians."""
    derivative = right_hand_side()
    known = {motion.name: accuracies(derivative, motion) for motion in motions}
    ours: dict[str, list[float]] = {motion.name: [] for motion in motions}
    theirs: dict[str, list[float]] = {motion.name: [] for motion in motions}
    model = Model()
    for _ in range(rounds):
        for motion in motions:
            ours[motion.name].append(
                _ns(lambda m=motion: simulate(model, m.command), motion.command.size)  # type: ignore[misc]
            )
            tolerance = known[motion.name][2]

            def horizons(m: Course = motion, tolerance: float = tolerance) -> None:
                for k in m.starts:
                    lsoda(derivative, m.along[k], m.command[k : k + HORIZON], tolerance)

            theirs[motion.name].append(_ns(horizons, HORIZONS * (HORIZON - 1)))
    table = Table(title=f"Plant, a tick of 1 ms, one core, medians of {rounds} rounds")
    table.add_column("motion")
    for column in ("ours ns", "LSODA ns", "LSODA / ours", "error: ours Pa", "LSODA Pa", "its rtol"):
        table.add_column(column, justify="right")
    for name, (own_error, error, tolerance) in known.items():
        ratio = np.array(theirs[name]) / np.array(ours[name])
        low, middle, high = np.percentile(ratio, [25, 50, 75])
        table.add_row(
            name,
            f"{np.median(ours[name]):.0f}",
            f"{np.median(theirs[name]):.0f}",
            f"{middle:.0f} ({low:.0f} to {high:.0f})",
            f"{own_error:.2g}",
            f"{error:.2g}",
            f"{tolerance:.0e}",
        )
    return table


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9, help="interleaved rounds (default 9)")
    rounds = parser.parse_args().rounds
    Console(width=110).print(measure(courses(), rounds))


if __name__ == "__main__":
    main()
