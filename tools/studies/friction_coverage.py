"""Measures how often the 95 % intervals of friction parameters hold the true values.

`python -m tools.studies.friction_coverage` simulates rigs with transducers over 40 s of each
motion. Parameters, friction and load of the rigs are drawn at random
(`tools.simulated.drawn_rigs`); four in ten have a spring. Friction is identified with the nominal
model and compared with the simulated rig's.
"""

import argparse
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from estimator.friction.curve import FrictionCurve, friction_changes, identify_recording
from estimator.friction.fit import PARAMETERS
from estimator.friction.samples import Spring
from rig.plant import Model, Parameters
from rig.plant.integrator import TICK
from tools.simulated.drawn_rigs import MIDDLE, MOTIONS, OPEN_LOOP, drawn_rig
from tools.simulated.recordings import recorded_healthy

Array = NDArray[np.float64]

SECONDS: Final = 40.0
EXPERIMENT: Final = "experiment"
"""Name of a further motion: the sine of the shipped campaign friction_3_1."""


class Case(NamedTuple):
    """The true parameters of a simulated rig, and the friction that was identified."""

    truth: Parameters
    found: FrictionCurve


def setpoint_of(name: str, rng: np.random.Generator, ticks: int) -> Array:
    """Return the setpoint (ticks,) of a motion in `MOTIONS` or of `EXPERIMENT`, m.

    For a motion in open loop it is the command, V. The setpoint of `EXPERIMENT` is not drawn.

    Raises:
        KeyError: there is no motion of this name.
    """
    if name == EXPERIMENT:
        return MIDDLE + 0.2 * np.sin(np.pi * TICK * np.arange(ticks))
    return MOTIONS[name](rng, ticks)


def case(name: str, seed: int) -> Case:
    """Simulate one rig in one motion, and identify its friction.

    The identification is told the rig's true spring, and assumes the nominal model otherwise.

    Args:
        name: of the motion, see `setpoint_of`.
        seed: draws rig, motion and noise.
    """
    rng = np.random.default_rng(seed)
    truth = drawn_rig(rng)
    setpoint = setpoint_of(name, rng, round(SECONDS / TICK))
    recording = recorded_healthy(truth, setpoint, name in OPEN_LOOP, seed)
    spring = Spring(truth.spring_stiffness, truth.spring_contact)
    return Case(truth, identify_recording(recording, Model(), spring))


def row(cases: list[Case], parameter: str) -> tuple[str, ...]:
    """Return the cells of the table's row on one parameter, over all cases.

    The cells are: number of cases in which it was identified, coverage of the 95 % interval, mean
    error, rms error, and median standard error (errors in SI, over the cases in which it was
    identified). All but the first are empty if there is no such case.
    """
    errors, widths = [], []
    for truth, found in cases:
        estimate = found.estimates[parameter]
        if estimate.value is not None and estimate.standard_error is not None:
            errors.append(estimate.value - getattr(truth, parameter))
            widths.append(estimate.standard_error)
    if not errors:
        return f"0 of {len(cases)}", "", "", "", ""
    error, width = np.array(errors), np.array(widths)
    return (
        f"{error.size} of {len(cases)}",
        f"{100.0 * np.mean(np.abs(error) < 1.96 * width):.0f} %",
        f"{np.mean(error):.3g}",
        f"{np.sqrt(np.mean(error**2)):.3g}",
        f"{np.median(width):.3g}",
    )


def false_changes(ones: list[Case], others: list[Case]) -> tuple[int, int]:
    """Return in how many pairs friction is said to have changed, and the number of pairs.

    A pair is the same rig in two motions, so that any change is false. Pairs without a comparable
    parameter are not counted.
    """
    pairs = [
        friction_changes(one.found, other.found) for one, other in zip(ones, others, strict=True)
    ]
    changed = [any(change.significant for change in changes) for changes in pairs if changes]
    return sum(changed), len(changed)


def main() -> None:
    """Run the study, and print the table and the number of false changes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=40, help="rigs for each motion")
    parser.add_argument("--seed", type=int, default=1)
    motions = [EXPERIMENT, *MOTIONS]
    parser.add_argument("--motion", nargs="*", choices=motions, default=motions, help="default all")
    given = parser.parse_args()
    table = Table("motion", "parameter", "identified", "covered", "mean error", "rms error",
                  "standard error")  # fmt: skip
    seeds = [1000 * given.seed + index for index in range(given.rigs)]
    cases = {name: [case(name, seed) for seed in seeds] for name in given.motion}
    for name, found in cases.items():
        for parameter in PARAMETERS:
            table.add_row(name, parameter, *row(found, parameter))
    console = Console(width=110)
    console.print(table)
    for one, other in combinations(cases, 2):
        changed, pairs = false_changes(cases[one], cases[other])
        console.print(
            f"said to differ between {one} and {other}: {changed} of {pairs} unchanged rigs"
        )


if __name__ == "__main__":
    main()
