from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.io.simulated import SimulatedRig, simulated_rig
from rig.loop.homing import Homing, HomingError, HomingSample, Phase
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.judging import Tick, allowed_command, check_sample, interlock
from rig.loop.interlocks.ladder import Action, Cause, limit_table
from rig.plant import NO_FAULT, NOMINAL, Model
from rig.plant.integrator import TICK, advance
from rig.plant.sensors import DATA_SHEET

SETTINGS = HomingSettings()
LOOKS = 20
"""Ticks from one look of the supervisor to the next: 50 Hz."""
SWITCHED_ON_AT = 0.123
"""Where the ram stands in its stroke when the encoder is switched on and reads 0, m."""


class HomedRig:
    """A simulated rig under the interlock, homed by looks at 50 Hz at what the loop samples."""

    def __init__(
        self,
        settings: HomingSettings = SETTINGS,
        null_bias_m: float = 1.5e-6,
        null_V: float = 0.0,  # noqa: N803
    ) -> None:
        self.null_V = null_V
        model = Model(parameters=NOMINAL._replace(spool_null_bias=null_bias_m))
        self.rig: SimulatedRig = simulated_rig(model, 1)
        self.rig.state[4] = SWITCHED_ON_AT
        self.homing = Homing(settings, NOMINAL, DATA_SHEET.position_resolution)
        supplied = frozenset({"position_m", "pressure_1_Pa", "pressure_2_Pa"})
        limits = limit_table([ChannelLimit("position_m", 0.005, 0.6)], TICK)
        tol = tolerances(NOMINAL, DATA_SHEET, supplied, TICK, 0.1, settings)
        self.interlock = interlock(limits, tol._replace(null_V=null_V))
        self.encoder: Callable[[float], float] = lambda position: position - SWITCHED_ON_AT
        self.worst = (0, 0, -1)
        self.greatest_load_pressure = 0.0

    def run(self) -> float:
        """Home, and return the offset found; raises what homing raises."""
        command, inputs = 0.0, np.full(len(FAST_INPUTS), np.nan)
        state = self.rig.state
        for tick in range(200_000):
            noise = DATA_SHEET.pressure_noise * self.rig.noise(1)[0]
            counts = round(self.encoder(state[4]) / DATA_SHEET.position_resolution)
            inputs[0] = counts * DATA_SHEET.position_resolution
            inputs[1:3] = np.maximum(state[2:4], 0.0) + noise[1:3]
            allowed = allowed_command(
                command, False, self.interlock.tolerances, self.interlock.memory
            )
            found = check_sample(
                Tick(inputs, True, 1, 0.15, 0, allowed, float(tick), True, False),
                self.interlock,
            )
            self.worst = max(self.worst, found)
            self.greatest_load_pressure = max(
                self.greatest_load_pressure, abs(float(state[2] - state[3]))
            )
            if tick % LOOKS == 0:
                sample = HomingSample(tick * TICK, *inputs[:3])
                command = self.homing.next_command(sample) + self.null_V
                if self.homing.offset_m is not None:
                    return self.homing.offset_m
            advance(state, allowed, self.rig.parameters, tuple(NO_FAULT))
        raise AssertionError("homing neither ended nor gave up")


@pytest.mark.parametrize("end", ["retract", "extend"])
def test_homing_finds_where_the_encoder_was_switched_on(end: Literal["retract", "extend"]) -> None:
    rig = HomedRig(replace(SETTINGS, end=end))
    offset = rig.run()
    assert abs(offset - SWITCHED_ON_AT) <= 5 * DATA_SHEET.position_resolution
    assert rig.homing.phase is Phase.DONE


def test_the_stroke_end_is_met_gently_and_without_a_trip() -> None:
    rig = HomedRig()
    rig.run()
    assert rig.worst[0] == Action.NONE
    assert rig.greatest_load_pressure < SETTINGS.load_pressure


@pytest.mark.parametrize("bias", [-5e-6, 5e-6])
def test_a_valve_null_off_by_five_micrometres_is_homed_all_the_same(bias: float) -> None:
    rig = HomedRig(replace(SETTINGS, command=1.0), bias)
    assert abs(rig.run() - SWITCHED_ON_AT) <= 5 * DATA_SHEET.position_resolution
    assert rig.worst[0] == Action.NONE


@pytest.mark.parametrize("bias", [-1.2e-5, 1.2e-5])
def test_a_null_that_the_control_knows_does_not_count_however_far_it_is_off(bias: float) -> None:
    rig = HomedRig(SETTINGS, bias, null_V=-bias / NOMINAL.valve_gain)
    assert abs(rig.run() - SWITCHED_ON_AT) <= 5 * DATA_SHEET.position_resolution
    assert rig.worst[0] == Action.NONE
    assert rig.greatest_load_pressure < SETTINGS.load_pressure


def test_a_valve_null_that_outdoes_the_command_is_refused() -> None:
    with pytest.raises(HomingError, match="null"):
        HomedRig(SETTINGS, 2e-5).run()


def test_an_encoder_that_counts_backwards_is_refused() -> None:
    rig = HomedRig()
    rig.encoder = lambda position: SWITCHED_ON_AT - position
    with pytest.raises(HomingError, match="wrong way"):
        rig.run()


def test_a_frozen_encoder_is_no_stroke_end() -> None:
    rig = HomedRig()
    rig.encoder = lambda position: 0.0
    with pytest.raises(HomingError, match=r"pushes with -?\d"):
        rig.run()


def test_a_ram_without_supply_is_not_taken_for_one_at_its_stop() -> None:
    rig = HomedRig()
    rig.rig.parameters = NOMINAL._replace(supply_pressure=1e6)
    rig.rig.state[2:4], rig.rig.state[7] = 5e5, 1e6
    with pytest.raises(HomingError, match="supply"):
        rig.run()


def test_counts_lost_between_the_approaches_are_noticed() -> None:
    rig = HomedRig()

    def lossy(position: float) -> float:
        lost = 0.0 if rig.homing.phase is Phase.APPROACH else 1e-3
        return position - SWITCHED_ON_AT - lost

    rig.encoder = lossy
    with pytest.raises(HomingError, match=r"3\d counts apart"):
        rig.run()


def test_an_encoder_of_too_fine_a_scale_is_refused() -> None:
    rig = HomedRig(replace(SETTINGS, timeout=600.0))
    rig.encoder = lambda position: 10.0 * (position - SWITCHED_ON_AT)
    with pytest.raises(HomingError, match="scale"):
        rig.run()


def test_a_stop_that_does_not_come_in_time_ends_the_run() -> None:
    rig = HomedRig(replace(SETTINGS, timeout=1.0))
    with pytest.raises(HomingError, match="within 1 s"):
        rig.run()


def test_a_blocked_ram_that_is_pushed_hard_trips_with_its_cause() -> None:
    rig = HomedRig()
    inputs = np.full(len(FAST_INPUTS), np.nan)
    for tick in range(100):
        inputs[:3] = 0.0, 1e7 + 1e3 * tick, 1e6 + 1e3 * tick
        found = check_sample(
            Tick(inputs, True, 1, 0.15, 0, 0.5, float(tick), True, False), rig.interlock
        )
    assert found[:2] == (Action.TRIP, Cause.HOMING_FORCE)
