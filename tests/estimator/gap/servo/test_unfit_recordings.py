"""Recordings that cannot support a verdict get none, and a reason; they are of an independent rig.

What needs no fit to be told is tested here; other rigs, swapped columns and the like go through a
whole search, and are tried by hand (docs/gap.md).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.verdict.workflow import find_gap
from rig.plant import Model
from rig.recording import Recording
from tools.hidden_effects.motions import drawn
from tools.hidden_effects.recordings import COLUMNS, record
from tools.hidden_effects.rig_values import TABLE

Channels = dict[str, NDArray[np.float64]]
PLANT = servo_actuator(Model())


@cache
def whole(motion: str, seconds: float, seed: int) -> Recording:
    """A rig with a deadband, in a motion drawn from a seed."""
    rng = np.random.default_rng(seed)
    rig = TABLE._replace(overlap=8e-6)
    table = record(rig, drawn(motion, rng, round(1e3 * seconds)), rng).table
    return Recording({name: table[:, i].copy() for i, name in enumerate(COLUMNS)})


def altered(recording: Recording, change: Callable[[Channels], Channels]) -> Recording:
    channels = {name: recording[name].copy() for name in COLUMNS}
    return Recording(channels | change(channels))


def noise(like: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    return np.asarray(size * np.random.default_rng(3).standard_normal(len(like)))


def burst(values: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Lose a share of the readings, 50 at a time."""
    lost = np.random.default_rng(4).random(len(values) // 50 + 1) < share
    return np.where(lost[np.arange(len(values)) // 50], np.nan, values)


UNFIT: dict[str, tuple[Callable[[Channels], Channels], str]] = {
    "too short": (lambda c: {name: values[:3000] for name, values in c.items()}, "too short"),
    "pressures in bar": (
        lambda c: {f"pressure_{i}_Pa": 1e-5 * c[f"pressure_{i}_Pa"] for i in (1, 2)},
        "is it in Pa?",
    ),
    "position in mm": (lambda c: {"position_m": 1e3 * c["position_m"]}, "is it in m?"),
    "spool in percent": (lambda c: {"spool_m": c["spool_m"] / 2.794e-6}, "is it in m?"),
    "a constant channel": (lambda c: {"pressure_1_Pa": 0.0 * c["position_m"] + 7e6}, "hardly"),
    "a command that rests": (lambda c: {"command_V": 0.0 * c["command_V"]}, "never changes"),
    "a saturated channel": (lambda c: {"pressure_2_Pa": 0.0 * c["position_m"]}, "end of its range"),
    "all noise": (lambda c: {"pressure_2_Pa": 7e6 + noise(c["time_s"], 2e6)}, "mostly noise"),
    "readings lost": (lambda c: {"position_m": burst(c["position_m"], 0.6)}, "missing"),
    "pressures mixed up": (
        lambda c: {"pressure_1_Pa": c["pressure_2_Pa"], "pressure_2_Pa": c["pressure_1_Pa"]},
        "pressure_1_Pa and pressure_2_Pa are mixed up",
    ),
}


@pytest.mark.parametrize("name", UNFIT)
def test_what_cannot_support_a_verdict_names_nothing_and_says_why(name: str) -> None:
    change, words = UNFIT[name]
    fitted = altered(whole("multisine", 6.0, 1), change)
    result = find_gap([fitted], [whole("multisine", 4.0, 2)], PLANT)
    assert result.verdict == "inconclusive"
    assert result.effects == []
    assert any(words in reason for reason in result.reasons), result.reasons
    assert result.values == dict(PLANT.nominal)


@pytest.mark.long
def test_bursts_of_lost_readings_cost_no_verdict() -> None:
    channels = ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
    fitted = altered(whole("multisine", 6.0, 1), lambda c: {n: burst(c[n], 0.05) for n in channels})
    few = ("valve_deadband", "spool_null_bias", "valve_hysteresis")
    plant = replace(PLANT, effects={name: PLANT.effects[name] for name in few})
    result = find_gap([fitted], [whole("multisine", 4.0, 2)], plant)
    assert [effect.name for effect in result.effects] == ["valve_deadband"]
    (size,) = result.effects[0].parameters
    assert size.value == pytest.approx(8e-6, rel=0.02)


@pytest.mark.parametrize("motion", ["standstill", "no_command", "in_the_seals"])
def test_a_motion_that_shows_nothing_names_nothing(motion: str) -> None:
    result = find_gap([whole(motion, 6.0, 1)], [whole("multisine", 4.0, 2)], PLANT)
    assert result.verdict == "inconclusive"
    assert result.reasons
    assert result.effects == []
