"""Every effect of the catalogue shows on the simulated loop in the channel that it should."""

from collections.abc import Callable
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import start_memory
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import CATALOGUE, NO_FAULT, Model
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET

Array = NDArray[np.float64]
Run = dict[str, Array]

QUIET: Final = DATA_SHEET._replace(
    pressure_noise=0.0, spool_noise=0.0, supply_pressure_noise=0.0, pressure_min=-1e6
)
COUNT: Final = DATA_SHEET.position_resolution
TIME: Final = np.arange(1000) * TICK
COMMAND: Final = 3.0 * np.sin(4.0 * np.pi * TIME) + np.where(TIME > 0.5, 2.0, 0.0)


def run(model: Model) -> Run:
    """Return what is recorded of a second in open loop with silent transducers."""
    memory = start_memory("product", Model(), QUIET)
    faults = np.tile(np.array(NO_FAULT), (TIME.size, 1))
    motion = Motion(COMMAND, True, faults, 0.3, 300)
    loop = SimulatedLoop(simulated_rig(model, 1, sensors=QUIET), motion, memory, Model().parameters)
    loop.position()
    rows = loop.advance(TIME.size)
    return dict(zip(loop.channels, rows.T.copy(), strict=True))


@pytest.fixture(scope="module")
def plain() -> Run:
    return run(Model())


def gap(channel: str) -> Callable[[Run, Run], float]:
    """Return by how much the mean of a channel is higher with the effect."""
    return lambda found, plain: float((found[channel] - plain[channel]).mean())


def more(channel: str, of: Callable[[Array], object] = np.std) -> Callable[[Run, Run], float]:
    """Return by how much more a channel has of something with the effect."""
    return lambda found, plain: float(of(found[channel])) - float(of(plain[channel]))  # type: ignore[arg-type]


def fewer(channel: str, of: Callable[[Array], object] = np.std) -> Callable[[Run, Run], float]:
    return lambda found, plain: -more(channel, of)(found, plain)


def drop(run: Run) -> Array:
    return run["true_pressure_1_Pa"] - run["true_pressure_2_Pa"]


def resisted(run: Run) -> float:
    """Return the mean pressure drop against the motion."""
    return float((drop(run) * np.sign(run["true_velocity_m_per_s"])).mean())


def span(values: Array) -> float:
    return float(np.ptp(values))


def roughness(values: Array) -> float:
    return float(np.abs(np.diff(values, 2)).sum())


SHOWS: Final[dict[str, tuple[dict[str, float], Callable[[Run, Run], float]]]] = {
    "spool_null_bias": ({"value": 1e-5}, gap("position_m")),
    "valve_deadband": ({"value": 2e-5}, fewer("true_position_m", span)),
    "valve_underlap_leakage": ({"value": 2e-5}, more("true_position_m", span)),
    "valve_flow_asymmetry": ({"value": 0.2}, lambda a, b: float((a["true_pressure_2_Pa"]
                             - b["true_pressure_2_Pa"])[800:].mean())),
    "valve_hysteresis": ({"value": 1e-5}, fewer("spool_m", span)),
    "valve_bandwidth": ({"value": 300.0},
                        lambda a, b: float(b["spool_m"][505] - a["spool_m"][505])),
    "valve_rate_limit": ({"value": 5e-3}, fewer("spool_m", lambda x: np.abs(np.diff(x)).max())),
    "command_delay": ({"value": 0.005}, lambda a, b: float(b["spool_m"][510] - a["spool_m"][503])),
    "entrained_air": ({"value": 0.03}, fewer("true_pressure_1_Pa", roughness)),
    "bulk_modulus": ({"value": 4e8}, fewer("true_pressure_1_Pa", roughness)),
    "supply_pressure": ({"value": 1.5e7}, gap("supply_pressure_Pa")),
    "supply_droop": ({"value": 5e12}, lambda a, b: -gap("supply_pressure_Pa")(a, b)),
    "supply_ripple": ({"amplitude": 3e5, "frequency": 90.0}, more("supply_pressure_Pa")),
    "return_back_pressure": ({"value": 5e12}, gap("true_return_pressure_Pa")),
    "friction_asymmetry": ({"value": 300.0}, lambda a, b: float((drop(a) - drop(b))[800:].mean())),
    "stiction_level": ({"value": 3.5e3}, lambda a, b: drop(a).max() - drop(b).max()),
    "coulomb_level": ({"value": 2e3}, lambda a, b: resisted(a) - resisted(b)),
    "stribeck_velocity": ({"value": 0.1}, lambda a, b: resisted(a) - resisted(b)),
    "viscous_friction": ({"value": 2e3}, lambda a, b: float((drop(a) - drop(b))[800:].mean())),
    "presliding_compliance": ({"value": 4e6}, fewer("true_pressure_1_Pa", roughness)),
    "internal_leakage": ({"value": 1e-8}, gap("flow_internal_m3_per_s")),
    "external_leakage_1": ({"value": 1e-8}, gap("flow_1_m3_per_s")),
    "external_leakage_2": ({"value": 1e-8}, gap("flow_2_m3_per_s")),
    "spring_load": ({"stiffness": 2e4, "contact": 0.2}, gap("load_N")),
    "constant_force": ({"value": 2e3}, lambda a, b: float((drop(a) - drop(b)).mean())),
    "payload_mass": ({"value": 300.0}, lambda a, b: span(drop(a)) - span(drop(b))),
    "end_stop": ({"high": 0.32}, lambda a, b: float(
        (a["true_position_m"].max() < 0.321) and (b["true_position_m"].max() > 0.33))),
}  # fmt: skip


@pytest.mark.parametrize("name", SHOWS)
def test_an_effect_shows_where_it_should(name: str, plain: Run) -> None:
    values, by_how_much = SHOWS[name]
    assert by_how_much(run(Model().with_effect(name, **values)), plain) > 0.0


def test_every_effect_is_shown_here() -> None:
    shown = {name for name in CATALOGUE if name.startswith(("pressure_", "position_"))}
    assert SHOWS.keys() | shown == CATALOGUE.keys()
    assert shown == EXPECTED.keys()


def of_lag(pressure: Array, lag: float) -> Array:
    """Return a first-order lag of a signal sampled each ms and taken to change evenly."""
    fine = np.interp(np.arange(0.0, TIME.size - 1 + 1e-9, 0.01), np.arange(TIME.size), pressure)
    seen = np.empty_like(fine)
    seen[0] = fine[0]
    kept = np.exp(-0.01 * TICK / lag)
    for k in range(1, fine.size):
        seen[k] = kept * seen[k - 1] + (1.0 - kept) * 0.5 * (fine[k] + fine[k - 1])
    return seen[::100]


def of_play(position: Array, width: float) -> Array:
    shown, at = np.empty_like(position), position[0]
    for k, x in enumerate(position):
        at = min(max(at, x - 0.5 * width), x + 0.5 * width)
        shown[k] = at
    return shown


EXPECTED: Final[dict[str, tuple[float, str, str, Callable[[Array], Array], float]]] = {
    "pressure_1_bias": (2.5e5, "pressure_1_Pa", "true_pressure_1_Pa", lambda p: p + 2.5e5, 1.0),
    "pressure_2_bias": (-2e5, "pressure_2_Pa", "true_pressure_2_Pa", lambda p: p - 2e5, 1.0),
    "pressure_1_gain": (1.1, "pressure_1_Pa", "true_pressure_1_Pa", lambda p: 1.1 * p, 1.0),
    "pressure_2_gain": (0.9, "pressure_2_Pa", "true_pressure_2_Pa", lambda p: 0.9 * p, 1.0),
    "pressure_lag": (0.01, "pressure_2_Pa", "true_pressure_2_Pa",
                     lambda p: of_lag(p, 0.01), 2e3),
    "position_gain": (1.05, "position_m", "true_position_m", lambda x: 1.05 * x, 0.5 * COUNT),
    "position_delay": (0.0034, "position_m", "true_position_m",
                       lambda x: np.interp(TIME - 0.0034, TIME, x), 0.5 * COUNT),
    "position_backlash": (1e-3, "position_m", "true_position_m",
                          lambda x: of_play(x, 1e-3), 0.5 * COUNT),
}  # fmt: skip


@pytest.mark.parametrize("name", EXPECTED)
def test_a_transducers_effect_is_in_its_reading_and_never_in_the_truth(
    name: str, plain: Run
) -> None:
    value, reading, truth, expected, tolerance = EXPECTED[name]
    model = Model().with_effect(name, value=value)
    found = run(model)
    if not name.startswith("position"):  # by which the ram is brought to its start
        assert np.array_equal(found[truth], plain[truth])
    settled = slice(100, None)  # what was before the first sample is not in the recording
    wanted = expected(found[truth])
    if name == "position_backlash":  # nor where in its play the encoder was
        settled = slice(400, None)
    assert np.abs(found[reading] - wanted)[settled].max() < tolerance * 1.001 + 1e-9
    others = {"position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m"} - {reading}
    if name != "pressure_lag" and not name.startswith("position"):
        assert all(np.array_equal(found[other], plain[other]) for other in others)
