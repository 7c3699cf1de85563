"""A rig whose signs are not known is judged by what does not depend on them."""

from dataclasses import replace
from math import inf
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from control import ControlSettings
from rig.configuration import load_rig
from rig.io.signals import FAST_INPUTS
from rig.io.wiring import Wiring
from rig.loop.wire.layout import Drive
from rig.plant import TICK, Model
from rig.supervisor.checks import checks_for, greatest_null_V, unproven_checks_for
from rig.supervisor.states import Event
from rig.supervisor.unproven import BrokenOffError, UnprovenRig, pushes_too_hard
from tests.rig.io.test_transducer_calibration import CALIBRATION

RIG = load_rig("emulated")
FITTED = frozenset(FAST_INPUTS[:6])


def test_only_what_compares_signs_is_left_out() -> None:
    usual = checks_for(RIG, Model(), FITTED, TICK)
    unproven = unproven_checks_for(RIG, Model(), FITTED, TICK)
    changed = {
        name
        for name, one, other in zip(usual._fields, usual, unproven, strict=True)
        if not np.array_equal(np.ravel(one), np.ravel(other))  # type: ignore[call-overload]
    }
    assert changed == {
        "work_J", "flow_account_m", "spool_m", "unhomed_command_V", "unhomed_load_pressure_Pa",
    }  # fmt: skip
    assert unproven.work_J == unproven.flow_account_m == unproven.spool_m == inf
    assert greatest_null_V(usual) == pytest.approx(0.465, abs=1e-3)


def test_commands_of_a_ram_that_is_not_homed_count_from_the_null_of_its_control() -> None:
    given = replace(RIG, control=ControlSettings(null=-0.3))
    assert checks_for(RIG, Model(), FITTED, TICK).null_V == 0.0
    assert checks_for(given, Model(), FITTED, TICK).null_V == -0.3


def test_the_range_of_a_calibrated_transducer_goes_with_its_swapped_line() -> None:
    swapped = replace(RIG, calibrations=(CALIBRATION,), wiring=Wiring(pressures="swapped"))
    found = checks_for(swapped, Model(), FITTED, TICK)
    one, other = (FAST_INPUTS.index(f"pressure_{n}_Pa") for n in (1, 2))
    assert found.range_high[other] == CALIBRATION.corrected(RIG.sensors.pressure_max)
    assert found.range_high[one] == RIG.sensors.pressure_max


@pytest.mark.parametrize(
    ("load", "hard"),
    [
        (np.full(100, 3.8e6), False),
        (np.linspace(0.0, 1.3e7, 100), True),
        (np.linspace(0.0, -1.3e7, 100), True),
        (np.linspace(1.3e7, 0.8e7, 100), False),
        (np.full(10, 1.3e7), False),
        (np.full(100, np.nan), False),
    ],
    ids=["stiction", "at a stop", "at the other", "relieved", "too few samples", "no samples"],
)
def test_a_ram_that_pushes_harder_and_harder_pushes_too_hard(load: np.ndarray, hard: bool) -> None:
    assert pushes_too_hard(load, 6e6) is hard


class Broken(UnprovenRig):
    """An unproven rig whose commands are broken off; what it does is noted."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.board = SimpleNamespace(words=np.zeros(64, np.int64))  # type: ignore[assignment]
        self.safety = SimpleNamespace(tripped=False)  # type: ignore[assignment]
        self.configured = RIG

    def handle(self, event: Event) -> None:
        self.done.append(event.value)

    def switch_to(self, drive: Drive, **changes: Any) -> None:
        self.done.append(f"{drive.name} {changes['gain']:g}")

    def _watched(self, *_: Any) -> Any:
        raise BrokenOffError("the ram pushes against something")


def test_after_commands_that_are_broken_off_the_ram_is_held_and_may_be_moved_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.supervisor.unproven.RingReader", lambda board: None)
    rig = Broken()
    with pytest.raises(BrokenOffError):
        rig.play([0.1, 0.1], gain=-50.0)
    assert rig.done == ["home", "TRACK -50", "HOLD -50", "hold"]
