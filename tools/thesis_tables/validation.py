"""Section 3.2: compares recordings of a healthy rig with a model driven by the recorded command."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks.pattern import STARTED_S
from estimator.leaks.replaying import filter_recording
from rig.configuration.campaigns.campaign import load_campaign
from rig.plant import Model
from rig.plant.dynamics import PlantState
from rig.plant.simulation import simulate
from rig.recording import Recording, RecordingError, read_recording
from rig.recording.errors import RecordingProblem

from .trials import record

Array = NDArray[np.float64]

FILES: Final = {
    "sine": "healthy_sine_1hz_open_loop.csv.gz",
    "chirp": "healthy_chirp_open_loop.csv.gz",
}
_WIDEST_BIAS: Final = 2e-5
"""Null biases up to this, of either sign, are tried, m: twice the one that section 3.2.1 finds."""
_HALVINGS: Final = 16
_LAST_S: Final = 1.0


@dataclass(frozen=True)
class Measured:
    """Recordings of a rig under the commands of section 3.2.

    Attributes:
        origin: where the recordings come from, in words for the page.
        recordings: by motion, a key of `FILES`.
    """

    origin: str
    recordings: dict[str, Recording]


def read_measured(folder: Path, origin: str) -> Measured:
    """Read the recordings named in `FILES` from a folder.

    Raises:
        RecordingError: a file cannot be read; it lists every problem of all files.
    """
    recordings, problems = {}, list[RecordingProblem]()
    for motion, name in FILES.items():
        try:
            recordings[motion] = read_recording(folder / name)
        except RecordingError as error:
            problems += error.problems
    if problems:
        raise RecordingError(problems)
    return Measured(origin, recordings)


@dataclass(frozen=True)
class Simulated:
    """The shipped campaign of section 3.2, as it was simulated.

    Attributes:
        model: the model that is compared with the recordings.
        truth: the model of the simulated rig itself.
        recordings: by motion, a key of `FILES`.
    """

    model: Model
    truth: Model
    recordings: dict[str, Recording]


def run_simulated() -> Simulated:
    """Run the healthy tests of section 3.2 on the simulated rig."""
    campaign, rig = load_campaign("validation_3_2")
    recordings = {test.name: record(rig, test, campaign.model) for test in campaign.tests}
    return Simulated(campaign.model, rig.plant, recordings)


@dataclass(frozen=True)
class Comparison:
    """The differences, recorded less simulated, over a whole recording.

    Attributes:
        null_bias: spool null bias of the model, m.
        position, pressure_1, pressure_2, spool: differences, float64 (n,), SI. Those of the spool
            are NaN if it was not recorded.
    """

    null_bias: float
    position: Array
    pressure_1: Array
    pressure_2: Array
    spool: Array


def start_of(recording: Recording, model: Model) -> PlantState:
    """Return the state in which a recording begins, if the ram is at rest and held by friction.

    Both lines have the model's pressures; a spool that was not recorded is taken for centred.
    """
    par = model.parameters
    p1, p2 = float(recording["pressure_1_Pa"][0]), float(recording["pressure_2_Pa"][0])
    return PlantState(
        spool=float(recording["spool_m"][0]) if "spool_m" in recording else 0.0,
        spool_velocity=0.0,
        pressure_1=p1,
        pressure_2=p2,
        position=float(recording["position_m"][0]),
        velocity=0.0,
        friction_state=par.piston_area * (p1 - p2) / par.bristle_stiffness,
        supply_pressure=par.supply_pressure,
        return_pressure=par.return_pressure,
    )


def compare(recording: Recording, model: Model) -> Comparison:
    """Simulate a model from a recording's start under its command; return the differences."""
    states = simulate(model, recording["command_V"], initial=start_of(recording, model))
    spool = recording.channels.get("spool_m", np.full(len(recording), np.nan))
    return Comparison(
        model.parameters.spool_null_bias,
        recording["position_m"] - states["position"],
        recording["pressure_1_Pa"] - states["pressure_1"],
        recording["pressure_2_Pa"] - states["pressure_2"],
        spool - states["spool"],
    )


def compare_without_drift(recording: Recording, model: Model) -> Comparison:
    """Compare after changing the model's null bias so that the ram ends where the recorded one did.

    The mean positions of the last second are made equal, with a bias of 20 um at most of either
    sign. It is found by bisection, as the ram drifts further out the greater the bias is. The
    thesis removes this drift by adjusting the friction model instead (section 3.2.1).
    """
    last = recording.time_s > recording.time_s[-1] - _LAST_S
    low, high = -_WIDEST_BIAS, _WIDEST_BIAS
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if compare(recording, _biased(model, middle)).position[last].mean() > 0.0:
            low = middle
        else:
            high = middle
    return compare(recording, _biased(model, 0.5 * (low + high)))


def _biased(model: Model, null_bias: float) -> Model:
    return model.with_effect("spool_null_bias", value=null_bias)


def one_step_error(recording: Recording, model: Model) -> Array:
    """Return the product filter's mean absolute innovations (3,): position (m), pressures (Pa).

    They measure the error of the model's prediction over one sample, including sensor noise. The
    filter's first `STARTED_S` are left out.
    """
    run = filter_recording(recording, model)
    started = recording.time_s - recording.time_s[0] > STARTED_S
    return np.asarray(np.abs(run.innovation[started]).mean(axis=0))


Figure = Callable[[Comparison], float]

FIGURES: Final[tuple[tuple[str, float, Figure], ...]] = (
    ("position, mean (mm)", 1e-3, lambda c: float(c.position.mean())),
    ("position, mean absolute (mm)", 1e-3, lambda c: float(np.abs(c.position).mean())),
    ("position, largest (mm)", 1e-3, lambda c: float(np.abs(c.position).max())),
    ("pressure 1, mean (1e5 Pa)", 1e5, lambda c: float(c.pressure_1.mean())),
    ("pressure 1, mean absolute (1e5 Pa)", 1e5, lambda c: float(np.abs(c.pressure_1).mean())),
    ("pressure 1, largest (1e5 Pa)", 1e5, lambda c: float(np.abs(c.pressure_1).max())),
    ("pressure 2, mean (1e5 Pa)", 1e5, lambda c: float(c.pressure_2.mean())),
    ("pressure 2, mean absolute (1e5 Pa)", 1e5, lambda c: float(np.abs(c.pressure_2).mean())),
    ("pressure 2, largest (1e5 Pa)", 1e5, lambda c: float(np.abs(c.pressure_2).max())),
    ("spool, mean (µm)", 1e-6, lambda c: float(c.spool.mean())),
    ("spool null bias of the model (µm)", 1e-6, lambda c: c.null_bias),
)
"""Figures of section 3.2: name, unit in SI, and the function that computes it from a comparison."""

PRINTED: Final[dict[str, dict[str, str]]] = {
    "sine": {
        "position, mean (mm)": "0.28",
        "position, largest (mm)": "2",
        "pressure 1, mean (1e5 Pa)": "1.8",
        "pressure 1, largest (1e5 Pa)": "10",
        "pressure 2, mean (1e5 Pa)": "1.1",
        "pressure 2, largest (1e5 Pa)": "10",
        "spool, mean (µm)": "-9.8",
    },
    "chirp": {
        "position, largest (mm)": "4",
        "pressure 1, mean (1e5 Pa)": "0.056",
        "pressure 2, mean (1e5 Pa)": "-2.4",
    },
}
"""Figures that sections 3.2.1 and 3.2.2 print, by motion and name. What they call "the range of the
error" is taken for the largest absolute error."""
