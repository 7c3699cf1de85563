"""A disturbance is named by how it looks, and said in a sentence with units."""

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from hypothesis import given, strategies as st

from estimator.gap.plant.additions import Addition
from estimator.gap.plant.interface import Plant
from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.verdict.lexicon import LEXICON, is_leak, likely_parts, shape_of
from estimator.gap.verdict.sentences import sentence, shown
from rig.plant import Model

FORCE, LEVEL, FLOW, ACROSS = (
    "force balance", "friction level", "flow, chamber 1", "leak across the piston",
)  # fmt: skip
PRESSURES, STROKE, SPEEDS, SECONDS = (1e6, 8e6), (0.15, 0.45), (-0.3, 0.3), (0.0, 15.0)


@cache
def plant() -> Plant:
    return servo_actuator(Model())


def table(place: str, of: str, reach: tuple[float, float], shape: str, seed: int) -> Addition:
    """Return a table of nine knots that looks like a shape, with noise of a few per cent."""
    at = np.linspace(*reach, 9)
    along = (at - reach[0]) / (reach[1] - reach[0])
    values = {
        "rising": 1.0 + 2.0 * along,
        "rising from below": 3.0 * along - 1.0,
        "falling then rising": np.abs(along - 0.5),
        "beyond": np.maximum(along - 0.6, 0.0),
        "at one place": np.exp(-(((along - 0.5) / 0.12) ** 2)),
        "uneven": np.sin(9.0 * along) + along,
        "squared": at * np.abs(at) / reach[1] ** 2,
        "odd": np.tanh(8.0 * at / reach[1]),
        "flat": 1.0 + 0.0 * along,
        "at once": np.where(along > 0.45, 1.0, 0.0),
        "clipped": np.clip(3.0 * (along - 0.5), -0.7, 0.7),
    }[shape]
    noise = 0.02 * np.ptp(values) if np.ptp(values) > 0.0 else 0.02
    values = values + np.random.default_rng(seed).normal(size=len(at)) * noise
    return Addition(place, of, "", "table", tuple(map(float, at)), tuple(map(float, values)))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("place", "of", "reach", "shape", "name"),
    [
        (LEVEL, "pressure 1", PRESSURES, "rising", "grows_with_pressure"),
        (LEVEL, "pressure 1", PRESSURES, "rising from below", "grows_with_pressure"),
        (FLOW, "pressure 1", PRESSURES, "falling then rising", "depends_on_pressure"),
        (FLOW, "pressure 1", PRESSURES, "beyond", "threshold"),
        (FORCE, "position", STROKE, "beyond", "threshold"),
        (LEVEL, "position", STROKE, "at one place", "local_in_position"),
        (FORCE, "position", STROKE, "uneven", "depends_on_position"),
        (FORCE, "velocity", SPEEDS, "squared", "power_of_velocity"),
        (FORCE, "velocity", SPEEDS, "odd", "depends_on_velocity"),
        (FORCE, "position", STROKE, "flat", "constant"),
        (FORCE, "time", SECONDS, "at once", "step_in_time"),
        ("bulk modulus", "time", SECONDS, "rising", "trend"),
        ("spool", "command", (-10.0, 10.0), "clipped", "saturation"),
        ("valve edges", "spool opening", (-1e-4, 1e-4), "uneven", "depends_on_opening"),
    ],
)
def test_a_table_is_named_by_how_it_looks_whatever_its_noise(
    place: str, of: str, reach: tuple[float, float], shape: str, name: str, seed: int
) -> None:
    assert shape_of(table(place, of, reach, shape, seed), *reach, plant()) == name


@pytest.mark.parametrize(
    ("addition", "reach", "name"),
    [
        (Addition(FORCE, "position", "", "wave", (0.04, 0.0), (1.0,)), STROKE,
         "periodic_in_position"),
        (Addition(FLOW, "time", "", "wave", (0.05, 0.0), (1.0,)), SECONDS, "tone"),
        (Addition(LEVEL, "position", "", "bump", (0.3, 0.02), (1.0,)), STROKE,
         "local_in_position"),
        (Addition(FLOW, "pressure 1", "", "hinge", (5e6,), (-1.0,)), PRESSURES, "threshold"),
        (Addition("spool", "command", "", "beyond", (0.6,), (-2.6e-5,)), (-10.0, 10.0),
         "saturation"),
        (Addition("spool", "command", "", "table", (-10.0, -0.6, 0.6, 10.0),
                  (2.4e-4, 0.0, 0.0, -2.4e-4)), (-10.0, 10.0), "saturation"),
        (Addition(FORCE, "velocity", "", "beyond", (0.2,), (50.0,)), SPEEDS, "threshold"),
        (Addition(FORCE, "", "", "constant", (), (1.0,)), (0.0, 0.0), "constant"),
        (Addition(FORCE, "velocity", "", "x |x|", (), (1.0,)), SPEEDS, "power_of_velocity"),
        (Addition("reading of position_m", "velocity", "", "x", (), (-3e-3,)), SPEEDS, "lag"),
        (Addition("reading of pressure_1_Pa", "velocity", "", "x", (), (-3e3,)), SPEEDS,
         "depends_on_velocity"),
        (Addition("reading of position_m", "", "direction", "constant", (), (-3e-5,)),
         (0.0, 0.0), "play"),
        (Addition("spool", "direction", "", "table", (-1.0, 1.0), (-1e-6, 1e-6)), (-1.0, 1.0),
         "play"),
    ],
)  # fmt: skip
def test_a_form_in_symbols_is_named_by_what_it_depends_on(
    addition: Addition, reach: tuple[float, float], name: str
) -> None:
    assert shape_of(addition, *reach, plant()) == name


@given(
    st.sampled_from([FORCE, LEVEL, FLOW, "spool", "bulk modulus", "reading of pressure_2_Pa"]),
    st.sampled_from(["position", "velocity", "pressure 1", "spool opening", "command", "time"]),
    st.lists(st.floats(-1e3, 1e3), min_size=9, max_size=9),
)
def test_every_table_has_a_name_and_a_sentence_of_its_own(
    place: str, of: str, values: list[float]
) -> None:
    at = tuple(np.linspace(*STROKE, 9).tolist())
    addition = Addition(place, of, "", "table", at, tuple(values))
    name = shape_of(addition, *STROKE, plant())
    assert name in LEXICON
    assert likely_parts(name, place, plant())
    words = sentence(addition, name, (1.0,) * 9, plant(), *STROKE)
    assert words[0].isupper()
    assert "_" not in words
    # The size of a disturbance does not decide how it is called; its sign decides the noun alone.
    doubled = Addition(place, of, "", "table", at, tuple(2.0 * v for v in values))
    assert shape_of(doubled, *STROKE, plant()) == name


@pytest.mark.parametrize(
    ("addition", "errors", "reach", "words"),
    [
        (Addition(LEVEL, "pressure 1", "", "x", (), (4e-5,)), (1.5e-6,), PRESSURES,
         "Friction beside the model's that grows with the pressure in chamber 1, "
         "by 40.0 ± 2.9 N per MPa"),
        (Addition(FLOW, "pressure 1", "", "hinge", (4.5e6,), (-1.5e-12,)), (5e-14,), PRESSURES,
         "Oil out of chamber 1 that begins where the pressure in chamber 1 passes 4.5 MPa, and "
         "grows by 0.0900 ± 0.0059 L/min per MPa beyond"),
        (Addition(FORCE, "", "", "constant", (), (-300.0,)), (4.0,), (0.0, 0.0),
         "A force towards extension that is always there: 300.0 ± 7.8 N"),
        (Addition(FORCE, "position", "", "wave", (0.042, 0.4), (180.0,)), (4.0,), STROKE,
         "A force that swings along the position once every 42 mm, by 180.0 ± 7.8 N to either "
         "side"),
        (Addition("reading of position_m", "velocity", "", "x", (), (-3e-3,)), (), SPEEDS,
         "An error of the reading of position that grows with the velocity, as if it came 3 ms "
         "late"),
        (Addition(LEVEL, "position", "", "bump", (0.3, 0.02), (600.0,)), (20.0,), STROKE,
         "Friction beside the model's that acts where the position is about 300 mm, within 20 mm "
         "to either side: 600 ± 39 N in the middle"),
        (Addition("reading of pressure_1_Pa", "pressure 1", "", "play", (2e5,), (0.998,)), (5e-3,),
         PRESSURES,
         "An error of the reading of pressure 1 that follows the pressure in chamber 1 with a play "
         "of 0.4 MPa: 998.0 ± 9.8 kPa per MPa of its distance from the pressure in chamber 1"),
    ],
)  # fmt: skip
def test_a_sentence_says_what_acts_where_with_units(
    addition: Addition, errors: tuple[float, ...], reach: tuple[float, float], words: str
) -> None:
    name = shape_of(addition, *reach, plant())
    assert sentence(addition, name, errors, plant(), *reach) == words


@pytest.mark.parametrize(("turns", "words"), [(1, "once a turn"), (3, "3 times a turn")])
def test_a_wave_along_an_angle_is_told_in_turns(turns: int, words: str) -> None:
    angle = replace(plant().regions["position"], name="angle", unit="rad", shown=("rad", 1.0))
    turning = replace(plant(), regions={**plant().regions, "angle": angle})
    bent = Addition(FORCE, "angle", "", "wave", (2.001 * pi / turns, 0.4), (12.0,))
    assert f"the angle {words}, by 12 N" in sentence(bent, "", (), turning, 0.0, 30.0)


@given(st.floats(1e-6, 1e6), st.floats(1e-4, 1.0))
def test_a_value_is_shown_within_its_interval(value: float, part: float) -> None:
    half = 1.96 * part * value
    said = float(shown(value, part * value, "N").split(" ")[0])
    assert abs(said - value) <= 0.5 * half + 0.006 * value


@pytest.mark.parametrize(
    ("addition", "leak"),
    [
        (Addition(FLOW, "pressure 1", "", "hinge", (5e6,), (-1e-12,)), True),
        (Addition(FLOW, "pressure 1", "", "hinge", (5e6,), (1e-12,)), False),
        (Addition(FLOW, "spool opening", "", "x", (), (-1e-3,)), False),
        (Addition(ACROSS, "position", "", "bump", (0.3, 0.02), (1e-8,)), True),
        (Addition(ACROSS, "position", "", "bump", (0.3, 0.02), (-1e-8,)), False),
        (Addition(FORCE, "pressure 1", "", "x", (), (1e-5,)), False),
        (Addition("flow, chamber 2", "pressure 2", "", "x", (), (-1e-12,)), True),
    ],
)
def test_what_takes_oil_out_of_a_chamber_as_a_pressure_grows_is_suspected_to_be_a_leak(
    addition: Addition, leak: bool
) -> None:
    reach = (0.1, 0.5) if addition.of == "position" else PRESSURES
    assert is_leak(addition, *reach) is leak
