"""Every column of a row on the wire says in which unit it is, and can be recorded."""

from typing import get_args

import pytest

from estimator.filters.registry import FILTERS
from rig.channels import READINGS
from rig.io.settings import LoopSettings, Overrun as Policy
from rig.io.signals import FAST_INPUTS, SLOW_INPUTS
from rig.loop.decided import PROBABILITIES
from rig.loop.wire.layout import Overrun, pace, wire_channels
from rig.recording.formats.mcap_writer import channel_problems
from rig.recording.units import unit_of

PURE_NUMBERS = (
    "filter_resets",
    "verdict_code",
    "fault_confirmed",
    *PROBABILITIES,
    "fault_action",
    "exchange_status",
    "segment",
    "tick",
    "action",
    "estop_closed",
    "reset_button",
    "valve_enabled",
    "watchdog_tripped",
    "encoder_fault",
    "device_counter",
    "device_echo",
    "drive_state",
    "drive_setpoint",
    "pump_loaded",
    "blocking_1",
    "blocking_2",
)


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("open_loop", [False, True])
def test_every_channel_has_a_unit_or_is_a_pure_number(name: str, open_loop: bool) -> None:
    channels = wire_channels(FILTERS[name].states, open_loop)
    without = [channel for channel in channels if not unit_of(channel)]
    valves = [channel for channel in without if channel.endswith(("_ball", "_needle"))]
    assert set(without) - set(valves) == set(PURE_NUMBERS)


def test_a_recording_can_have_these_channels() -> None:
    channels = wire_channels(FILTERS["product"].states, open_loop=False)
    assert not channel_problems("a.mcap", channels)


def test_all_that_is_read_has_a_column() -> None:
    channels = wire_channels(FILTERS["product"].states, open_loop=False)
    assert {*FAST_INPUTS, *SLOW_INPUTS, *READINGS} <= set(channels)


@pytest.mark.parametrize(
    ("device_Hz", "every"),
    [(1000.0, 1), (2000.0, 1), (999.0, 2), (500.0, 2), (300.0, 4)],
)
def test_a_slower_device_is_asked_no_more_often_than_it_can_answer(
    device_Hz: float,  # noqa: N803
    every: int,
) -> None:
    assert pace(LoopSettings(), device_Hz).every == every


def test_every_overrun_policy_of_a_rig_file_is_one_of_the_loop() -> None:
    for policy in get_args(Policy):
        settings = LoopSettings(overrun=policy)
        assert pace(settings, 1000.0).overrun == Overrun[policy.upper()]
