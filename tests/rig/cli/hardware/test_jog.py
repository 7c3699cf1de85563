"""`rig jog`: what it refuses before it goes near a rig, and what one command asks for."""

import pytest

from rig.cli.hardware.jog import _lines
from tests.rig.cli.conftest import Invoke


def test_a_simulated_rig_is_refused(invoke: Invoke) -> None:
    done = invoke("jog", "simulated")
    assert done.code == 2
    assert "has nothing to move by hand" in done.err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("by", "5"), "has no unit"),
        (("jump",), "is no command"),
        (("hold", "out"), "within a session only"),
        (("to", "5mm", "--speed", "fast"), "is not a quantity"),
        (("--speed", "5mm/s"), "needs a command"),
    ],
)
def test_a_wrong_command_is_refused_before_the_rig_is_connected(
    invoke: Invoke, words: tuple[str, ...], why: str
) -> None:
    done = invoke("jog", "emulated", *words)
    assert done.code == 2
    assert why in " ".join(done.err.split())


def test_one_command_loads_the_pump_and_homes_before() -> None:
    assert _lines(("by", "-5mm"), "20mm/s") == ["pump high", "home", "by -5mm speed 20mm/s"]
    assert _lines(("home",), None) == ["pump high", "home"]
    assert _lines(("show",), None) == ["show"]
    assert _lines((), None) == []


def test_the_help_shows_every_command(invoke: Invoke) -> None:
    done = invoke("jog", "--help")
    assert "bypass internal_leakage 30%" in done.out
