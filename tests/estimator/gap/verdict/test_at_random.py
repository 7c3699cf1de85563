"""A command that acts at random times is told from causes that leave errors as its rate grows."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gap.verdict.at_random import lasting_part, predicted_part, random_delays
from estimator.gap.verdict.unsettled import Unsettled

Array = NDArray[np.float64]
TICK = 1e-3
LENGTH = 20
VOLTS = "command_V"


def command(seed: int) -> Array:
    """15 s of a command that swings at three frequencies, each second half of 3 s at rest."""
    time = TICK * np.arange(15000)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 3)
    swings = sum(
        np.sin(2.0 * np.pi * hertz * time + phase)
        for hertz, phase in zip((0.7, 3.1, 8.3), phases, strict=True)
    )
    return np.where(time % 3.0 < 1.5, swings, 0.0)


def at_random_times(u: Array, noise: np.random.Generator) -> Array:
    """Errors of a command that is late at each sample by a time of its own, up to 12 ms."""
    late = noise.integers(0, 12, len(u)) - 6
    return np.asarray(20.0 * (u[np.clip(np.arange(len(u)) - late, 0, len(u) - 1)] - u))


def behind_a_filter(u: Array, noise: np.random.Generator) -> Array:
    """Errors of a command that passes a filter of 5 ms, which the model does not have."""
    seen = np.zeros_like(u)
    for k in range(1, len(u)):
        seen[k] = seen[k - 1] + 0.2 * (u[k] - seen[k - 1])
    return np.asarray(10.0 * (seen - u))


def that_rings(u: Array, noise: np.random.Generator) -> Array:
    """Errors of a pilot stage that swings at 40 Hz when the command moves."""
    swing = np.zeros_like(u)
    for k in range(2, len(u)):
        swing[k] = 1.95 * np.cos(0.25) * swing[k - 1] - 0.95 * swing[k - 2] + u[k] - u[k - 1]
    return np.asarray(10.0 * swing)


def with_dry_friction(u: Array, noise: np.random.Generator) -> Array:
    """Errors of a spool that lags by a constant width while the command moves."""
    return np.asarray(-2.0 * np.sign(np.diff(u, prepend=u[0])))


def errors_of(cause: Callable[[Array, np.random.Generator], Array]) -> tuple[list[Array], ...]:
    """Return the errors (n,) in standard deviations and the inputs (n,) of two recordings."""
    inputs = [command(seed) for seed in (1, 2)]
    noise = np.random.default_rng(3)
    return [cause(u, noise) + noise.standard_normal(len(u)) for u in inputs], inputs


def test_what_acts_at_random_times_neither_follows_from_the_command_nor_lasts() -> None:
    errors, inputs = errors_of(at_random_times)
    assert np.mean(np.square(errors)) > 2.0
    assert predicted_part(errors, inputs, 1.0, LENGTH) < 0.1
    assert lasting_part(errors, 1.0, LENGTH) < 0.1


@pytest.mark.parametrize("cause", [behind_a_filter, that_rings, with_dry_friction])
def test_what_is_not_random_follows_from_the_command_or_lasts(
    cause: Callable[[Array, np.random.Generator], Array],
) -> None:
    errors, inputs = errors_of(cause)
    follows = predicted_part(errors, inputs, 1.0, LENGTH)
    assert max(follows, lasting_part(errors, 1.0, LENGTH)) > 0.6


def test_noise_alone_has_no_part_of_an_excess_that_it_does_not_have() -> None:
    errors = [np.random.default_rng(4).standard_normal(5000)]
    assert predicted_part(errors, [command(1)[:5000]], 1.1, LENGTH) == 0.0
    assert lasting_part(errors, 1.1, LENGTH) == 0.0


def found_with(
    cause: Callable[[Array, np.random.Generator], Array], region: str, values: tuple[float, ...]
) -> list[Any]:
    """Return what is discovered where the errors of the spool depend on a region in this way."""
    errors, inputs = errors_of(cause)
    plant = SimpleNamespace(
        inputs=(VOLTS,), outputs=(SimpleNamespace(channel="spool_m"),), horizon=0.02, period=TICK
    )
    filtered: Any = SimpleNamespace(
        predictor=SimpleNamespace(plant=plant),
        innovations=lambda values: [(e[:, None], None) for e in errors],
        records=[SimpleNamespace(inputs=u[:, None]) for u in inputs],
        blocks=[[slice(0, 7500), slice(7500, 15000)]] * 2,
    )
    at = np.linspace(0.0, 90.0, len(values))
    of_spool = Unsettled(
        "spool_m", region, at, np.array(values), 0.01 + 0.0 * at, 1.5, "V/s", 1.0, 2.0
    )
    return random_delays(filtered, {}, [of_spool])


def test_a_command_that_acts_at_random_times_is_named_and_is_in_no_model() -> None:
    (found,) = found_with(at_random_times, f"rate of {VOLTS}", (0.0, 0.5, 4.0))
    assert (found.name, found.place, found.of) == ("random_delay", VOLTS, "")
    assert not found.in_model
    assert "a bus or a controller" in found.parts
    assert "acts at random times: squared errors of spool_m grow" in found.what


def test_nothing_is_named_where_errors_go_with_another_quantity_or_are_not_random() -> None:
    assert not found_with(at_random_times, "velocity", (0.0, 0.5, 4.0))
    assert not found_with(at_random_times, f"rate of {VOLTS}", (0.0, 4.0, 0.5))
    assert not found_with(behind_a_filter, f"rate of {VOLTS}", (0.0, 0.5, 4.0))
