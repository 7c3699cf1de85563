"""The interlock on samples made by hand: what each rule does, and which one wins."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.judging import (
    Interlock as Judged,
    Tick,
    allowed_command,
    check_sample,
    held_position,
    interlock as interlock_of,
    interlock_memory,
    passed_on,
    with_limits,
)
from rig.loop.interlocks.ladder import (
    EXPLANATIONS,
    Action,
    Cause,
    channel_name,
    explain,
    limit_table,
)
from rig.loop.interlocks.passings import passing_log
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET

SUPPLIED = frozenset({"position_m", "pressure_1_Pa", "pressure_2_Pa"})
SETTINGS = HomingSettings()
TOL = tolerances(NOMINAL, DATA_SHEET, SUPPLIED, TICK, 0.02, SETTINGS)
LADDER = (
    ChannelLimit("position_m", 0.1, 0.5, "hold", 0.0, 0.01),
    ChannelLimit("position_m", 0.05, 0.55, "trip"),
    ChannelLimit("load_N", high=1e4, action="indicate", for_s=0.005),
)


class Interlock:
    """An interlock fed tick by tick with a sample that is sound unless the test says otherwise."""

    def __init__(self, *, driving: bool = True, homed: bool = True) -> None:
        self.driving, self.homed = driving, homed
        self.limits = limit_table(LADDER, TICK)
        self.memory = interlock_memory(self.limits.channel.size)
        self.tick = self.age = 0
        self.noise = np.random.default_rng(1)

    def step(
        self, *, fresh: bool = True, command: float = 0.0, **values: float
    ) -> tuple[Action, Cause, str]:
        self.tick += 1
        self.age = 0 if fresh else self.age + 1
        sample = {
            "position_m": 0.3,
            "pressure_1_Pa": 7e6 + 3e4 * float(self.noise.standard_normal()),
            "pressure_2_Pa": 7e6 + 3e4 * float(self.noise.standard_normal()),
            "estop_closed": 1.0,
            "valve_enabled": 1.0,
            "watchdog_tripped": 0.0,
            "encoder_fault": 0.0,
            "device_counter": float(self.tick % 65536),
            "device_echo": float(self.tick % 65536),
            "device_command_V": command,
        } | values
        inputs = np.array([sample.get(name, nan) for name in FAST_INPUTS])
        action, cause, channel = check_sample(
            Tick(inputs, fresh, 1, 0.15, self.age, command, float(self.tick % 65536), self.driving,
                 self.homed),
            Judged(self.limits, TOL, self.memory, passing_log()),
        )  # fmt: skip
        return Action(action), Cause(cause), FAST_INPUTS[channel] if channel >= 0 else ""

    def creep(self, position: float) -> None:
        """Go to a position as slowly as a valve at null may drift."""
        here = self.memory.values[0]
        for x in np.linspace(here, position, round(abs(position - here) / 2e-5) + 2):
            self.step(position_m=float(x))


@pytest.fixture
def interlock() -> Interlock:
    interlock = Interlock()
    interlock.step()
    return interlock


def test_a_sound_sample_asks_for_nothing(interlock: Interlock) -> None:
    assert interlock.step() == (Action.NONE, Cause.NONE, "")


def test_a_hold_that_is_exceeded_further_climbs_the_ladder(interlock: Interlock) -> None:
    interlock.creep(0.51)
    held = interlock.step(position_m=0.51)
    interlock.creep(0.551)
    assert held == (Action.HOLD, Cause.LIMIT_HIGH, "position_m")
    assert interlock.step(position_m=0.551) == (Action.TRIP, Cause.LIMIT_HIGH, "position_m")


def test_a_hold_ends_once_the_ram_is_back_by_its_hysteresis(interlock: Interlock) -> None:
    interlock.creep(0.501)
    interlock.creep(0.495)
    assert interlock.step(position_m=0.495)[0] is Action.HOLD
    interlock.creep(0.489)
    assert interlock.step(position_m=0.489)[0] is Action.NONE


def test_a_ram_beyond_its_limits_is_brought_back_to_where_the_hold_ends(
    interlock: Interlock,
) -> None:
    assert held_position(0.3, True, interlock.limits) == 0.3
    assert held_position(0.498, True, interlock.limits) == 0.498
    for beyond in (0.501, 0.54, 0.57, 0.09, 0.02):
        assert 0.11 < held_position(beyond, True, interlock.limits) < 0.49
    assert held_position(0.52, False, interlock.limits) == 0.52
    assert np.isnan(held_position(nan, True, interlock.limits))


def test_a_limit_waits_for_its_persistence_from_the_first_tick_beyond(
    interlock: Interlock,
) -> None:
    for _ in range(5):
        assert interlock.step(load_N=1.1e4)[0] is Action.NONE
    assert interlock.step(load_N=1.1e4) == (Action.INDICATE, Cause.LIMIT_HIGH, "load_N")
    assert interlock.step(load_N=0.9e4)[0] is Action.NONE
    assert interlock.step(load_N=1.1e4)[0] is Action.NONE


def test_the_first_trip_is_kept_until_the_memory_is_cleared(interlock: Interlock) -> None:
    first = interlock.step(estop_closed=0.0)
    assert first == (Action.TRIP, Cause.ESTOP_OPEN, "estop_closed")
    assert interlock.step(watchdog_tripped=1.0) == first
    assert interlock.step() == first
    interlock.memory.clear()
    assert interlock.step() == (Action.NONE, Cause.NONE, "")


def test_the_worst_action_wins(interlock: Interlock) -> None:
    interlock.creep(0.505)
    assert interlock.step(position_m=0.505)[0] is Action.HOLD
    assert interlock.step(position_m=0.505, encoder_fault=1.0)[:2] == (
        Action.TRIP,
        Cause.ENCODER_FAULT,
    )


def test_while_the_valve_is_not_driven_causes_are_indicated_only() -> None:
    interlock = Interlock(driving=False)
    assert interlock.step(estop_closed=0.0, valve_enabled=0.0)[:2] == (
        Action.INDICATE,
        Cause.ESTOP_OPEN,
    )
    assert interlock.step(valve_enabled=0.0)[0] is Action.NONE
    interlock.driving = True
    assert interlock.step()[0] is Action.NONE


def test_samples_older_than_their_limit_trip(interlock: Interlock) -> None:
    for _ in range(20):
        assert interlock.step(fresh=False)[0] is Action.NONE
    assert interlock.step(fresh=False)[:2] == (Action.TRIP, Cause.STALE_SAMPLE)


def test_a_device_that_repeats_its_last_sample_is_distinguished_from_a_silent_one(
    interlock: Interlock,
) -> None:
    for _ in range(21):
        found = interlock.step(device_counter=1.0)
    assert found == (Action.TRIP, Cause.DEVICE_STOPPED, "device_counter")


def test_one_missing_sample_is_no_failed_transducer(interlock: Interlock) -> None:
    assert interlock.step(pressure_1_Pa=nan)[0] is Action.NONE
    assert interlock.step()[0] is Action.NONE
    for _ in range(2):
        interlock.step(pressure_1_Pa=nan)
    assert interlock.step(pressure_1_Pa=nan) == (Action.TRIP, Cause.SENSOR_NAN, "pressure_1_Pa")


def test_a_transducer_the_loop_can_do_without_ramps_down(interlock: Interlock) -> None:
    interlock.step(load_N=2.3e4)
    interlock.step(load_N=2.3e4)
    assert interlock.step(load_N=2.3e4) == (Action.RAMP_DOWN, Cause.SENSOR_RANGE, "load_N")


def test_the_device_may_put_out_the_command_some_exchanges_late(interlock: Interlock) -> None:
    rng = np.random.default_rng(2)
    commands = [0.0, 0.0, 0.0, *(0.3 * rng.standard_normal(100))]
    for before, command in zip(commands, commands[3:], strict=False):
        found = interlock.step(command=float(command), device_command_V=float(before))
        assert found[0] is Action.NONE


def test_a_device_that_does_not_report_the_chain_is_not_judged_by_it() -> None:
    interlock = Interlock()
    for _ in range(50):
        found = interlock.step(
            estop_closed=nan, valve_enabled=nan, watchdog_tripped=nan, encoder_fault=nan,
            device_counter=nan, device_echo=nan, device_command_V=nan,
        )  # fmt: skip
    assert found[0] is Action.NONE


def test_position_limits_say_nothing_before_homing() -> None:
    interlock = Interlock(homed=False)
    interlock.step(position_m=-0.2)
    assert interlock.step(position_m=-0.2)[0] is Action.NONE


def test_homing_moves_the_zero_without_a_jump() -> None:
    interlock = Interlock(homed=False)
    interlock.step(position_m=-0.2)
    interlock.homed = True
    assert interlock.step(position_m=0.3)[0] is Action.NONE


def test_driving_hard_before_homing_trips() -> None:
    interlock = Interlock(homed=False)
    interlock.step()
    assert interlock.step(command=5.0)[:2] == (Action.TRIP, Cause.NOT_HOMED)


@given(
    command=st.floats(-20.0, 20.0),
    load_pressure=st.floats(-1.4e7, 1.4e7),
)
def test_an_unhomed_ram_is_never_pushed_beyond_its_limits(
    command: float, load_pressure: float
) -> None:
    interlock = Interlock(homed=False)
    interlock.memory.values[:3] = 0.0, 7e6 + 0.5 * load_pressure, 7e6 - 0.5 * load_pressure
    allowed = allowed_command(command, False, TOL, interlock.memory)
    assert abs(allowed) <= SETTINGS.command
    if abs(load_pressure) > 0.75 * SETTINGS.load_pressure + 1.0:
        assert allowed * load_pressure <= 0.0
    assert allowed_command(command, True, TOL, interlock.memory) == command


@pytest.mark.parametrize("null_V", [-0.3, 0.3])
def test_a_command_before_homing_counts_from_a_known_null_but_0_v_stays_0_v(
    null_V: float,  # noqa: N803
) -> None:
    memory, tol = Interlock(homed=False).memory, TOL._replace(null_V=null_V)
    memory.values[:3] = 0.0, 9e6, 5e6
    assert allowed_command(0.0, False, tol, memory) == 0.0
    for wanted in (-0.4, 0.4, -5.0, 5.0):
        about_0 = allowed_command(wanted, False, TOL, memory)
        assert allowed_command(wanted + null_V, False, tol, memory) == pytest.approx(
            about_0 + null_V
        )


def test_an_unknown_channel_or_an_empty_range_makes_no_limit() -> None:
    with pytest.raises(ValueError, match="no such channel"):
        limit_table([ChannelLimit("positon_m", 0.0, 1.0)], TICK)
    with pytest.raises(ValueError, match="not below"):
        limit_table([ChannelLimit("load_N", 1.0, 1.0)], TICK)


@pytest.mark.parametrize("cause", Cause)
def test_every_cause_has_a_sentence_and_a_remedy(cause: Cause) -> None:
    sentence, remedy = explain(cause, "load_N")
    assert sentence
    assert remedy
    assert "{" not in sentence
    assert ("load_N" in sentence) == ("{channel}" in EXPLANATIONS[cause].sentence)


def test_limits_of_a_test_hold_beside_those_of_the_rig_and_are_gone_after_it() -> None:
    known = interlock_of(limit_table(LADDER[:1], TICK), TOL)
    more = limit_table([ChannelLimit("following_error_m", -inf, 5e-3, "ramp_down")], TICK)
    widened = with_limits(known, more)
    sample = np.full(len(FAST_INPUTS), nan)
    sample[:3] = 0.3, 7e6, 7e6
    tick = Tick(sample, True, 1, 0.15, 0, 0.0, 1.0, True, True, 6e-3)
    action, cause, channel = check_sample(tick, widened)
    assert (action, cause) == (Action.RAMP_DOWN, Cause.LIMIT_HIGH)
    assert channel_name(channel) == "following_error_m"
    assert check_sample(tick._replace(error=4e-3), widened)[0] < Action.HOLD
    sample[0] = 0.52
    check_sample(tick, widened)
    passed_on(widened, known)
    assert known.memory.outside.tolist() == [1]
