"""Measures how well `rig identify friction --rig` finds friction that differs from the model's.

`python -m tools.studies.friction_experiment --rigs 40 --page docs/friction.md` runs the whole
experiment on rigs drawn at random (`tools.simulated.drawn_rigs`, without springs), and evaluates it
with the nominal model. Every friction parameter of a rig differs from the model's by up to 30 %,
and its bristles are half to twice as stiff. The table states how often the 95 % intervals hold the
true values, and how large the errors are.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from estimator.friction.fit import PARAMETERS
from estimator.friction.samples import Spring
from rig.configuration.rigs.rig import load_rig
from rig.plant import NOMINAL, Model, Parameters
from rig.runner.experiments.friction_experiment import FrictionExperiment, run_friction_experiment
from tools.pages.marked_tables import fill, markdown
from tools.simulated.drawn_rigs import drawn_rig

SPREAD: Final = 0.3
SOFTEST, STIFFEST = 0.5, 2.0
MEASURED: Final = "stiction, measured"
"""Name of the row on the stiction that is measured from the break-aways alone."""


class Case(NamedTuple):
    """The true parameters of a rig, and the result of the experiment on it."""

    truth: Parameters
    found: FrictionExperiment


def unknown_friction(seed: int) -> Parameters:
    """Return a rig drawn by a seed, whose friction differs from the model's by up to 30 %.

    Its bristles are half to twice as stiff as the model's, and it has no spring. Its other
    parameters are those of `drawn_rig`.
    """
    rng = np.random.default_rng(seed)
    names = ("stiction", "coulomb", "stribeck_velocity", "viscous")
    drawn = {name: getattr(NOMINAL, name) * rng.uniform(1 - SPREAD, 1 + SPREAD) for name in names}
    bristles = NOMINAL.bristle_stiffness * np.exp(rng.uniform(np.log(SOFTEST), np.log(STIFFEST)))
    return drawn_rig(rng)._replace(spring_stiffness=0.0, bristle_stiffness=float(bristles), **drawn)


def case(seed: int) -> Case:
    """Draw a rig by a seed, and run the whole friction experiment on it with the nominal model."""
    truth = unknown_friction(seed)
    rig = replace(load_rig("simulated"), plant=Model(parameters=truth))
    with tempfile.TemporaryDirectory() as folder:
        found = run_friction_experiment(rig, Model(), Spring(0.0, 0.0), Path(folder), seed=seed)
    return Case(truth, found)


def rows(cases: Sequence[Case]) -> list[tuple[str, ...]]:
    """Return the table's rows, one for each parameter and for `MEASURED`, with cells as in `HEAD`.

    Errors are in SI; they are those of the cases in which the experiment came to a fit.
    """
    fitted = [(truth, found.fit) for truth, found in cases if found.fit is not None]
    table: list[tuple[str, ...]] = []
    for name in (*PARAMETERS, MEASURED):
        errors, widths = [], []
        for truth, fit in fitted:
            if name == MEASURED:
                errors.append(fit.measured_stiction - truth.stiction)
                widths.append(fit.measured_error)
                continue
            estimate = fit.estimates[name]
            assert estimate.value is not None
            assert estimate.standard_error is not None
            errors.append(estimate.value - getattr(truth, name))
            widths.append(estimate.standard_error)
        error, width = np.array(errors), np.array(widths)
        table.append(
            (
                name.replace("_", " "),
                f"{error.size} of {len(cases)}",
                f"{100.0 * np.mean(np.abs(error) < 1.96 * width):.0f} %",
                f"{np.mean(error):.2g}",
                f"{np.sqrt(np.mean(error**2)):.2g}",
                f"{np.median(width):.2g}",
            )
        )
    return table


HEAD: Final = ("parameter", "found", "covered", "mean error", "rms error", "standard error")


def main() -> None:
    """Run the study and print its results; with `--page`, write the table into that page too."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1, help="of the first rig, times 1000")
    parser.add_argument("--page", type=Path, help="write the table to this page, too")
    given = parser.parse_args()
    cases = [case(1000 * given.seed + index) for index in range(given.rigs)]
    table = Table(*HEAD)
    for row in rows(cases):
        table.add_row(*row)
    if given.page is not None:
        fill(given.page, {"experiment": markdown(HEAD, rows(cases))})
    console = Console(width=110)
    console.print(table)
    fits = [found.fit for _, found in cases if found.fit is not None]
    console.print(f"misfit: {np.median([fit.misfit for fit in fits]):.2f} (median), "
                  f"{max(fit.misfit for fit in fits):.1f} at most")  # fmt: skip
    levels = [found.level for _, found in cases]
    for what, trends in (
        ("stiction", [level.level_trend for level in levels]),
        ("a constant force", [level.offset_trend for level in levels]),
    ):
        significant = sum(trend.significant for trend in trends)
        console.print(
            f"said to depend on the position: {what}, {significant} of {len(levels)} rigs"
        )
    worst = max(abs(fit.disagreement) for fit in fits)
    console.print(f"extrapolated and measured stiction differ by {worst:.1f} standard errors")


if __name__ == "__main__":
    main()
