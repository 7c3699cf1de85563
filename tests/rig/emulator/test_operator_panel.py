from struct import pack
from typing import Any

import pytest

from rig.emulator.operator_panel import EmulatedOperator

Bench = Any
LAMP_AND_ENABLE = 5


def lit_for(bench: Bench, operator: EmulatedOperator, seconds: float) -> None:
    """Let the lamp be lit by a host that goes on for so long."""
    for k in range(round(seconds / 10e-3)):
        bench.node.write(0, pack(">HHf", k + 1, LAMP_AND_ENABLE, 0.0))
        operator.tend()
        bench.clock.advance(10e-3)


def test_an_attentive_operator_presses_the_button_when_its_lamp_is_lit(bench: Bench) -> None:
    operator = EmulatedOperator(bench.node, bench.clock, attentive=True)
    lit_for(bench, operator, 0.1)
    assert not bench.node.enabled
    lit_for(bench, operator, 0.5)
    assert bench.node.enabled


def test_he_lets_the_button_go_again(bench: Bench) -> None:
    operator = EmulatedOperator(bench.node, bench.clock, attentive=True)
    lit_for(bench, operator, 0.25)
    pressed = bench.node.read(257, 1)[1] & 2
    lit_for(bench, operator, 0.2)
    assert pressed
    assert not bench.node.read(257, 1)[1] & 2


@pytest.mark.parametrize("why", ["inattentive", "dark", "estop"])
def test_otherwise_he_does_not(bench: Bench, why: str) -> None:
    operator = EmulatedOperator(bench.node, bench.clock, attentive=why != "inattentive")
    if why == "estop":
        bench.node.press_estop(True)
    if why == "dark":
        for _ in range(100):
            operator.tend()
            bench.clock.advance(10e-3)
    else:
        lit_for(bench, operator, 1.0)
    assert "reset" not in bench.events()
    assert not bench.node.enabled
