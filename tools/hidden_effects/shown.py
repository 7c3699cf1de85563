"""The detection limits of a trial: how large an effect must be for its recordings to show it.

The trial's rig is recorded with nothing hidden in it. From these recordings, `rig gap` computes the
smallest size of each effect that it could have noticed (`estimator.gap.search.signatures`). The
sizes of hidden effects are stated as multiples of these limits.

    python -m tools.hidden_effects.shown --page docs/hidden_effects.md

writes a table of the limits, for each effect in each kind of motion.
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
"""Name of the model's parameter, by the name of the same value in `RigValues`."""


def smallest_shown(files: Sequence[Path], nuisances: Mapping[str, float]) -> dict[str, float]:
    """Return, by effect, the smallest distance from its neutral value that the recordings show, SI.

    For an effect on a nuisance, the distance counts from the rig's own value, and only what lies
    beyond the nuisance's tolerance shows. For `valve_rate_limit`, the largest rate that shows is
    given in place of a distance. The distance is infinite (the rate 0) if no plausible size shows.
    Effects whose size depends on the places that the motion reaches are left out. The rig's other
    values are those of the nominal model.

    Args:
        files: recordings to identify with, of a rig in which nothing is hidden.
        nuisances: those values of the rig that differ between healthy rigs, by name, SI.
    """
    plant = servo_actuator(Model())
    values = {**plant.nominal, **{_MODELLED[name]: value for name, value in nuisances.items()}}
    records = usable([record_of(read_recording(file), plant) for file in files], plant)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        filtered = Fitter(Predictor(plant), records, pool).filtered(values)
        found = limits(filtered, values, [nuisance_variable(n) for n in plant.nuisances])
    return {limit.effect: limit.size for limit in found}


def in_motion(name: str, seed: int, seconds: float) -> dict[str, float]:
    """Return `smallest_shown` for two recordings, of motions of one kind drawn by a seed.

    Args:
        name: kind of the motions, a key of `MOTIONS`.
        seed: draws the motions, the rig's nuisances and the noise.
        seconds: length of each recording.
    """
    trial = drawn_trial("none", seed, 0, seconds=seconds)
    rng = np.random.default_rng([seed, list(MOTIONS).index(name)])
    rows = round(seconds / 1e-3)
    motions = {file: drawn(name, rng, rows) for file in ("identify_1", "identify_2")}
    with TemporaryDirectory() as folder:
        files = write_recordings(replace(trial, motions=motions), Path(folder))
        return smallest_shown(list(files.values()), trial.envelope.nuisances)


def table(seeds: Sequence[int], seconds: float) -> str:
    """Return the table of limits in Markdown: a row for each effect, a column for each motion.

    Each cell is the median (SI) of `in_motion` over the seeds, "none" if no plausible size shows,
    and empty if the effect has no limit. Effects without a limit in any motion have no row. Each
    recording lasts `seconds`.
    """
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
    """Print the table of limits; with `--page`, write it into that page too.

    Args:
        arguments: of the command line; None means those of the program.
    """
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
