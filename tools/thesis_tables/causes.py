"""Measures why the thesis's filters behave as they do, on simulated rigs, whose truth is known."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.setpoints import Sine
from estimator.filters.registry import DEFAULT_FILTER
from estimator.leaks.pattern import STARTED_S
from estimator.leaks.replaying import filter_recording
from rig.configuration.campaigns.campaign import load_campaign
from rig.plant import Parameters
from rig.plant.dynamics import chamber_volumes
from rig.plant.integrator import TICK
from rig.plant.simulation import simulate
from tools.thesis_linearised import thesis6_jacobian, thesis6_predict

from .measures import Change, average_change, change
from .trials import Trial, Trials, record
from .trusted import run_trusted

Array = NDArray[np.float64]

_FILTER_ORDER: Final = (
    "spool",
    "pressure_1",
    "pressure_2",
    "position",
    "velocity",
    "spool_velocity",
)
VELOCITY: Final = 4
"""Index of the velocity among the states of the thesis filters."""
POSITION: Final = 3
"""Index of the position among the states of the thesis filters."""
REPEATS: Final = 10
"""Number of times that a test is repeated with different noise."""

MOTIONS: Final = (
    ("open_loop_5_1", "thesis-6"),
    ("closed_loop_sine_5_2_1", "thesis-6"),
    ("simulation_7_1", "thesis-7"),
    ("loaded_7_2", "thesis-7"),
)
"""Campaigns whose healthy sine is run on every rig, each with the thesis's filter for it."""

RIGS: Final = (
    ("simulated", True, "`simulated`: imperfections the filter does not know"),
    ("ideal", True, "`ideal`: none; bristle friction, which the filter does not know"),
    ("thesis", True, "`thesis`: none, Karnopp friction as in the filter"),
    ("thesis", False, "the same behind perfect transducers"),
)
"""Rigs, ever more like the model: name, whether their transducers are noisy, and label."""


@dataclass(frozen=True)
class HealthyLevel:
    """The mean absolute innovations of both pressures in one healthy run, Pa.

    Attributes:
        thesis: those of the thesis's filter, for pressures 1 and 2.
        product: those of the product filter.
    """

    thesis: tuple[float, float]
    product: tuple[float, float]


def healthy_level(campaign_name: str, filter_name: str, rig_name: str, noisy: bool) -> HealthyLevel:
    """Run the healthy sine of a campaign on a shipped rig, and return the filters' innovations.

    The filters' first `STARTED_S` are left out.

    Args:
        campaign_name: of the shipped campaign.
        filter_name: of the thesis's filter.
        rig_name: of the shipped rig, in place of the campaign's own.
        noisy: whether the transducers have noise; if not, the encoder resolves 0.1 um too.
    """
    campaign, rig = load_campaign(campaign_name, rig_name)
    test = next(t for t in campaign.tests if not t.faults and isinstance(t.setpoint, Sine))
    sensors = rig.sensors
    if not noisy:
        sensors = sensors._replace(pressure_noise=0.0, position_resolution=1e-7, spool_noise=0.0)
    recording = record(replace(rig, sensors=sensors), test, campaign.model)
    started = recording.time_s > STARTED_S
    levels = []
    for name in (filter_name, DEFAULT_FILTER):
        # The filter assumes the noise of the data sheet, even if the transducers have none.
        run = filter_recording(recording, campaign.model, name, rig.sensors)
        mean = np.abs(run.innovation[started, 1:3]).mean(axis=0)
        levels.append((float(mean[0]), float(mean[1])))
    return HealthyLevel(*levels)


def empty_chamber(par: Parameters) -> tuple[float, float]:
    """Return the ram positions (m) at which chamber 1 and chamber 2 have no volume (eq. 2.4)."""
    return (
        par.stroke_min - par.line_volume_1 / par.piston_area,
        par.stroke_max + par.line_volume_2 / par.piston_area,
    )


def euler_error(rig_name: str) -> tuple[float, float]:
    """Return the mean absolute error (Pa) of both pressures in a forward-Euler step (eq. 2.15).

    Each step begins at the true states of the healthy sine of section 5.1, run on the rig
    `rig_name`; there is neither a filter nor noise.
    """
    campaign, rig = load_campaign("open_loop_5_1", rig_name)
    test = next(t for t in campaign.tests if not t.faults)
    command = test.setpoint.sample(np.arange(round(test.duration_s / TICK)) * TICK)
    truth = simulate(rig.plant, command, position=test.start_position_m)
    states = np.column_stack([truth[name] for name in _FILTER_ORDER])
    steps = zip(states[:-1], command[:-1], strict=True)
    predicted = np.array([thesis6_predict(x, u, campaign.model.parameters) for x, u in steps])
    missed = np.abs(states[1:] - predicted).mean(axis=0)
    return float(missed[1]), float(missed[2])


@dataclass(frozen=True)
class OilColumn:
    """The oil column at one position of the ram.

    Attributes:
        position: of the ram, m.
        resonance: of mass and oil, rad/s.
        growth: factor of a forward-Euler step, the largest magnitude of an eigenvalue of A (eq.
            4.19).
    """

    position: float
    resonance: float
    growth: float


def oil_column(par: Parameters, position: float) -> OilColumn:
    """Return the oil column at a ram position (m), sliding at 0.2 m/s, pressures at half supply."""
    v1, v2 = chamber_volumes(position, par)
    stiffness = par.piston_area**2 * par.bulk_modulus * (1.0 / v1 + 1.0 / v2)
    half = 0.5 * par.supply_pressure
    eigenvalues = np.linalg.eigvals(
        thesis6_jacobian(np.array([0.0, half, half, position, 0.2, 0.0]), par)
    )
    return OilColumn(
        position, float(np.sqrt(stiffness / par.moving_mass)), float(np.abs(eigenvalues).max())
    )


@dataclass(frozen=True)
class Chatter:
    """How often the velocity reverses, and how the innovations depend on the speed.

    A reversal is a change from sliding in one direction (faster than v_o, eq. 2.17) to sliding in
    the other direction.

    Attributes:
        true_reversals, estimated_reversals: reversals per second of true and estimated velocity.
        slow, fast: mean absolute innovations of pressures 1 and 2 (Pa) at low and at high speed.
    """

    true_reversals: float
    estimated_reversals: float
    slow: tuple[float, float]
    fast: tuple[float, float]


def chatter(trial: Trial, speed: float) -> Chatter:
    """Compare a thesis filter's velocity with the true one; a true speed below `speed` is slow.

    The trial's first `STARTED_S` are left out. An innovation is NaN if no sample has its speed.
    """
    started = trial.recording.time_s > STARTED_S
    truth = trial.recording["true_velocity_m_per_s"][started]
    run = trial.thesis.run
    innovation = np.abs(run.innovation[started, 1:3])
    slow = np.abs(truth) < speed

    def reversals(velocity: Array) -> float:
        sliding = np.sign(velocity[np.abs(velocity) > trial.model.parameters.stick_velocity])
        return float(np.count_nonzero(sliding[1:] != sliding[:-1]) / (velocity.size * TICK))

    def level(part: NDArray[np.bool_]) -> tuple[float, float]:
        mean = innovation[part].mean(axis=0)
        return float(mean[0]), float(mean[1])

    estimated = run.states[started, VELOCITY]
    return Chatter(reversals(truth), reversals(estimated), level(slow), level(~slow))


@dataclass(frozen=True)
class HiddenLeak:
    """The error that an internal leak causes in the velocity estimated by a thesis filter, m/s.

    Attributes:
        error: mean of estimated less true velocity, before and after the leak; velocities are
            positive away from the chamber with the higher pressure.
        leak: mean magnitude of the true leak flow, after the leak, divided by the piston area.
    """

    error: Change
    leak: float


def hidden_leak(trial: Trial, velocity: Array) -> HiddenLeak:
    """Compare a filter's velocity (n,), m/s, with the true one, in a test with an internal leak."""
    recording = trial.recording
    side = np.sign(recording["true_pressure_1_Pa"] - recording["true_pressure_2_Pa"])
    error = side * (velocity - recording["true_velocity_m_per_s"])
    flow = np.abs(recording["true_leak_internal_m3_per_s"]) / trial.model.parameters.piston_area
    time_s, leak = recording.time_s, trial.leak
    return HiddenLeak(change(error, time_s, leak), change(flow, time_s, leak).after or 0.0)


def noise_ranges(trials: Trials, trial: Trial) -> tuple[Array, Array]:
    """Repeat a test with different sensor noise; return its averages after the leak, Pa.

    Args:
        trials: the campaign's trials, from which rig and thesis filter are taken.
        trial: the one of them whose test is repeated, on the simulated rig.

    Returns:
        Two arrays (`REPEATS`, 2) of the averaged absolute innovations of both pressures: for the
        thesis filter as printed, and for the one that trusts the encoder (see `trusted`). NaN where
        there is no average.
    """
    printed, trusted = np.empty((REPEATS, 2)), np.empty((REPEATS, 2))
    for i in range(REPEATS):
        test = replace(trial.test, seed=trial.test.seed + 1 + i)
        recording = record(trials.rig, test, trial.model)
        run = filter_recording(recording, trial.model, trials.filter_name, trials.rig.sensors)
        other = run_trusted(recording, trial.model, trials.filter_name)
        for averages, outputs in ((printed, run.outputs), (trusted, other.outputs)):
            for j in range(2):
                after = average_change(outputs[:, 1 + j], recording.time_s, trial.leak).after
                averages[i, j] = np.nan if after is None else after
    return printed, trusted


@dataclass(frozen=True)
class Stretch:
    """Figures of a filter over some seconds of a healthy run.

    Attributes:
        start_s, end_s: beginning and end of the stretch.
        mean, median, largest: statistics of the absolute innovation of pressure 1, Pa.
        position_error: mean absolute innovation of the position, m.
        lowest, highest: range of the estimated position, m.
    """

    start_s: float
    end_s: float
    mean: float
    median: float
    largest: float
    position_error: float
    lowest: float
    highest: float


def stretches(trial: Trial, states: Array, outputs: Array, length_s: float) -> Iterator[Stretch]:
    """Yield the figures of a thesis filter over each `length_s` of a trial.

    The trial's first sample is left out; the last stretch may be shorter. `states` (n, 6 or 7) and
    `outputs` (n, 10) are the filter's, row by row.
    """
    time_s = trial.recording.time_s
    for start in np.arange(0.0, time_s[-1], length_s):
        part = (time_s > start) & (time_s <= start + length_s)
        innovation = np.abs(outputs[part, 1])
        position = states[part, POSITION]
        yield Stretch(
            float(start),
            float(start + length_s),
            float(innovation.mean()),
            float(np.median(innovation)),
            float(innovation.max()),
            float(np.abs(outputs[part, 0]).mean()),
            float(position.min()),
            float(position.max()),
        )
