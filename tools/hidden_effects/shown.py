"""The smallest size of each effect that a trial's own rig and motions would show the workflow.

The rig of the trial is recorded with nothing hidden in it; what `rig gap` would say it could not
have seen there (`estimator.gap.search.signatures`) are the limits that hidden sizes are counted in.

    python -m tools.hidden_effects.shown --page docs/hidden_effects.md

lists them for each effect in motions of each kind.
"""

import argparse
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.suitability import usable
from estimator.gap.prediction.variables import nuisance_variable
from estimator.gap.search.signatures import limits
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model
from rig.recording import read_recording
from tools.hidden_effects.drawn_trials import THE_SMALLER, drawn_trial, write_recordings
from tools.hidden_effects.menu import MENU
from tools.hidden_effects.motions import MOTIONS, drawn
from tools.pages.marked_tables import fill, markdown

_MODELLED: Final[Mapping[str, str]] = {
    "oil_stiffness": "bulk_modulus",
    "edge_coefficient": "discharge_coefficient",
    "drag": "viscous",
    "pump_pressure": "supply_pressure",
}
"""The model's parameter, by the rig's value."""


def smallest_shown(files: Sequence[Path], nuisances: Mapping[str, float]) -> dict[str, float]:
    """Return the smallest distance from neutral that shows, SI, by effect.

    Of `valve_rate_limit` the largest rate that shows. Infinite (the rate: 0) where no plausible
    size shows; without those effects whose size depends on where the motion goes.

    Args:
        files: recordings to identify with, of a rig in which nothing is hidden.
        nuisances: values of that rig.
    """
    plant = servo_actuator(Model())
    values = {**plant.nominal, **{_MODELLED[name]: value for name, value in nuisances.items()}}
    records = usable([record_of(read_recording(file), plant) for file in files], plant)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        filtered = Fitter(Predictor(plant), records, pool).filtered(values)
        found = limits(filtered, values, [nuisance_variable(n) for n in plant.nuisances])
    return {limit.effect: limit.size for limit in found}


def in_motion(name: str, seed: int, seconds: float) -> dict[str, float]:
    """Return what two motions of a kind in `MOTIONS`, drawn by a seed, would show."""
    trial = drawn_trial("none", seed, 0, seconds=seconds)
    rng = np.random.default_rng([seed, list(MOTIONS).index(name)])
    rows = round(seconds / 1e-3)
    motions = {file: drawn(name, rng, rows) for file in ("identify_1", "identify_2")}
    with TemporaryDirectory() as folder:
        files = write_recordings(replace(trial, motions=motions), Path(folder))
        return smallest_shown(list(files.values()), trial.envelope.nuisances)


def table(seeds: Sequence[int], seconds: float) -> str:
    """Return one row for each effect: what motions of each kind show, the median of some seeds."""
    rows = []
    found = {name: [in_motion(name, seed, seconds) for seed in seeds] for name in MOTIONS}
    for effect in MENU:
        cells = []
        for each in found.values():
            sizes = [limits[effect] for limits in each if effect in limits]
            cells.append(_cell(effect, float(np.median(sizes))) if sizes else "")
        if any(cells):
            rows.append((effect.replace("_", " "), *cells))
    return markdown(("effect", *(name.replace("_", " ") for name in MOTIONS)), rows)


def _cell(effect: str, size: float) -> str:
    hidden = size == 0.0 if effect in THE_SMALLER else not np.isfinite(size)
    return "none" if hidden else f"{size:.2g}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and bring a page's up to date."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.hidden_effects.shown",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=15.0, help="of each of two recordings")
    parser.add_argument("--seeds", type=int, default=3, help="rigs for each kind of motion")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page whose table to bring up")
    options = parser.parse_args(arguments)
    limits_table = table(range(options.seeds), options.seconds)
    if options.page:
        fill(options.page, {"hidden_limits": limits_table})
    print(limits_table)


if __name__ == "__main__":
    main()
