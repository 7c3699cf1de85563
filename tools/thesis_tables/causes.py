"""Why the thesis's filters show what they show: what their healthy level is made of, and how one runs away."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.setpoints import Sine
from estimator.filters import run_filter
from estimator.pattern import STARTED_S
from estimator.replay import samples_of
from estimator.thesis import thesis6_jacobian, thesis6_predict
from rig.configuration.campaign import load_campaign
from rig.plant import Parameters
from rig.plant.dynamics import chamber_volumes
from rig.plant.integrator import TICK
from rig.plant.simulation import simulate

from .measures import Change, change
from .trials import Trial, record

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
"""Where the thesis filters keep the velocity among their states."""
POSITION: Final = 3

MOTIONS: Final = (
    ("open_loop_5_1", "thesis-6"),
    ("closed_loop_sine_5_2_1", "thesis-6"),
    ("simulation_7_1", "thesis-7"),
    ("loaded_7_2", "thesis-7"),
)
"""Campaigns whose healthy sine is run on every rig, and the thesis's filter for them."""

RIGS: Final = (
    ("simulated", True, "`simulated`: imperfections the filter does not know"),
    ("ideal", True, "`ideal`: none; bristle friction, which the filter does not know"),
    ("thesis", True, "`thesis`: none, Karnopp friction as in the filter"),
    ("thesis", False, "the same behind perfect transducers"),
)
"""Rigs from most to least different from the model: name, whether their transducers are noisy, label."""


@dataclass(frozen=True)
class HealthyLevel:
    """Mean absolute innovations of both pressures on one healthy run, Pa."""

    thesis: tuple[float, float]
    product: tuple[float, float]


def healthy_level(campaign_name: str, filter_name: str, rig_name: str, noisy: bool) -> HealthyLevel:
    """Return the level on the campaign's healthy sine, run on another rig of the shipped ones."""
    campaign, rig = load_campaign(campaign_name, rig_name)
    test = next(t for t in campaign.tests if not t.faults and isinstance(t.setpoint, Sine))
    sensors = rig.sensors
    if not noisy:
        sensors = sensors._replace(pressure_noise=0.0, position_resolution=1e-7, spool_noise=0.0)
    recording = record(replace(rig, sensors=sensors), test, campaign.model)
    samples = samples_of(recording)
    measured = np.column_stack(
        [samples.position, samples.pressure_1, samples.pressure_2, samples.spool]
    )
    started = samples.time_s > STARTED_S
    levels = []
    for name in (filter_name, "product"):
        run = run_filter(samples.time_s, samples.command, measured, campaign.model, name, rig.sensors)
        mean = np.abs(run.innovation[started, 1:3]).mean(axis=0)
        levels.append((float(mean[0]), float(mean[1])))
    return HealthyLevel(*levels)


def empty_chamber(par: Parameters) -> tuple[float, float]:
    """Return the positions in m at which chamber 1, and chamber 2, would have no volume (eq. 2.4)."""
    return (
        par.stroke_min - par.line_volume_1 / par.piston_area,
        par.stroke_max + par.line_volume_2 / par.piston_area,
    )


def euler_error(rig_name: str) -> tuple[float, float]:
    """Return by how many Pa one forward-Euler step (eq. 2.15) from the true state misses each pressure.

    Mean absolute values over the healthy sine of section 5.1: no filter, no noise.
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
    """The oil column at a ram position in m: its resonance in rad/s, and how much one forward-Euler
    step of 1 ms multiplies it by (largest eigenvalue of eq. 4.19)."""

    position: float
    resonance: float
    growth: float


def oil_column(par: Parameters, position: float) -> OilColumn:
    """Return the oil column's resonance and growth; ram sliding at 0.2 m/s, pressures at half supply."""
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
    """How a filter's velocity reverses, and its innovations of both pressures (Pa), slow and fast."""

    true_reversals: float
    estimated_reversals: float
    slow: tuple[float, float]
    fast: tuple[float, float]


def chatter(trial: Trial, speed: float) -> Chatter:
    """Return reversals a second of true and estimated velocity, and levels below and above `speed` m/s."""
    started = trial.recording.time_s > STARTED_S
    truth = trial.recording["true_velocity_m_per_s"][started]
    run = trial.thesis.run
    innovation = np.abs(run.innovation[started, 1:3])
    slow = np.abs(truth) < speed

    def reversals(velocity: Array) -> float:
        side = velocity > 0.0
        return float((side[1:] != side[:-1]).mean() / TICK)

    def level(part: NDArray[np.bool_]) -> tuple[float, float]:
        mean = innovation[part].mean(axis=0)
        return float(mean[0]), float(mean[1])

    estimated = run.states[started, VELOCITY]
    return Chatter(reversals(truth), reversals(estimated), level(slow), level(~slow))


@dataclass(frozen=True)
class HiddenLeak:
    """What an internal leak does to the velocity that a thesis filter estimates, m/s.

    Attributes:
        error: estimated less true velocity, positive from the higher to the lower pressure; its mean.
        leak: mean leak over piston area: the velocity at which the ram would displace as much.
    """

    error: Change
    leak: float


def hidden_leak(trial: Trial, velocity: Array) -> HiddenLeak:
    """Compare a filter's velocity (n,) in m/s with the truth of a test with an internal leak."""
    recording = trial.recording
    side = np.sign(recording["true_pressure_1_Pa"] - recording["true_pressure_2_Pa"])
    error = side * (velocity - recording["true_velocity_m_per_s"])
    flow = np.abs(recording["true_leak_internal_m3_per_s"]) / trial.model.parameters.piston_area
    return HiddenLeak(change(error, trial), change(flow, trial).after or 0.0)


@dataclass(frozen=True)
class Stretch:
    """What a filter did over some seconds of a healthy run, SI.

    Attributes:
        start_s, end_s: which.
        mean, median, largest: of the absolute innovation of pressure 1, Pa.
        position_error: mean absolute innovation of the position, m.
        lowest, highest: of the estimated position, m.
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
    """Yield what a thesis filter did in each `length_s` of a trial, its first sample left out."""
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
