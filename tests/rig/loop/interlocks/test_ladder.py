"""The ladder's numbers, and how limits of rig and test become its rungs."""

from math import inf

import numpy as np
import pytest

from faults import TestLimit
from rig.io.limits import ALWAYS, ChannelLimit
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.ladder import (
    ERROR_AT,
    EXPLANATIONS,
    LIMITED,
    NO_CHANNEL,
    Action,
    Cause,
    channel_name,
    explain,
    limit_table,
    rungs_of,
    rungs_with_bands,
)

NUMBERS = {
    "NONE": 0, "LIMIT_LOW": 1, "LIMIT_HIGH": 2, "STALE_SAMPLE": 3, "SENSOR_NAN": 4,
    "SENSOR_RANGE": 5, "SENSOR_FROZEN": 6, "ENCODER_FROZEN": 7, "ENCODER_JUMP": 8,
    "ENCODER_FAULT": 9, "POSITION_AGAINST_FLOW": 10, "PRESSURE_ABOVE_SUPPLY": 11,
    "PRESSURES_CROSSED": 12, "SPOOL_NOT_FOLLOWING": 13, "DEVICE_STOPPED": 14, "DEVICE_DEAF": 15,
    "COMMAND_ECHO": 16, "FOREIGN_MASTER": 17, "ESTOP_OPEN": 20, "WATCHDOG_TRIPPED": 21,
    "VALVE_NOT_ENABLED": 22, "NOT_HOMED": 23, "HOMING_FORCE": 24, "HOMING_FAILED": 25,
    "OVERRUN": 30, "EXCHANGE_LOST": 31, "LOOP_LOST": 32, "FIELD_LOST": 33, "SUPERVISOR_LOST": 34,
    "RECORDER_LOST": 35, "DISK_FULL": 36, "CRASH": 37, "BYPASS_STUCK": 40, "BYPASS_LOST": 41,
    "DRIVE_FAULT": 42, "DRIVE_LOST": 43, "PUMP_FAULT": 44, "PUMP_LOST": 45, "METERS_LOST": 46,
    "BLOCKING_STUCK": 47,
    "NULL_NOT_CONFIRMED": 50, "BYPASS_NOT_SHUT": 51, "PUMP_NOT_UNLOADED": 52, "OPERATOR_STOP": 60,
    "FAULT_CONFIRMED": 70, "TEST_LIMIT": 71,
}  # fmt: skip
"""The numbers in recordings that exist: a cause keeps its number, and a new one is added here."""


def test_a_cause_keeps_the_number_that_recordings_have_of_it() -> None:
    assert {cause.name: cause.value for cause in Cause} == NUMBERS
    assert set(EXPLANATIONS) == set(Cause)


def test_actions_are_numbered_from_the_mildest_to_the_worst() -> None:
    assert [action.name for action in Action] == ["NONE", "INDICATE", "HOLD", "RAMP_DOWN", "TRIP"]
    assert [int(action) for action in Action] == [0, 1, 2, 3, 4]


def test_a_channel_is_named_by_its_index_and_no_channel_by_nothing() -> None:
    assert [channel_name(index) for index in range(len(LIMITED))] == list(LIMITED)
    assert channel_name(NO_CHANNEL) == ""
    assert NO_CHANNEL == -1
    assert LIMITED[ERROR_AT] == "following_error_m"
    assert LIMITED[:ERROR_AT] == FAST_INPUTS


def test_a_cause_of_no_channel_is_explained_of_a_channel() -> None:
    assert explain(Cause.LIMIT_LOW).sentence == "a channel is below its limit"
    assert explain(Cause.LIMIT_LOW, "load_N").sentence == "load_N is below its limit"
    assert explain(Cause.ESTOP_OPEN).remedy == EXPLANATIONS[Cause.ESTOP_OPEN].remedy


@pytest.mark.parametrize("part", ["LOOP", "FIELD", "SUPERVISOR", "RECORDER"])
def test_where_a_part_was_lost_the_file_is_named_in_which_it_may_have_said_why(part: str) -> None:
    remedy = explain(Cause[f"{part}_LOST"]).remedy
    assert "session.log in the run's folder" in remedy
    # Or it was well, and waited for longer than this key allows.
    assert f"`{part.lower()}_silence`" in remedy


def test_a_table_has_a_row_for_each_limit_in_the_order_given() -> None:
    table = limit_table(
        [
            ChannelLimit("load_N", -1e4, 2e4, "ramp_down", 0.005, 30.0, 0.25, 1.5),
            ChannelLimit("position_m", high=0.5, action="hold"),
            ChannelLimit("following_error_m", low=-0.1, action="indicate", for_s=0.0016),
        ],
        1e-3,
    )
    assert table.channel.tolist() == [5, 0, ERROR_AT]
    assert table.low.tolist() == [-1e4, -inf, -0.1]
    assert table.high.tolist() == [2e4, 0.5, inf]
    assert table.hysteresis.tolist() == [30.0, 0.0, 0.0]
    assert table.action.tolist() == [Action.RAMP_DOWN, Action.HOLD, Action.INDICATE]
    assert table.ticks.tolist() == [6, 1, 3]
    whole = np.iinfo(np.int64)
    assert table.begin.tolist() == [250, whole.min, whole.min]
    assert table.end.tolist() == [1500, whole.max, whole.max]
    assert {array.dtype for array in table} == {np.dtype(np.int64), np.dtype(np.float64)}


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0)])
def test_a_limit_that_no_value_is_within_is_refused_by_name(low: float, high: float) -> None:
    with pytest.raises(ValueError, match=f"limit of load_N: low {low:g} is not below {high:g}"):
        limit_table([ChannelLimit("load_N", low, high)], 1e-3)


def test_a_limit_of_no_channel_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="limit of 'lode_N': no such channel"):
        limit_table([ChannelLimit("lode_N", 0.0, 1.0)], 1e-3)


def test_a_test_s_limit_has_a_rung_for_each_band_and_stretch() -> None:
    limit = TestLimit(
        "load_N", "N", -2.0, 4.0, -1.0, 3.0, "hold", 0.02, 0.5, windows_s=((0.0, 1.0), (3.0, 4.0))
    )
    slow = TestLimit("oil_temperature_K", "K", high=330.0)
    inner = [
        ChannelLimit("load_N", -1.0, 3.0, "indicate", 0.02, 0.5, *at) for at in limit.windows_s
    ]
    outer = [ChannelLimit("load_N", -2.0, 4.0, "hold", 0.02, 0.5, *at) for at in limit.windows_s]
    found = list(rungs_with_bands([slow, limit]))
    assert [rung for rung, _, _ in found] == [*inner, *outer]
    assert all(each is limit for _, each, _ in found)
    assert [band.name for _, _, band in found] == ["inner", "inner", "outer", "outer"]
    assert rungs_of([slow, limit]) == (*inner, *outer)


def test_a_test_s_limit_without_stretches_holds_in_the_whole_test() -> None:
    (rung,) = rungs_of([TestLimit("load_N", "N", high=4.0)])
    assert (rung.from_s, rung.until_s) == ALWAYS
    assert rung.action == "trip"
