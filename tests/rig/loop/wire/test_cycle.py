"""What the loop on the wire does tick by tick, on a clock and a device that do as the test says.

The scenarios run in an interpreter of their own with the compiler off, see `scenarios`.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from math import cos, isnan, pi
from pathlib import Path
from typing import Any

import pytest

from control.changing import FADE_S
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.reaction import Reaction

Scenario = Callable[[str], dict[str, Any]]


FADED = 1.0 - 1e-3 / FADE_S
"""Part of a change's offset that is left a tick later."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    script = Path(__file__).with_name("scenarios.py")
    ran = subprocess.run(
        [sys.executable, script],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    results: dict[str, dict[str, Any]] = json.loads(ran.stdout)
    return results.__getitem__


def commands(result: dict[str, Any]) -> list[float]:
    return [frame["command_V"] for frame in result["frames"]]


def enables(result: dict[str, Any]) -> list[float]:
    return [frame["valve_enable"] for frame in result["frames"]]


def milliseconds(result: dict[str, Any]) -> list[int]:
    return [int(frame["at_ms"]) for frame in result["frames"]]


def without_value(result: dict[str, Any], channel: str = "position_m") -> list[int]:
    return [tick for tick, value in enumerate(result["rows"][channel]) if isnan(value)]


def test_each_tick_exchanges_once_and_leaves_one_row(scenario: Scenario) -> None:
    result = scenario("on time")
    assert milliseconds(result) == list(range(1, 14))
    assert result["rows"]["tick"] == list(range(13))
    assert result["rows"]["segment"] == [1] * 13
    assert result["left"] == "SWITCHED"


def test_a_frame_carries_the_command_from_the_sample_before_it(scenario: Scenario) -> None:
    result = scenario("on time")
    rows = result["rows"]
    assert rows["command_V"] == commands(result)
    for tick in range(1, 13):
        expected = 50.0 * (rows["setpoint_m"][tick] - rows["position_m"][tick - 1])
        assert rows["command_V"][tick] == pytest.approx(expected)


def test_a_change_of_control_goes_on_from_the_old_law_s_command_and_fades(
    scenario: Scenario,
) -> None:
    result = scenario("control changed")
    rows = result["rows"]
    assert rows["tick"] == list(range(15))
    assert result["replays"]
    assert result["words"]["CHANGED"] == 2

    def error(tick: int) -> float:
        return float(rows["setpoint_m"][tick] - rows["position_m"][tick - 1])

    commands_V = rows["command_V"]  # noqa: N806
    for tick in range(1, 6):
        assert commands_V[tick] == pytest.approx(50.0 * error(tick))
    offset = 50.0 * error(5) - (80.0 * error(5) + 0.25 + 1.5)
    for tick in range(6, 10):
        law = 80.0 * error(tick) + 0.25 + (1.5 if tick < 8 else 0.0)
        assert commands_V[tick] == pytest.approx(law + offset * FADED ** (tick - 5))
    last = 80.0 * error(10) + 0.25 + offset * FADED**5
    assert commands_V[10] == pytest.approx(last)
    offset = last - 50.0 * error(10)
    for tick in range(11, 15):
        assert commands_V[tick] == pytest.approx(50.0 * error(tick) + offset * FADED ** (tick - 10))


def test_the_loop_says_from_which_tick_a_change_of_control_holds(scenario: Scenario) -> None:
    assert scenario("control changed")["words"]["CHANGED_AT"] == 10


def test_a_row_and_its_filter_have_what_the_calibration_makes_of_the_sample(
    scenario: Scenario,
) -> None:
    result = scenario("calibrated")
    assert result["rows"]["pressure_1_Pa"] == pytest.approx([7e6 / 1.1] * 13)
    assert result["rows"]["pressure_2_Pa"] == [7e6] * 13
    assert result["rows"]["est_pressure_1_Pa"][0] == pytest.approx(7e6 / 1.1)
    assert result["replays"]


def test_the_command_leaves_with_the_sign_of_an_inverted_valve_and_all_else_sees_its_own(
    scenario: Scenario,
) -> None:
    right, turned = scenario("on time"), scenario("valve inverted")
    assert commands(turned) == [-command for command in commands(right)]
    assert turned["rows"]["command_V"] == right["rows"]["command_V"]
    assert turned["rows"]["device_command_V"] == right["rows"]["device_command_V"]
    assert turned["replays"]


def test_the_tracking_law_adds_its_null_its_tables_and_its_integral_to_the_same_loop(
    scenario: Scenario,
) -> None:
    rows, integral = scenario("tracking law")["rows"], 0.0
    for tick in range(1, 13):
        setpoint, position = rows["setpoint_m"][tick], rows["position_m"][tick - 1]
        ahead, expected = (1.5, 0.35) if tick < 8 else (0.0, setpoint)
        wanted = 0.25 + ahead + 50.0 * (setpoint - position) + integral
        assert rows["command_V"][tick] == pytest.approx(wanted)
        integral += 100.0 * (expected - position) * 1e-3
    assert integral > 0.02


def test_before_any_sample_the_valve_is_commanded_to_null(scenario: Scenario) -> None:
    assert commands(scenario("on time"))[0] == 0.0


def test_the_host_counter_counts_every_exchange(scenario: Scenario) -> None:
    counters = [frame["host_counter"] for frame in scenario("on time")["frames"]]
    assert counters == list(range(1, 14))


@pytest.mark.parametrize(
    "name", ["on time", "skip", "realign", "timeout", "same sample", "slow device", "trip"]
)
def test_the_filter_follows_from_the_recording_bit_for_bit(scenario: Scenario, name: str) -> None:
    assert scenario(name)["replays"]


def test_after_its_table_a_segment_holds_the_ram_and_is_no_longer_recorded(
    scenario: Scenario,
) -> None:
    rows = scenario("after the table")["rows"]
    assert rows["segment"] == [1] * 5 + [-1] * 8
    assert len(set(rows["setpoint_m"][5:])) == 1
    assert rows["setpoint_m"][5] == pytest.approx(rows["position_m"][4])


def test_skipped_setpoints_are_left_out_and_the_setpoint_goes_over_smoothly(
    scenario: Scenario,
) -> None:
    result = scenario("skip setpoints")
    setpoint, words = result["rows"]["setpoint_m"], result["words"]
    lead = words["LEAD"]
    taken = 20 - lead
    assert words["SKIPPED"] == words["SKIP"]
    assert 0 < lead < 20
    for tick in range(13):
        share = 0.5 + 0.5 * cos(pi * (tick - taken) / 4) if taken <= tick < taken + 4 else 0.0
        laid = tick if tick < taken else tick + lead
        assert setpoint[tick] == pytest.approx(0.3 + 1e-4 * laid - 1e-4 * lead * share)
    assert result["rows"]["tick"] == list(range(13))


def test_a_skip_to_the_end_holds_the_ram(scenario: Scenario) -> None:
    result = scenario("skip to the end")
    left = 30 - result["words"]["LEAD"]
    assert len(set(result["rows"]["setpoint_m"][left:])) == 1
    assert result["rows"]["segment"] == [1] * left + [-1] * (13 - left)


@pytest.mark.parametrize("name", ["skip back", "skip of another segment"])
def test_an_order_to_skip_that_does_not_fit_changes_nothing(scenario: Scenario, name: str) -> None:
    result = scenario(name)
    assert result["words"]["LEAD"] == 0
    assert result["rows"]["setpoint_m"] == scenario("on time")["rows"]["setpoint_m"]


def test_in_open_loop_the_setpoint_is_the_command_within_its_limit(scenario: Scenario) -> None:
    assert set(commands(scenario("open loop"))) == {2.0}


def test_a_missed_tick_is_skipped_counted_and_has_a_row_without_readings(
    scenario: Scenario,
) -> None:
    result = scenario("skip")
    assert milliseconds(result) == [1, 2, 3, 4, 5, 9, 10, 11, 12, 13]
    assert without_value(result) == [5, 6, 7]
    assert result["rows"]["tick"] == list(range(13))
    assert result["words"]["MISSED"] == 3


@pytest.mark.parametrize("name", ["skip", "realign", "nearly the next tick", "stopped for long"])
def test_no_two_exchanges_are_nearer_than_half_a_period(scenario: Scenario, name: str) -> None:
    frames = scenario(name)["frames"]
    assert all(after["at_ms"] - before["at_ms"] >= 0.5 for before, after in pairwise(frames))


def test_a_missed_tick_shows_the_command_that_stood_at_the_valve(scenario: Scenario) -> None:
    shown = scenario("skip")["rows"]["command_V"]
    assert shown[5:8] == [shown[4]] * 3
    assert shown[8] != shown[4]


def test_a_tick_that_is_a_little_late_still_takes_place(scenario: Scenario) -> None:
    result = scenario("a little late")
    assert result["words"]["MISSED"] == 0
    assert result["rows"]["wakeup_s"][5] == pytest.approx(0.4e-3)


def test_a_row_says_when_its_command_was_on_the_way(scenario: Scenario) -> None:
    rows = scenario("a little late")["rows"]
    assert rows["sent_s"][4:6] == pytest.approx([0.05e-3, 0.43e-3])


def test_a_command_that_did_not_go_has_no_time(scenario: Scenario) -> None:
    rows = scenario("disconnected")["rows"]
    assert isnan(rows["sent_s"][-1])


def test_realigning_moves_the_time_grid_and_skips_no_tick(scenario: Scenario) -> None:
    result = scenario("realign")
    assert without_value(result) == []
    assert milliseconds(result)[4:7] == [5, 9, 10]
    assert result["frames"][6]["at_ms"] - result["frames"][5]["at_ms"] == pytest.approx(
        1.0, abs=0.1
    )
    assert result["words"]["MISSED"] == 3


def test_the_trip_policy_trips_after_so_many_missed_ticks_in_a_row(scenario: Scenario) -> None:
    assert scenario("trip below its number")["words"]["LOOP_TRIP"] == 0
    assert scenario("trip")["words"]["LOOP_TRIP"] == Cause.OVERRUN
    assert enables(scenario("trip"))[5:] == [0.0] * len(enables(scenario("trip"))[5:])


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("stopped for long", Cause.OVERRUN),
        ("stopped while another trips", Cause.BYPASS_STUCK),
    ],
)
def test_a_loop_that_was_stopped_sends_no_command_before_it_looked_at_the_trips(
    scenario: Scenario, name: str, cause: Cause
) -> None:
    result = scenario(name)
    assert result["words"]["LOOP_TRIP"] == cause
    assert enables(result)[:5] == [1.0] * 5
    assert set(enables(result)[5:]) == {0.0}
    assert set(commands(result)[5:]) == {0.0}


def test_a_device_that_is_silent_while_ticks_are_missed_is_no_pause_of_the_loop(
    scenario: Scenario,
) -> None:
    result = scenario("device silent for long")
    assert result["words"]["MISSED"] > 0
    assert result["words"]["LOOP_TRIP"] == Cause.STALE_SAMPLE


def test_a_tick_without_reply_is_a_row_without_readings_and_an_error_counted(
    scenario: Scenario,
) -> None:
    result = scenario("timeout")
    assert 5 in without_value(result)
    assert result["words"]["EXCHANGE_ERRORS"] == 1


def test_a_segment_begins_with_its_first_whole_sample(scenario: Scenario) -> None:
    rows = scenario("no sample at first")["rows"]
    assert rows["tick"][:5] == [-1, -1, -1, 0, 1]
    assert rows["segment"][:5] == [-1, -1, -1, 1, 1]


def test_the_same_sample_once_more_is_not_counted_as_a_measurement(scenario: Scenario) -> None:
    assert without_value(scenario("same sample")) == [5]


def test_a_device_slower_than_the_loop_is_asked_at_its_own_rate(scenario: Scenario) -> None:
    result = scenario("slow device")
    assert milliseconds(result) == [1, 5, 9, 13]
    assert without_value(result) == [t for t in range(13) if t % 4]
    ages = result["rows"]["age_s"]
    assert ages[4] < ages[5] < ages[6] < ages[7] > ages[8]


def test_a_trip_is_sent_in_the_same_tick_and_confirmed_by_reading_back(scenario: Scenario) -> None:
    result = scenario("interlock trips")
    trip = result["frames"][6]
    assert milliseconds(result)[5:8] == [6, 6, 7]
    assert (trip["command_V"], trip["valve_enable"]) == (0.0, 0.0)
    assert set(enables(result)[6:]) == {0.0}
    assert result["words"]["LOOP_TRIP"] == Cause.LIMIT_HIGH
    assert result["words"]["VALVE_NULL_AT"] >= result["words"]["LOOP_TRIP_AT"] > 0


def test_a_valve_that_another_master_drives_after_a_trip_is_found_and_nulled_again(
    scenario: Scenario,
) -> None:
    result = scenario("driven by another master")
    found = result["found"]
    assert (found["TIMES"], found["ENABLED"], found["OUTPUT_UV"]) == (3, 3, 5_000_000)
    assert 0 < found["FIRST_NS"] < found["LAST_NS"]
    # Each of its ticks, and every other one after the trip, sends null.
    tripped = next(tick for tick, enabled in enumerate(enables(result)) if enabled == 0.0)
    assert enables(result)[tripped:] == [0.0] * len(enables(result)[tripped:])
    assert commands(result)[tripped:] == [0.0] * len(commands(result)[tripped:])
    assert result["left"] == "SWITCHED"


def test_nobody_looks_for_another_master_while_the_loop_drives_the_valve(
    scenario: Scenario,
) -> None:
    result = scenario("on time")
    assert result["looks"] == 0
    assert result["found"]["TIMES"] == 0


def test_a_spool_that_leaves_null_for_good_without_a_command_is_found(scenario: Scenario) -> None:
    found = scenario("spool moved by another master")["found"]
    assert found["TIMES"] > 1
    assert (found["ENABLED"], found["OUTPUT_UV"], found["SPOOL_NM"]) == (0, 0, 200_000)


@pytest.mark.parametrize("name", ["lost after its trip", "silent after its trip"])
def test_a_device_that_is_lost_after_its_trip_is_left_to_another_connection(
    scenario: Scenario, name: str
) -> None:
    result = scenario(name)
    assert result["words"]["VALVE_NULL_AT"] > 0
    assert result["left"] == "UNCONFIRMED"


def test_a_loop_that_was_stopped_for_a_moment_after_its_trip_keeps_the_valve_at_null(
    scenario: Scenario,
) -> None:
    result = scenario("stopped for long after its trip")
    assert result["left"] == "SWITCHED"
    assert set(enables(result)[6:]) == {0.0}


def test_a_trip_that_the_device_does_not_confirm_ends_the_loop_as_unconfirmed(
    scenario: Scenario,
) -> None:
    for name in ("device deaf to the trip", "disconnected"):
        result = scenario(name)
        assert result["left"] == "UNCONFIRMED"
        assert result["words"]["VALVE_NULL_AT"] == 0


def test_a_lost_connection_trips_at_once_and_is_not_waited_for(scenario: Scenario) -> None:
    result = scenario("disconnected")
    assert result["words"]["LOOP_TRIP"] == Cause.EXCHANGE_LOST
    assert len(result["frames"]) == 6


@pytest.mark.parametrize("name", ["interlock holds", "operator stops"])
def test_a_hold_keeps_the_ram_where_it_is_with_the_valve_enabled(
    scenario: Scenario, name: str
) -> None:
    result = scenario(name)
    held = result["rows"]["setpoint_m"][7:]
    assert len(set(held)) == 1
    assert set(enables(result)) == {1.0}
    assert result["rows"]["action"][-1] == Action.HOLD


def test_a_ramp_down_brings_the_command_to_zero_and_then_disables_the_valve(
    scenario: Scenario,
) -> None:
    result = scenario("interlock ramps down")
    sent, enabled = commands(result), enables(result)
    magnitudes = [abs(command) for command in sent[6:]]
    assert magnitudes[0] > 0.0
    assert all(after <= before for before, after in pairwise(magnitudes))
    assert magnitudes[-1] == 0.0
    assert enabled[300] == 1.0
    assert enabled[-1] == 0.0
    assert all(e == 1.0 for c, e in zip(sent[6:], enabled[6:], strict=True) if c != 0.0)


def test_a_silent_supervisor_trips_but_one_that_never_was_there_does_not(
    scenario: Scenario,
) -> None:
    assert scenario("supervisor silent")["words"]["LOOP_TRIP"] == Cause.SUPERVISOR_LOST
    assert scenario("supervisor never there")["words"]["LOOP_TRIP"] == 0


def test_a_loop_that_is_asked_to_leave_sends_a_null_frame_first(scenario: Scenario) -> None:
    result = scenario("leaving")
    assert result["left"] == "ASKED"
    assert (commands(result)[-1], enables(result)[-1]) == (0.0, 0.0)
    assert set(enables(result)[:-1]) == {1.0}


def test_a_decision_stands_in_every_row_from_the_tick_that_finds_it_posted(
    scenario: Scenario,
) -> None:
    rows = scenario("decisions")["rows"]
    for column in ("decided_at_s", "verdict_code", "present_internal_leakage_m3_per_s_sqrtPa"):
        values = rows[column]
        assert all(isnan(value) for value in values[:3])
        # Of many at once the newest counts, and one on another segment does not.
        assert values[3:8] == [0.25] * 5
        assert values[8:] == [0.75] * (len(values) - 8)
    assert scenario("decisions")["replays"]


def test_a_decision_that_may_be_torn_is_not_taken(scenario: Scenario) -> None:
    assert scenario("place still whole")["taken"]
    assert not scenario("place written again")["taken"]


def test_a_hold_on_a_fault_keeps_the_ram_where_it_is_and_the_segment_goes_on(
    scenario: Scenario,
) -> None:
    result = scenario("hold on a fault")
    rows = result["rows"]
    assert rows["fault_action"] == [0] * 5 + [Reaction.HOLD] * 8
    assert rows["setpoint_m"][5:] == [rows["position_m"][4]] * 8
    assert enables(result) == [1.0] * 13
    # It is the test's own, not the ladder's: nothing stands against the next test.
    assert result["words"]["ACTION"] == Action.NONE
    assert rows["segment"] == [1] * 13
    assert result["replays"]


def test_a_trip_on_a_fault_is_one_in_the_tick_that_finds_it_posted(scenario: Scenario) -> None:
    result = scenario("trip on a fault")
    assert result["words"]["LOOP_TRIP"] == Cause.FAULT_CONFIRMED
    assert enables(result) == [1.0] * 5 + [0.0] * 8
    assert commands(result)[5:] == [0.0] * 8
    assert result["words"]["VALVE_NULL_AT"] > 0


def test_a_tolerated_leak_adds_to_the_command_and_its_row_says_how_much(
    scenario: Scenario,
) -> None:
    leak, nothing = scenario("tolerate a leak"), scenario("ignore a fault")
    assert commands(leak)[:5] == commands(nothing)[:5]
    added = leak["rows"]["compensation_V"]
    assert added[:5] == [0.0] * 5
    assert all(value != 0.0 for value in added[5:])
    plain = [command - more for command, more in zip(commands(leak), added, strict=True)]
    assert plain == pytest.approx(commands(nothing), abs=1e-12)


def test_without_a_fault_of_its_own_a_segment_does_what_it_was_to_do(scenario: Scenario) -> None:
    nothing = commands(scenario("ignore a fault"))
    assert commands(scenario("nothing to tolerate")) == nothing
    assert commands(scenario("a fault of another test")) == nothing
    assert scenario("a fault of another test")["words"]["LOOP_TRIP"] == Cause.NONE


def test_a_loop_whose_detector_falls_silent_goes_back_by_itself(scenario: Scenario) -> None:
    # Posted at tick 5 on a sample 1.99 s before tick 0.
    actions = scenario("the detector falls silent")["rows"]["fault_action"]
    assert actions == [0] * 5 + [Reaction.TOLERATE] * 6 + [0] * (len(actions) - 11)
