"""Measures how far the plant's integrator has converged at its usual step, its half and quarter.

`python -m tools.studies.convergence` starts short runs of 50 ms from many states along several long
runs, and prints by how much they differ from the same runs with a sixteenth of the step. Long runs
cannot be compared: with stick-slip, any small difference lets two runs come out of phase.
"""

import argparse
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from rig.plant import FRICTION_LAWS, NOMINAL, Model, Parameters
from rig.plant.dynamics import PlantState
from rig.plant.integrator import SUBSTEPS, TICK
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

HORIZON: Final = 50
FINENESS: Final = (0.5, 1, 2, 4)
REFERENCE: Final = 16


def motions(seconds: float) -> dict[str, tuple[Array, dict[str, float]]]:
    """Return, by name of motion, the commands (ticks,) in V and what differs from the nominal rig.

    The latter are values of the rig's parameters by name, SI; {} means none.
    """
    time = np.arange(round(seconds / TICK)) * TICK
    rng = np.random.default_rng(1)
    steps = np.repeat(rng.uniform(-6.0, 6.0, -(-time.size // 200)), 200)[: time.size]
    leaks = {"external_leakage_1": 5e-9, "internal_leakage": 4e-9}
    lines = {"supply_droop": 5e12, "return_back_pressure": 5e12, "return_pressure": 2e5}
    spring = {"spring_stiffness": 6e5, "spring_contact": 0.31}
    return {
        "3 V sine at 1 Hz (section 3.2.1)": (3.0 * np.sin(2.0 * np.pi * time + 0.1), {}),
        "creeping, 0.6 V at 0.5 Hz": (0.6 * np.sin(np.pi * time), {}),
        "reversing at speed, 8 V at 2 Hz": (8.0 * np.sin(4.0 * np.pi * time), {}),
        "random steps": (steps, {}),
        "random steps, leaking": (steps, leaks),
        "random steps, droop and back pressure": (steps, lines),
        "against a spring": (2.0 * np.sign(np.sin(np.pi * time + 0.1)), spring),
        "into the stroke ends at full command": (10.0 * np.sign(np.sin(np.pi * time + 0.1)), {}),
    }


def stacked(run: dict[str, Array]) -> Array:
    """Return the states of a run as (ticks, 9), with columns in the order of `PlantState`."""
    return np.stack([run[name] for name in PlantState._fields], axis=1)


def differences(rig: Parameters, command: Array) -> Iterator[Array]:
    """Yield, for each short run, its largest differences from the reference in each state.

    Short runs of `HORIZON` ticks begin every 47 ticks along one long run with `command` (ticks,),
    V. Each yielded array is (len(FINENESS), 9), SI: a row for each fineness of the step, and
    columns in the order of `PlantState`.
    """
    model = Model(parameters=rig)
    along = stacked(simulate(model, command))
    for start in range(100, command.size - HORIZON, 47):
        piece = command[start : start + HORIZON]
        runs = [
            stacked(
                simulate(model, piece, initial=along[start], substeps=round(fineness * SUBSTEPS))
            )
            for fineness in (*FINENESS, REFERENCE)
        ]
        yield np.array([np.abs(run - runs[-1]).max(axis=0) for run in runs[:-1]])


def _of(values: Array, *names: str) -> Array:
    return np.stack([values[..., PlantState._fields.index(name)] for name in names]).max(axis=0)


def table(seconds: float) -> Table:
    """Run everything and return the table of quantiles of the pressure and position differences."""
    result = Table(title=f"Differences within {HORIZON} ms from the run with {REFERENCE}ths of h")
    for column in ("friction", "motion", "horizons", "h (ms)"):
        result.add_column(column, no_wrap=True)
    for column in ("p (kPa) 50 %", "90 %", "99 %", "x (µm) 50 %", "90 %", "99 %"):
        result.add_column(column, justify="right")
    for law_name, law in FRICTION_LAWS.items():
        everything = []
        for name, (command, extra) in motions(seconds).items():
            rig = NOMINAL._replace(friction_law=law, **extra)
            found = np.array(list(differences(rig, command)))
            everything.append(found)
            _add_row(result, law_name, name, found, FINENESS.index(1))
        pooled = np.concatenate(everything)
        for index in range(len(FINENESS)):
            _add_row(result, law_name, "all of these", pooled, index)
        result.add_section()
    return result


def _add_row(result: Table, law: str, motion: str, found: Array, index: int) -> None:
    pressure = 1e-3 * _of(found[:, index], "pressure_1", "pressure_2")
    position = 1e6 * _of(found[:, index], "position")
    step = 1e3 * TICK / (FINENESS[index] * SUBSTEPS)
    quantiles = [
        f"{value:.2g}"
        for series in (pressure, position)
        for value in np.quantile(series, [0.5, 0.9, 0.99])
    ]
    result.add_row(law, motion, str(found.shape[0]), f"{step:.3g}", *quantiles)


def main() -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=6.0, help="length of each run (default 6)")
    Console(width=140).print(table(parser.parse_args().seconds))


if __name__ == "__main__":
    main()
