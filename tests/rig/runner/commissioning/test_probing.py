"""Small motions in open loop find every sign, null, and a ram that stands at a stop."""

from dataclasses import replace
from itertools import product
from typing import cast

import numpy as np
import pytest

from rig.configuration import load_rig
from rig.io.wiring import Wiring
from rig.plant import Model
from rig.runner.commissioning.operator import Operator, Yes
from rig.runner.commissioning.probing import NotFoundError, Probing, Signs
from rig.supervisor.unproven import UnprovenRig
from tests.rig.runner.commissioning.emulated import EmulatedUnprovenRig, Seeing

RIG = load_rig("emulated")
TURNS = ("normal", "inverted")
EVERY = [
    Wiring(valve, encoder, spool, pressures)  # type: ignore[arg-type]
    for valve, encoder, spool, pressures in product(TURNS, TURNS, TURNS, ("normal", "swapped"))
]
GREATEST_V = 0.465
WITHOUT_BYPASSES = replace(RIG, bypass_valves={})


def probed(rig: EmulatedUnprovenRig, operator: Operator | None = None) -> Signs:
    unproven = cast(UnprovenRig, rig)
    return Probing(unproven, Model(), GREATEST_V, operator or Yes(), lambda text: None).run()


# Of all sixteen these differ in each key and in each pair of keys; the last is all turned over.
@pytest.mark.parametrize("wiring", [EVERY[0], EVERY[6], EVERY[9], EVERY[15]])
def test_whatever_is_turned_over_is_found(wiring: Wiring) -> None:
    rig = EmulatedUnprovenRig(RIG, wiring)
    found = probed(rig)
    assert found.wiring == wiring
    assert found.sided_by == "the bypass valves"
    assert np.abs(rig.commands).max() < 0.6


@pytest.mark.parametrize("valve", TURNS)
def test_null_is_told_in_the_sign_of_the_wiring_that_was_found(valve: str) -> None:
    bias = 9e-6
    wiring = Wiring(valve=valve)  # type: ignore[arg-type]
    found = probed(EmulatedUnprovenRig(RIG, wiring, bias))
    assert found.null_V == pytest.approx(-bias / RIG.plant.parameters.valve_gain, abs=0.03)


@pytest.mark.parametrize(
    ("wiring", "end"),
    [(EVERY[0], 0.0), (Wiring(valve="inverted", pressures="swapped"), 0.6069)],
)
def test_a_ram_that_stands_at_a_stop_is_moved_off_it_first(wiring: Wiring, end: float) -> None:
    assert probed(EmulatedUnprovenRig(RIG, wiring, position=end)).wiring == wiring


def test_the_bypasses_are_shut_at_the_end_and_the_loop_is_closed_with_the_right_sign() -> None:
    rig = EmulatedUnprovenRig(RIG, Wiring(encoder="inverted"))
    probed(rig)
    last: dict[str, float] = {}
    for wanted in rig.moved:
        last |= wanted
    assert set(last.values()) == {0.0}
    assert rig.held == [-RIG.gain_V_per_m]


def test_null_beyond_what_a_run_allows_is_refused_with_the_remedy() -> None:
    with pytest.raises(NotFoundError, match="adjust the valve's null"):
        probed(EmulatedUnprovenRig(RIG, Wiring(), 1.6e-5))


def test_a_ram_without_supply_does_not_answer() -> None:
    rig = EmulatedUnprovenRig(RIG, Wiring())
    rig._plant.load_pump(False)
    with pytest.raises(NotFoundError, match=r"does not answer to commands of 0\.5 V"):
        probed(rig)


def test_without_bypasses_the_operator_s_eye_tells_the_sides() -> None:
    wiring = Wiring("inverted", "inverted", "normal", "swapped")
    # The command is positive, and the valve inverted, so that the rod goes in.
    found = probed(EmulatedUnprovenRig(WITHOUT_BYPASSES, wiring), Seeing(-1))
    assert found.wiring == wiring
    assert found.sided_by == "the operator"


def test_without_bypasses_and_eyes_the_file_is_believed_only_while_nothing_contradicts_it() -> None:
    assert probed(EmulatedUnprovenRig(WITHOUT_BYPASSES, Wiring())).sided_by == ""
    with pytest.raises(NotFoundError, match="look which way the rod moves"):
        probed(EmulatedUnprovenRig(WITHOUT_BYPASSES, Wiring(valve="inverted")))


def test_an_operator_who_contradicts_the_bypasses_ends_it() -> None:
    with pytest.raises(NotFoundError, match="the operator saw the opposite"):
        probed(EmulatedUnprovenRig(RIG, Wiring()), Seeing(-1))
