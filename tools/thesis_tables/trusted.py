"""The thesis's filters with a smaller variance of the position, so that they trust the encoder.

The thesis calls the 1e-4 in R a variance, but gives its unit as m (chapter 5). Taken as a variance
in m^2, it is a standard deviation of 1 cm; taken as a standard deviation in m, as its unit says, it
is 0.1 mm. The product's thesis filters take it as a variance. The filters here take it as a
standard deviation, so that the page can show how much depends on this choice.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import thesis
from estimator.filters.covariance import kalman_step
from estimator.filters.registry import OUTPUTS, THESIS_7, filter_named
from estimator.filters.thesis import seven, six
from estimator.filters.thesis_model import linearised_6, linearised_7
from rig.jit import njit
from rig.plant import Model
from rig.recording import Recording

Array = NDArray[np.float64]

POSITION_VARIANCE: Final = 1e-4**2
"""Variance of the position reading, m^2, if the printed 1e-4 m is a standard deviation."""


@njit(cache=True, error_model="numpy")
def _run_6(x, P, command, measured, par, noise, states, outputs):
    for k in range(1, command.size):
        z = measured[k, 0], measured[k, 1], measured[k, 2]
        kalman_step(linearised_6(six(x), command[k - 1], par), x, P, noise, z, outputs[k])
        states[k] = x


@njit(cache=True, error_model="numpy")
def _run_7(x, P, command, measured, par, noise, states, outputs):
    for k in range(1, command.size):
        z = measured[k, 0], measured[k, 1], measured[k, 2]
        kalman_step(linearised_7(seven(x), command[k - 1], par), x, P, noise, z, outputs[k])
        states[k] = x


@dataclass(frozen=True)
class TrustedRun:
    """The states (n, 6 or 7) and outputs (n, 10) of a thesis filter, as in `FilterRun`."""

    states: Array
    outputs: Array


def run_trusted(
    recording: Recording,
    model: Model,
    filter_name: str,
    position_variance: float = POSITION_VARIANCE,
) -> TrustedRun:
    """Run a thesis filter over a recording, with its printed tuning except R's position variance.

    `filter_name` is `thesis-6` or `thesis-7`; `position_variance` is in m^2. Row 0 has the filter's
    start: its states are the printed ones, and its outputs are NaN.
    """
    with_load = filter_named(filter_name).code == THESIS_7
    x, P = thesis.initial_state(with_load)
    run, Q, R = (
        (_run_7, thesis.THESIS7_PROCESS_NOISE, thesis.THESIS7_MEASUREMENT_NOISE)
        if with_load
        else (_run_6, thesis.THESIS6_PROCESS_NOISE, thesis.THESIS6_MEASUREMENT_NOISE)
    )
    measured = np.column_stack(
        [recording[name] for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa")]
    )
    states = np.tile(x, (len(recording), 1))
    outputs = np.full((len(recording), len(OUTPUTS)), np.nan)
    outputs[:, OUTPUTS.index("filter_resets")] = 0.0  # These filters never start anew.
    noise = Q, (position_variance, *R[1:])
    run(x, P, recording["command_V"], measured, model.parameters, noise, states, outputs)
    return TrustedRun(states, outputs)
