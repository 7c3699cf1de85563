"""Where each rule of the interlock begins to hold: the last sample before it, and the first of it.

`make mutation` changes the interlock in many places; these are the claims that notice.
"""

from math import inf, nan

import numpy as np
import pytest

from rig.io.limits import ChannelLimit, Response
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.judging import (
    Interlock,
    Tick,
    allowed_command,
    held_position,
    interlock,
    interlock_memory,
    passed_on,
    with_limits,
)
from rig.loop.interlocks.ladder import Action, Cause, limit_table
from rig.loop.interlocks.passings import PassingReader, passing_log
from rig.plant.integrator import TICK

from .samples_by_hand import NOTHING, SETTINGS, TOL, Found, Judge

POSITION, PRESSURE_1, PRESSURE_2 = (
    FAST_INPUTS.index(name) for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa")
)


@pytest.fixture
def judge() -> Judge:
    judge = Judge()
    judge.steps(4)
    return judge


def trip(cause: Cause, channel: str = "") -> Found:
    return Action.TRIP, cause, channel


def test_a_memory_knows_nothing_and_allows_everything() -> None:
    memory = interlock_memory(2)
    assert [array.size for array in memory[:9]] == [3, 18, 18, 2, 2, 18, 18, 18, 5]
    assert np.isnan(memory.values).all()
    assert np.isnan(memory.trusted).all()
    assert not any(array.any() for array in (memory.latched, memory.outside, memory.active))
    assert memory.commands.tolist() == [0.0] * 4


# -- chain -----------------------------------------------------------------------------------------


def test_the_chain_s_causes_name_their_channel(judge: Judge) -> None:
    assert judge.step(watchdog_tripped=1.0) == trip(Cause.WATCHDOG_TRIPPED, "watchdog_tripped")
    assert Judge().step(estop_closed=0.0, watchdog_tripped=1.0)[1] is Cause.ESTOP_OPEN


def test_a_valve_must_be_enabled_within_twenty_ticks_of_driving(judge: Judge) -> None:
    judge.steps(50, valve_enabled=0.0, driving=False)
    judge.steps(20, valve_enabled=0.0)
    judge.step(valve_enabled=1.0)
    assert judge.steps(20, valve_enabled=0.0) == [NOTHING] * 20
    assert judge.step() == trip(Cause.VALVE_NOT_ENABLED, "valve_enabled")


def test_a_valve_that_is_off_gets_no_command_whatever_is_sent() -> None:
    judge = Judge()
    judge.step(command=0.5, valve_enabled=0.0, driving=False)
    assert judge.evidence.command_V == 0.0
    judge.step(command=0.5, valve_enabled=1.0)
    assert judge.evidence.command_V == 0.5


def test_a_tick_of_a_simulated_rig_belongs_to_no_segment_and_to_no_place() -> None:
    assert Tick._field_defaults | {"error": None} == {
        "error": None, "segment": 0, "number": 0, "place": 0,
    }  # fmt: skip


# -- device ----------------------------------------------------------------------------------------


def test_a_device_may_be_four_exchanges_behind_and_no_more(judge: Judge) -> None:
    judge.counter, judge.echo_lag = 65535, 4
    assert judge.steps(40) == [NOTHING] * 40
    judge.echo_lag = 5
    assert judge.steps(20) == [NOTHING] * 20
    judge.echo_lag = 4
    judge.step()
    judge.echo_lag = 5
    assert judge.steps(20) == [NOTHING] * 20
    assert judge.step() == trip(Cause.DEVICE_DEAF, "device_echo")


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_output_may_be_a_tenth_of_a_volt_off_and_no_more(judge: Judge, sign: float) -> None:
    assert judge.steps(30, output=sign * 0.099) == [NOTHING] * 30
    judge.steps(20, output=sign * 0.101)
    judge.step(output=0.0)
    assert judge.steps(20, output=sign * 0.101) == [NOTHING] * 20
    assert judge.step(output=sign * 0.101) == trip(Cause.COMMAND_ECHO, "device_command_V")


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_output_may_be_any_of_the_last_four_commands(sign: float) -> None:
    judge = Judge()
    for older in (0.0, 0.3, 0.6):
        judge.step(command=sign * older, output=sign * older)
    judge.step(command=sign * 0.9, output=0.0)
    assert judge.memory.commands.tolist() == pytest.approx(
        [sign * each for each in (0.9, 0.6, 0.3, 0.0)]
    )
    assert judge.memory.unconfirmed[2] == 0
    judge.step(command=sign * 0.9, output=0.0)
    assert judge.memory.unconfirmed[2] == 1
    judge.step(command=sign * 0.9, output=sign * 0.7)
    assert judge.memory.unconfirmed[2] == 0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_output_may_be_the_newest_command_or_that_before_or_just_its_tolerance_off(
    sign: float,
) -> None:
    judge = Judge()
    for command, output in ((0.0, TOL.command_V), (0.5, 0.5), (0.0, 0.5)):
        judge.step(command=sign * command, output=sign * output)
        assert judge.memory.unconfirmed[2] == 0


def test_a_command_is_remembered_once_however_long_no_sample_comes() -> None:
    judge = Judge()
    judge.step(command=0.5)
    for _ in range(6):
        judge.step(command=0.5, fresh=False, age=1)
    assert judge.memory.commands.tolist() == [0.5, 0.0, 0.0, 0.0]
    judge.step(command=0.6, fresh=False, age=1)
    assert judge.memory.commands.tolist() == [0.6, 0.5, 0.0, 0.0]
    judge.step(command=0.6)
    assert judge.memory.commands.tolist() == [0.6, 0.6, 0.5, 0.0]


def test_the_output_of_a_valve_that_is_off_is_not_judged(judge: Judge) -> None:
    judge.steps(40, output=5.0, valve_enabled=0.0, driving=False)
    assert judge.memory.unconfirmed[2] == 0


def test_what_counts_against_the_device_ends_with_the_first_good_sample(judge: Judge) -> None:
    judge.steps(15, new=False)
    assert judge.memory.unconfirmed[0] == 15
    judge.step()
    assert judge.memory.unconfirmed[0] == 0
    assert judge.steps(20, new=False) == [NOTHING] * 20
    assert judge.step(new=False) == trip(Cause.DEVICE_STOPPED, "device_counter")


def test_a_sample_may_be_as_old_as_its_limit_and_no_older(judge: Judge) -> None:
    assert judge.step(fresh=False, age=20) == NOTHING
    assert judge.step(fresh=False, age=21) == trip(Cause.STALE_SAMPLE)


def test_a_device_that_stopped_before_it_fell_silent_is_called_stopped(judge: Judge) -> None:
    judge.step(new=False)
    assert judge.step(fresh=False, age=21)[1] is Cause.DEVICE_STOPPED


def test_the_emergency_stop_comes_before_what_it_makes_of_the_device(judge: Judge) -> None:
    assert judge.step(fresh=False, age=50, estop_closed=0.0)[1] is Cause.STALE_SAMPLE
    judge = Judge()
    assert judge.step(age=50, estop_closed=0.0) == trip(Cause.ESTOP_OPEN, "estop_closed")


# -- transducers -----------------------------------------------------------------------------------


@pytest.mark.parametrize("channel", ["position_m", "pressure_1_Pa", "pressure_2_Pa"])
def test_three_missing_values_in_a_row_trip(judge: Judge, channel: str) -> None:
    for _ in range(2):
        assert judge.steps(2, {channel: nan}) == [NOTHING] * 2
        assert judge.step({channel: 7e6 if "pressure" in channel else 0.3}) == NOTHING
    judge.steps(2, {channel: nan})
    assert not np.isnan(judge.memory.trusted).all()
    assert judge.step({channel: nan}) == trip(Cause.SENSOR_NAN, channel)
    assert np.isnan(judge.memory.trusted[FAST_INPUTS.index(channel)])


def test_a_channel_that_no_device_supplies_may_be_missing(judge: Judge) -> None:
    assert judge.steps(5, load_N=nan, spool_m=nan) == [NOTHING] * 5


def test_a_missing_value_leaves_the_one_before(judge: Judge) -> None:
    judge.step(pressure_1_Pa=6.5e6)
    judge.step(pressure_1_Pa=nan)
    assert judge.memory.values[PRESSURE_1] == 6.5e6
    assert judge.memory.missing[PRESSURE_1] == 1


@pytest.mark.parametrize(
    ("value", "action"),
    [(TOL.range_low[PRESSURE_1], Action.TRIP), (TOL.range_low[PRESSURE_1] + 1.0, Action.NONE)],
)
def test_a_transducer_at_the_low_end_of_its_range_trips_at_the_third_sample(
    value: float, action: Action
) -> None:
    judge = Judge()
    rows = [judge.step(pressure_1_Pa=value + (0.0 if k % 2 else -1e-3)) for k in range(3)]
    if action is Action.NONE:
        assert rows[2] == NOTHING
        return
    assert rows[:2] == [NOTHING] * 2
    assert rows[2] == trip(Cause.SENSOR_RANGE, "pressure_1_Pa")


def test_a_transducer_at_the_very_end_of_its_range_is_at_its_end() -> None:
    for end in (TOL.range_low, TOL.range_high):
        judge = Judge()
        judge.step(spool_m=float(end[3]))
        assert judge.memory.railed[3] == 1
        judge.step(spool_m=float(end[3]) * 0.999)
        assert judge.memory.railed[3] == 0


def test_a_rail_of_what_the_loop_can_do_without_ramps_down_and_is_trusted_no_more() -> None:
    judge = Judge()
    found = judge.steps(3, supply_pressure_Pa=float(TOL.range_high[4]))
    assert found[2] == (Action.RAMP_DOWN, Cause.SENSOR_RANGE, "supply_pressure_Pa")
    assert np.isnan(judge.memory.trusted[4])
    assert judge.memory.trusted[PRESSURE_2] == judge.memory.values[PRESSURE_2]


def test_forty_two_repeated_values_are_frozen_and_forty_one_are_not(judge: Judge) -> None:
    judge.step(pressure_2_Pa=7.1e6)
    assert judge.steps(41, pressure_2_Pa=7.1e6) == [NOTHING] * 41
    judge.step(pressure_2_Pa=7.2e6)
    assert judge.steps(41, pressure_2_Pa=7.2e6) == [NOTHING] * 41
    assert judge.step(pressure_2_Pa=7.2e6) == trip(Cause.SENSOR_FROZEN, "pressure_2_Pa")


def test_a_sample_that_the_device_repeats_says_nothing_of_its_transducers(judge: Judge) -> None:
    judge.step(load_N=2.3e4)
    judge.steps(10, load_N=2.3e4, new=False)
    assert judge.memory.railed[5] == 1
    assert judge.memory.repeated[5] == 0


def test_the_worst_transducer_is_named_and_of_equal_ones_the_first() -> None:
    judge = Judge()
    judge.steps(2, load_N=2.3e4, pressure_1_Pa=nan, pressure_2_Pa=nan)
    found = judge.step(load_N=2.3e4, pressure_1_Pa=nan, pressure_2_Pa=nan)
    assert found == trip(Cause.SENSOR_NAN, "pressure_1_Pa")


def test_lost_counts_name_the_position_before_anything_else_of_it(judge: Judge) -> None:
    judge.steps(2, position_m=nan)
    found = judge.step(position_m=nan, encoder_fault=1.0)
    assert found == trip(Cause.ENCODER_FAULT, "position_m")


# -- before homing ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("sign", "channel"), [(1.0, "pressure_1_Pa"), (-1.0, "pressure_2_Pa")])
def test_a_ram_that_pushes_too_hard_before_homing_trips_after_twenty_ticks(
    sign: float, channel: str
) -> None:
    judge = Judge()
    high = SETTINGS.load_pressure + 1e4
    at = {"pressure_1_Pa": 1e6, "pressure_2_Pa": 1e6, channel: 1e6 + high}
    judge.sample |= at
    assert judge.steps(20, homed=False, command=0.4 * sign) == [NOTHING] * 20
    # A command that relieves the ram, and a ram that is homed, count anew.
    judge.step(homed=False, command=-0.4 * sign)
    assert judge.memory.unconfirmed[4] == 0
    judge.steps(20, homed=False, command=0.4 * sign)
    assert judge.step(homed=False, command=0.4 * sign) == trip(Cause.HOMING_FORCE, channel)


def test_a_ram_at_its_greatest_load_pressure_does_not_push_too_hard() -> None:
    judge = Judge()
    judge.steps(
        1, homed=False, command=0.4, pressure_1_Pa=SETTINGS.load_pressure + 1e6, pressure_2_Pa=1e6
    )
    assert judge.memory.unconfirmed[4] == 0
    judge.steps(1, homed=False, command=0.0, pressure_1_Pa=1e7, pressure_2_Pa=1e6)
    assert judge.memory.unconfirmed[4] == 0


@pytest.mark.parametrize("command", [-1.0, 1.0])
def test_a_command_before_homing_trips_beyond_its_limit_and_a_tenth_of_a_volt(
    command: float,
) -> None:
    limit = SETTINGS.command + TOL.command_V
    assert Judge().step(homed=False, command=0.999 * limit * command) == NOTHING
    assert Judge().step(homed=False, command=1.001 * limit * command) == trip(Cause.NOT_HOMED)
    assert Judge().step(homed=True, command=1.001 * limit * command) == NOTHING


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_command_before_homing_at_its_limit_and_a_tenth_of_a_volt_exactly_is_allowed(
    sign: float,
) -> None:
    limit = TOL.unhomed_command_V + TOL.command_V
    assert Judge().step(homed=False, command=sign * limit) == NOTHING


def test_a_command_before_homing_counts_from_the_null_or_from_zero_whichever_is_less() -> None:
    tol = TOL._replace(null_V=0.4)
    assert Judge(tol=tol).step(homed=False, command=0.99) == NOTHING
    assert Judge(tol=tol).step(homed=False, command=1.01) == trip(Cause.NOT_HOMED)
    assert Judge(tol=tol).step(homed=False, command=-0.59) == NOTHING


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("pushed", "part"),
    [(0.0, 1.0), (0.2, 1.0), (0.25, 1.0), (0.5, 0.5), (0.75, 0.0), (0.875, -0.2), (1.0, -0.4),
     (2.0, -0.4)],
)  # fmt: skip
def test_a_command_before_homing_fades_with_the_load_pressure_and_turns_round(
    pushed: float, part: float, sign: float
) -> None:
    memory = interlock_memory(0)
    memory.values[POSITION : PRESSURE_2 + 1] = 0.0, 1e6, 1e6
    side = PRESSURE_1 if sign > 0.0 else PRESSURE_2
    memory.values[side] += pushed * SETTINGS.load_pressure
    for command in (0.4, 9.0):
        wanted = min(command, SETTINGS.command) * part
        allowed = allowed_command(sign * command, False, TOL, memory)
        assert allowed == pytest.approx(sign * wanted, abs=1e-12)
    # A command that relieves the ram is not reduced.
    if pushed:
        assert allowed_command(-sign * 0.4, False, TOL, memory) == pytest.approx(-sign * 0.4)
    assert allowed_command(0.0, False, TOL, memory) == 0.0


# -- limits ----------------------------------------------------------------------------------------


def limited(*limits: ChannelLimit) -> Judge:
    return Judge(limits)


def load(action: Response = "indicate", **given: float) -> ChannelLimit:
    return ChannelLimit("load_N", **{"high": 1e4, "low": -1e4} | given, action=action)


@pytest.mark.parametrize(("value", "cause"), [(1e4, Cause.LIMIT_HIGH), (-1e4, Cause.LIMIT_LOW)])
def test_a_value_on_its_limit_is_within_it(value: float, cause: Cause) -> None:
    judge = limited(load("hold"))
    assert judge.step(load_N=value) == NOTHING
    assert judge.step(load_N=1.001 * value) == (Action.HOLD, cause, "load_N")
    assert judge.memory.active.tolist() == [1]
    assert judge.step(load_N=value) == NOTHING


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_action_ends_where_the_value_is_back_by_the_hysteresis(sign: float) -> None:
    judge = limited(load("hold", hysteresis=1e3))
    assert judge.step(load_N=sign * 9.5e3) == NOTHING
    assert judge.step(load_N=sign * 1.01e4)[0] is Action.HOLD
    assert judge.step(load_N=sign * 9.001e3)[0] is Action.HOLD
    assert judge.step(load_N=sign * 9e3) == NOTHING
    assert judge.step(load_N=sign * 9.5e3) == NOTHING


def test_a_limit_counts_its_ticks_anew_after_each_value_within() -> None:
    judge = limited(load("trip", for_s=0.002))
    for _ in range(2):
        assert judge.steps(2, load_N=1.1e4) == [NOTHING] * 2
        judge.step(load_N=0.0)
        assert judge.memory.outside.tolist() == [0]
    assert judge.steps(3, load_N=1.1e4)[2] == trip(Cause.LIMIT_HIGH, "load_N")


def test_a_limit_holds_from_its_first_place_until_before_its_last() -> None:
    judge = limited(load(from_s=0.003, until_s=0.006))
    found = [judge.step(load_N=2e4, place=place)[0] for place in range(8)]
    assert found == [Action.NONE] * 3 + [Action.INDICATE] * 3 + [Action.NONE] * 2


def test_of_several_limits_the_worst_acts_and_of_equal_ones_the_first() -> None:
    rungs = (
        ChannelLimit("tank_temperature_K", high=300.0, action="indicate"),
        ChannelLimit("load_N", high=1e4, action="hold"),
        ChannelLimit("tank_temperature_K", low=250.0, high=290.0, action="hold"),
    )
    judge = limited(*rungs)
    assert judge.step(load_N=2e4, tank_temperature_K=310.0) == (
        Action.HOLD, Cause.LIMIT_HIGH, "load_N",
    )  # fmt: skip
    found = judge.step(load_N=0.0, tank_temperature_K=295.0)
    assert found == (Action.HOLD, Cause.LIMIT_HIGH, "tank_temperature_K")


def test_a_limit_that_is_passed_is_logged_once_with_its_rung_and_value() -> None:
    judge = limited(ChannelLimit("tank_temperature_K", high=300.0), load(for_s=0.001))
    reader = PassingReader(judge.interlock.log)
    judge.steps(4, load_N=1.5e4)
    (passed,) = reader.take()
    assert (passed.tick, passed.rung, passed.value) == (2, 1, 1.5e4)


def test_limits_of_the_position_wait_for_homing_and_others_do_not() -> None:
    rungs = (ChannelLimit("position_m", 0.1, 0.5, "hold"), load("hold"))
    assert limited(*rungs).step(position_m=0.6, homed=False) == NOTHING
    assert limited(*rungs).step(load_N=2e4, homed=False)[0] is Action.HOLD


def test_a_cause_is_indicated_only_while_the_valve_is_not_driven_and_latches_nothing() -> None:
    judge = limited(load("trip"))
    assert judge.step(load_N=2e4, driving=False) == (
        Action.INDICATE, Cause.LIMIT_HIGH, "load_N",
    )  # fmt: skip
    assert judge.memory.latched.tolist() == [0, 0, 0]
    assert judge.step(load_N=2e4) == trip(Cause.LIMIT_HIGH, "load_N")
    assert judge.step(load_N=0.0, driving=False) == trip(Cause.LIMIT_HIGH, "load_N")


def test_of_equal_actions_the_cause_of_the_device_comes_before_that_of_a_limit() -> None:
    judge = limited(load("trip"))
    assert judge.step(load_N=2e4, estop_closed=0.0)[1] is Cause.ESTOP_OPEN
    judge = limited(load("hold"))
    assert judge.step(load_N=2e4, encoder_fault=1.0)[1] is Cause.ENCODER_FAULT


def test_what_no_healthy_rig_can_send_trips(judge: Judge) -> None:
    assert judge.step(position_m=0.4) == trip(Cause.ENCODER_JUMP, "position_m")


@pytest.mark.parametrize(
    ("channel", "value", "cause"),
    [("load_N", 2e4, Cause.LIMIT_HIGH), ("estop_closed", 0.0, Cause.ESTOP_OPEN)],
)
def test_of_a_trip_and_a_ramp_down_the_trip_is_taken_whichever_is_judged_first(
    channel: str, value: float, cause: Cause
) -> None:
    judge = limited(load("trip"))
    end = float(TOL.range_high[4])
    assert judge.steps(3, supply_pressure_Pa=end)[2][0] is Action.RAMP_DOWN
    assert judge.step({channel: value}, supply_pressure_Pa=end) == trip(cause, channel)


def test_a_cleared_memory_is_as_before_the_first_tick() -> None:
    judge = limited(load("trip"))
    judge.steps(5, load_N=2e4, command=0.3)
    judge.memory.clear()
    for array, start in zip(judge.memory, interlock_memory(1), strict=True):
        assert np.array_equal(array, start, equal_nan=True)


# -- where a ram is held ---------------------------------------------------------------------------


def test_a_ram_is_held_five_millimetres_within_each_limit_that_acts() -> None:
    table = limit_table(
        [
            ChannelLimit("position_m", 0.1, 0.5, "hold", 0.0, 0.01),
            ChannelLimit("position_m", 0.2, 0.4, "indicate", 0.0, 0.01),
            ChannelLimit("load_N", 0.25, 0.3, "trip"),
        ],
        TICK,
    )
    assert held_position(0.51, True, table) == pytest.approx(0.485)
    assert held_position(0.09, True, table) == pytest.approx(0.115)
    for within in (0.1, 0.15, 0.45, 0.5):
        assert held_position(within, True, table) == within
    assert held_position(0.51, False, table) == 0.51


# -- limits of a test ------------------------------------------------------------------------------


def test_limits_of_a_test_begin_where_those_of_the_rig_stand_and_hand_them_back() -> None:
    known: Interlock = interlock(limit_table([load("hold", for_s=0.005)], TICK), TOL)
    known.memory.outside[0], known.memory.active[0] = 4, 1
    more = limit_table([ChannelLimit("following_error_m", -inf, 5e-3, "trip")], TICK)
    widened = with_limits(known, more)
    assert widened.limits.action.tolist() == [Action.HOLD, Action.TRIP]
    assert widened.memory.outside.tolist() == [4, 0]
    assert widened.memory.active.tolist() == [1, 0]
    assert widened.memory.values is known.memory.values
    assert widened.log is known.log
    widened.memory.outside[:], widened.memory.active[:] = (6, 9), (0, 1)
    passed_on(widened, known)
    assert known.memory.outside.tolist() == [6]
    assert known.memory.active.tolist() == [0]
    assert passing_log().written.tolist() == [0]
