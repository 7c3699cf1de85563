from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from control.setpoints import (
    Chirp,
    Constant,
    Multisine,
    Pseudorandom,
    Setpoint,
    Sine,
    Steps,
    Trapezoid,
    Triangle,
)
from rig.configuration.sweeps.distributions import Distribution
from rig.configuration.sweeps.sweep_plan import MotionType, SweptMotion
from rig.lanes import LANES
from rig.sweep.motions import Motions, Streams, drawn_motions
from rig.sweep.ticks import scale_sines, setpoint_ticks

Array = NDArray[np.float64]
TICKS = 12_000
SECONDS = 12.0


def motion(kind: MotionType, **values: float | tuple[float, ...]) -> SweptMotion:
    listed = {key: value if isinstance(value, tuple) else (value,) for key, value in values.items()}
    laws = {
        key: tuple(Distribution("fixed", (value,)) for value in given)
        for key, given in listed.items()
    }
    return SweptMotion(kind, kind, 1.0, "position", laws)


def made(one: SweptMotion) -> Motions:
    return drawn_motions([one], Streams(5, 0, LANES), SECONDS)[0]


def sampled(motions: Motions) -> Array:
    setpoint, held = np.empty((TICKS, LANES)), np.zeros((1, LANES))
    for first in range(0, TICKS, 500):
        setpoint_ticks(first, motions.sines, motions.wave, motions.levels, motions.ends, held,
                       setpoint[first : first + 500])  # fmt: skip
    return setpoint


SETPOINTS: list[tuple[SweptMotion, Callable[[int], Setpoint]]] = [
    (motion("constant", value=0.3), lambda _: Constant(0.3)),
    (
        motion("sine", mean=0.3, amplitude=0.1, frequency=0.7, phase=0.4),
        lambda _: Sine(0.3, 0.1, 0.7, 0.4),
    ),
    (
        motion("triangle", mean=0.3, amplitude=0.1, frequency=0.7, phase=0.4),
        lambda _: Triangle(0.3, 0.1, 0.7, 0.4),
    ),
    (
        motion("trapezoid", mean=0.3, amplitude=0.1, frequency=0.7, hold=0.2, phase=0.4),
        lambda _: Trapezoid(0.3, 0.1, 0.7, 0.2, 0.4),
    ),
    (
        motion("chirp", mean=0.3, amplitude=0.1, start_frequency=0.2, end_frequency=2.0, phase=0.0),
        lambda _: Chirp(0.3, 0.1, 0.2, 1.8 / SECONDS),
    ),
    (motion("steps", levels=(0.2, 0.4, 0.3), hold=1.7), lambda _: Steps((0.2, 0.4, 0.3), 1.7)),
    (
        motion("pseudorandom", lower=0.1, upper=0.5, hold_min=0.2, hold_max=1.0),
        lambda lane: Pseudorandom(
            0.1, 0.5, 0.2, 1.0, int(Streams(5, 0, LANES).seeds("motion pseudorandom")[lane])
        ),
    ),
]


@pytest.mark.parametrize(("one", "setpoint"), SETPOINTS, ids=lambda each: getattr(each, "type", ""))
def test_a_motion_is_the_setpoint_of_that_type(
    one: SweptMotion, setpoint: Callable[[int], Setpoint]
) -> None:
    motions = made(one)
    found = sampled(motions)
    np.testing.assert_allclose(motions.begins(), found[0], atol=1e-9)
    times = np.arange(TICKS) * 1e-3
    for lane in range(LANES):
        # Sines are series here, right to 1e-9.
        np.testing.assert_allclose(found[:, lane], setpoint(lane).sample(times), atol=1e-9)


def test_a_multisine_comes_to_its_amplitude_and_no_further() -> None:
    motions = made(motion("multisine", mean=0.3, amplitude=0.1, frequencies=(0.3, 0.7, 1.9)))
    scale_sines(motions.sines, motions.peak[None, :].copy(), TICKS)
    peak = np.abs(sampled(motions) - 0.3).max(axis=0)
    np.testing.assert_allclose(peak, 0.1, rtol=6e-3)
    assert np.unique(motions.sines[3]).size == LANES  # phases of their own
    assert Multisine(0.3, 0.1, (0.3, 0.7, 1.9)).peak_rate(SECONDS) > 0.0
