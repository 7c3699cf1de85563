"""What tolerant control does in the simulated loop, and that its study is up to date."""

import numpy as np
import pytest

from tools.simulated.drawn_rigs import drawn_rig
from tools.tolerant_control import margins
from tools.tolerant_control.__main__ import PAGE, with_tables
from tools.tolerant_control.comparison import LOADS, setpoint
from tools.tolerant_control.margins import least_margins
from tools.tolerant_control.runs import NO_LEAK, leak_coefficients, run

pytestmark = pytest.mark.long

SINE = "sine, 20 mm at 1 Hz"
STEPS = "steps of 100 mm every 3 s"
HOLD = "step of 50 mm, then hold"


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("motion", [SINE, STEPS])
def test_a_leak_of_2_litres_a_minute_leaves_the_healthy_loops_error(
    motion: str, place: int
) -> None:
    wanted, rig = setpoint(motion), LOADS["spring"]
    leaks = leak_coefficients(place, 2.0)
    healthy = run(wanted, rig=rig)
    tolerant = run(wanted, rig=rig, leaks=leaks, told=leaks)
    assert tolerant.rms_error < 1.2 * healthy.rms_error
    assert tolerant.worst_error < 1.2 * healthy.worst_error


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("motion", ["sine, 100 mm at 0.5 Hz", STEPS])
def test_what_the_detector_finds_does_as_well(motion: str, place: int) -> None:
    wanted, rig = setpoint(motion), LOADS["unloaded"]
    healthy = run(wanted, rig=rig)
    tolerant = run(wanted, rig=rig, leaks=leak_coefficients(place, 2.0), told=None)
    assert tolerant.confirmed_s is not None
    assert tolerant.rms_error < 1.2 * healthy.rms_error
    assert tolerant.worst_error < 1.2 * healthy.worst_error


def test_a_held_load_is_not_let_go_by_a_leak() -> None:
    wanted, rig = setpoint(HOLD), LOADS["spring"]
    leaks = leak_coefficients(2, 2.0)
    proportional = run(wanted, rig=rig, leaks=leaks)
    tolerant = run(wanted, rig=rig, leaks=leaks, told=leaks)
    assert tolerant.final_error < 0.2 * proportional.final_error


def test_a_false_alarm_of_a_tenth_of_a_litre_changes_nothing() -> None:
    wanted = setpoint(SINE)
    healthy = run(wanted)
    for place in range(3):
        alarmed = run(wanted, told=leak_coefficients(place, 0.1))
        np.testing.assert_array_equal(alarmed.command, healthy.command)


@pytest.mark.parametrize("seed", range(4))
def test_a_false_alarm_of_half_a_litre_costs_a_moving_rig_less_than_5_percent(seed: int) -> None:
    rig, wanted = drawn_rig(np.random.default_rng(seed)), setpoint((SINE, STEPS)[seed % 2])
    healthy = run(wanted, rig=rig, seed=seed)
    alarmed = run(wanted, rig=rig, told=leak_coefficients(seed % 3, 0.5), seed=seed)
    assert alarmed.confirmed_s is not None
    assert alarmed.rms_error < 1.05 * healthy.rms_error


@pytest.mark.parametrize("part", [0.8, 1.2])
def test_a_leak_taken_for_a_fifth_more_or_less_is_still_no_worse_than_not_made_up_for(
    part: float,
) -> None:
    wanted, rig = setpoint(SINE), drawn_rig(np.random.default_rng(5))
    for place in range(3):
        leaks = leak_coefficients(place, 3.0)
        proportional = run(wanted, rig=rig, leaks=leaks)
        tolerant = run(wanted, rig=rig, leaks=leaks, told=leak_coefficients(place, part * 3.0))
        assert tolerant.rms_error < 1.05 * proportional.rms_error


@pytest.mark.parametrize("place", [0, 2])
def test_making_up_for_half_as_much_again_as_leaks_takes_nothing_from_the_gain_margin(
    place: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(margins, "POSITIONS", (0.01, 0.3))
    monkeypatch.setattr(margins, "OPENINGS", (0.05, 0.5, 2.0))
    healthy, _ = least_margins(NO_LEAK, NO_LEAK)
    least, motions = least_margins(leak_coefficients(place, 6.0), leak_coefficients(place, 4.0))
    assert motions > 20
    assert least.radius < 1.0
    assert least.gain >= healthy.gain
    assert least.phase_deg > 45.0


def test_the_page_has_every_table() -> None:
    page = PAGE.read_text()
    names = ("margins", "summary", "comparison", "proof")
    written = with_tables(page, dict.fromkeys(names, "| new |"))
    assert written.count("| new |") == len(names)
    assert with_tables(page, {}) == page
