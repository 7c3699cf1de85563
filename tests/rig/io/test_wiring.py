"""What is wired the wrong way round is put right on its way into the loop."""

from itertools import product
from math import nan
from typing import Any

import numpy as np
import pytest

from rig.io.correction import Corrections, correct, corrections_of
from rig.io.signals import FAST_INPUTS
from rig.io.wiring import Wiring
from rig.jit import njit
from tests.rig.io.test_transducer_calibration import CALIBRATION

Array = Any
TURNS = ("normal", "inverted")
EVERY = [
    Wiring(valve, encoder, spool, pressures)  # type: ignore[arg-type]
    for valve, encoder, spool, pressures in product(TURNS, TURNS, TURNS, ("normal", "swapped"))
]


def sample(**values: float) -> Array:
    return np.array([values.get(name, nan) for name in FAST_INPUTS])


@njit(error_model="numpy")
def compiled(values: Array, corrections: Corrections) -> None:
    """Call what only compiled code can call."""
    correct(values, corrections)


def corrected(values: Array, *arguments: Any) -> dict[str, float]:
    compiled(values, corrections_of(*arguments))
    return {name: value for name, value in zip(FAST_INPUTS, values, strict=True) if value == value}


@pytest.mark.parametrize("wiring", EVERY)
def test_a_wiring_undoes_itself_and_the_usual_one_changes_nothing(wiring: Wiring) -> None:
    assert wiring.turned(wiring) == Wiring()
    assert wiring.turned(Wiring()) == Wiring().turned(wiring) == wiring


def test_each_key_turns_over_its_own_channel_and_no_other() -> None:
    values = {
        "position_m": 0.1, "spool_m": 1e-5, "pressure_1_Pa": 5e6, "pressure_2_Pa": 7e6,
        "device_command_V": 1.5,
    }  # fmt: skip
    for wiring, changed in (
        (Wiring(), {}),
        (Wiring(valve="inverted"), {"device_command_V": -1.5}),
        (Wiring(encoder="inverted"), {"position_m": -0.1}),
        (Wiring(spool="inverted"), {"spool_m": -1e-5}),
        (Wiring(pressures="swapped"), {"pressure_1_Pa": 7e6, "pressure_2_Pa": 5e6}),
    ):
        assert corrected(sample(**values), (), wiring) == values | changed
        sign = -1.0 if wiring.valve == "inverted" else 1.0
        assert corrections_of((), wiring).command_sign[0] == sign


def test_a_calibration_stays_with_its_transducer_when_lines_are_swapped() -> None:
    assert CALIBRATION.channel == "pressure_1_Pa"
    values = sample(pressure_1_Pa=5e6, pressure_2_Pa=7e6)
    found = corrected(values, [CALIBRATION], Wiring(pressures="swapped"))
    assert found == {"pressure_1_Pa": 7e6, "pressure_2_Pa": CALIBRATION.corrected(5e6)}


def test_a_missing_sample_stays_missing() -> None:
    assert corrected(sample(), (), EVERY[-1]) == {}
