"""Healthy motions of a simulated rig under the interlock, and what each fault of it leads to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from control.position_loop import proportional_command
from faults.schedule import FaultSchedule
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.rigs.rig import load_rig
from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.io.simulated import simulated_rig
from rig.loop.interlocks.check_tolerances import Tolerances, frozen_samples, sigmas, tolerances
from rig.loop.interlocks.judging import (
    Interlock,
    InterlockMemory,
    Tick,
    check_sample,
    interlock_memory,
)
from rig.loop.interlocks.ladder import Cause, LimitTable, limit_table
from rig.loop.interlocks.passing_log import PassingLog
from rig.loop.interlocks.passings import passing_log
from rig.loop.interlocks.plausibility import Evidence
from rig.plant import NOMINAL, Parameters
from rig.plant.dynamics import leak_flows, spring_force
from rig.plant.integrator import TICK, advance
from rig.plant.sensors import DATA_SHEET, READING_COUNT, SensorParameters, read_sensors
from rig.plant.transducer_effects import TRANSDUCERS_SIZE

Array = NDArray[np.float64]

FAULTS: Final = (
    "none",
    "reversed encoder",
    "frozen encoder",
    "jumping encoder",
    "frozen pressure",
    "crossed pressures",
    "stuck spool",
    "dead supply sensor",
    "no position",
    "pressure on the supply line",
    "railed spool sensor",
    "stopped device",
    "deaf device",
    "wrong output",
    "encoder of double scale",
    "open emergency stop",
    "watchdog",
    "disabled valve",
    "lost counts",
    "no sample",
)
SUPPLIED: Final = frozenset(name for name in FAST_INPUTS if not name.startswith("flow_"))
LIMITS: Final = (
    ChannelLimit("pressure_1_Pa", high=2e7, for_s=3e-3),
    ChannelLimit("pressure_2_Pa", high=2e7, for_s=3e-3),
)


USUAL_EXCHANGE: Final = 0.15
"""Ticks that an exchange takes."""

_STALLS_EVERY = 97
"""Ticks from one stall of the loop to the next."""


@njit(cache=True, error_model="numpy")
def _advanced(plant: Array, command: float, par: Parameters, fault: tuple[float, ...]) -> None:
    """Advance the plant by a tick; the code of `advance`, which is long, stands here only once."""
    advance(plant, command, par, fault)


@njit(cache=True, error_model="numpy")
def _interlocked(
    setpoint: Array, open_loop: bool, faults: Array, every: int, usual: float, stall: int,
    in_exchange: bool,
    kind: int, at: int,
    plant: Array, par: Parameters, sensors: SensorParameters, noise: Array, limits: LimitTable,
    tol: Tolerances, memory: InterlockMemory, log: PassingLog, peak: Array,
) -> tuple[int, int, int]:  # fmt: skip
    """Run until the ram is stopped; return (tick, cause, channel), tick -1 if it never was."""
    reading, inputs, held_inputs = np.empty(READING_COUNT), np.ones(17), np.ones(17)
    meters, offsets = np.zeros(3), np.zeros(3)
    seen = np.zeros(TRANSDUCERS_SIZE)
    command = last = 0.0
    age, position = 0, 0.0
    elapsed = owed = 0
    for k in range(setpoint.size):
        elapsed += 1
        exchange = usual
        faulty = kind if k >= at else 0
        fault = (
            faults[k, 0], faults[k, 1], faults[k, 2], faults[k, 3], faults[k, 4],
            faults[k, 5], faults[k, 6], faults[k, 7],
        )  # fmt: skip
        leaks = leak_flows(max(plant[2], 0.0), max(plant[3], 0.0), plant[8], par, fault)
        load = spring_force(plant[4], par)
        read_sensors(
            plant, seen, leaks, load, meters, offsets, noise[k], par, sensors, reading
        )  # fmt: skip
        for i in range(6):
            inputs[i] = reading[i]
        inputs[6:9] = np.nan
        inputs[9], inputs[10], inputs[11], inputs[12], inputs[13] = 1.0, 0.0, 1.0, 0.0, 0.0
        inputs[14], inputs[15], inputs[16] = k % 65536, k % 65536, last
        fresh = k % every == 0
        if 0 < k % _STALLS_EVERY <= stall:
            _advanced(plant, command, par, fault)
            continue
        if faulty == 1:
            inputs[0] = 2.0 * held_inputs[0] - inputs[0]
        elif faulty == 2:
            inputs[0] = held_inputs[0]
        elif faulty == 3:
            inputs[0] += 0.01
        elif faulty == 4:
            inputs[1] = held_inputs[1]
        elif faulty == 5:
            inputs[1], inputs[2] = reading[2], reading[1]
        elif faulty == 7:
            inputs[4] = max(sensors.pressure_noise * noise[k, 4], 0.0)
        elif faulty == 8:
            inputs[0] = np.nan
        elif faulty == 9:
            inputs[1], inputs[4] = reading[4], reading[1]
        elif faulty == 10:
            inputs[3] = sensors.spool_range
        elif faulty == 11:
            inputs[14] = held_inputs[14]
        elif faulty == 12:
            inputs[15] = held_inputs[15]
        elif faulty == 13:
            inputs[16] = last + 0.5
        elif faulty == 14:
            inputs[0] = 2.0 * inputs[0] - held_inputs[0]
        elif faulty == 15:
            inputs[9] = 0.0
        elif faulty == 16:
            inputs[12] = 1.0
        elif faulty == 17:
            inputs[11] = 0.0
        elif faulty == 18:
            inputs[13] = 1.0
        elif faulty == 19:
            fresh = False
        if k < at:
            held_inputs[:] = inputs
        if kind == 0 and not fresh:
            inputs[:] = np.nan
        age = 0 if fresh else age + 1
        if in_exchange:
            # The sample came late within its exchange; only then the loop sees what it missed.
            late = elapsed - 1
            elapsed, exchange, owed = 1 + owed, exchange + late, late
        action, cause, channel = check_sample(
            Tick(
                inputs,
                fresh,
                elapsed,
                exchange,
                age,
                command,
                float(k),
                True,
                True,
                np.nan,
                0,
                k,
                k,
            ),
            Interlock(limits, tol, memory, log),
        )
        elapsed = 0
        for i in range(peak.size):
            peak[i] = max(peak[i], memory.evidence[i])
        if action >= 3:
            return k, cause, channel
        driven = command
        last = command
        if not open_loop and not fresh:
            inputs[0] = position
        position = inputs[0]
        if faulty == 6:
            plant[0], plant[1] = held_inputs[3], 0.0
            driven = held_inputs[3] / par.valve_gain
        _advanced(plant, driven, par, fault)
        if open_loop:
            command = setpoint[k]
        else:
            command = proportional_command(setpoint[k], inputs[0], 50.0, 10.0)
    return -1, 0, -1


@dataclass(frozen=True)
class Motion:
    """What the ram is asked to do, by a setpoint (ticks,), from a position in m."""

    setpoint: Array
    open_loop: bool = False
    start: float = 0.3


@dataclass(frozen=True)
class Outcome:
    """How a run ended: tick and cause, tick -1 if nothing stopped it."""

    tick: int
    cause: Cause
    channel: str
    peak: Evidence


def run(
    motion: Motion,
    fault: str = "none",
    at: int = 0,
    *,
    par: Parameters | None = None,
    faults: Array | None = None,
    every: int = 1,
    exchange: float = USUAL_EXCHANGE,
    stall: int = 0,
    in_exchange: bool = False,
    seed: int = 1,
) -> Outcome:
    ticks = motion.setpoint.size
    rig = simulated_rig(load_rig("simulated").plant, seed)
    rig.state[4] = motion.start
    if faults is None:
        faults = np.zeros((ticks, 8))
    tol = tolerances(NOMINAL, DATA_SHEET, SUPPLIED, TICK, 0.1, HomingSettings())
    limits = limit_table(LIMITS, TICK)
    peak = np.zeros(len(Evidence._fields))
    tick, cause, channel = _interlocked(
        motion.setpoint, motion.open_loop, faults, every, exchange, stall, in_exchange,
        FAULTS.index(fault), at, rig.state, par or rig.parameters, rig.sensors, rig.noise(ticks),
        limits, tol, interlock_memory(limits.channel.size), passing_log(), peak,
    )  # fmt: skip
    return Outcome(
        tick, Cause(cause), FAST_INPUTS[channel] if channel >= 0 else "", Evidence(*peak)
    )


CAMPAIGNS = sorted((Path(__file__).parents[4] / "config/campaigns").glob("*.yaml"))


@pytest.mark.parametrize(
    "path",
    [CAMPAIGNS[0], *(pytest.param(path, marks=pytest.mark.long) for path in CAMPAIGNS[1:])],
    ids=lambda path: path.stem,
)
def test_no_shipped_campaign_trips_whatever_leak_it_injects(path: Path) -> None:
    campaign, rig = load_campaign(path)
    for test in campaign.tests:
        ticks = round(test.duration_s / TICK)
        setpoint = np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK))
        motion = Motion(setpoint, test.setpoint.quantity == "command", test.start_position_m)
        plant, load = rig.plant, test.load
        if load is not None:
            plant = plant.with_effect("spring_load", stiffness=load.stiffness, contact=load.contact)
        faults = FaultSchedule(test.faults).table(ticks, TICK)
        outcome = run(motion, par=plant.parameters, faults=faults, seed=test.seed)
        assert outcome.cause is Cause.NONE, test.name


TICKS = 180_000
TIME = np.arange(TICKS) * TICK


def random_steps(seed: int, hold: int) -> Motion:
    generator = np.random.default_rng(seed)
    return Motion(np.repeat(generator.uniform(0.02, 0.58, TICKS // hold), hold))


def random_valve(seed: int, hold: int, volts: float) -> Motion:
    """Return random commands; the ram meets its stroke ends."""
    generator = np.random.default_rng(seed)
    return Motion(np.repeat(generator.uniform(-volts, volts, TICKS // hold), hold), open_loop=True)


HEALTHY = {
    "steps of half a second": random_steps(1, 500),
    "steps of 50 ms": random_steps(2, 50),
    "steps of 5 s": random_steps(3, 5000),
    "valve noise at full command": random_valve(4, 10, 10.0),
    "slow valve noise at full command": random_valve(5, 200, 10.0),
    "valve noise": random_valve(6, 20, 2.0),
    "fast sine": Motion(0.3 + 0.2 * np.sin(2 * np.pi * 0.5 * TIME)),
    "slow sine": Motion(0.3 + 0.2 * np.sin(2 * np.pi * 0.02 * TIME)),
    "chirp to 20 Hz": Motion(0.3 + 0.03 * np.sin(2 * np.pi * 0.5 * 20.0 / 180.0 * TIME**2)),
    "at rest": Motion(np.full(TICKS, 0.3)),
}
"""Three minutes each: half an hour of rig time."""


@pytest.mark.long
@pytest.mark.parametrize("name", HEALTHY)
def test_half_an_hour_of_healthy_motions_makes_no_false_trip(name: str) -> None:
    outcome = run(HEALTHY[name])
    assert outcome.cause is Cause.NONE
    # Not by luck: no account came even to half of what trips.
    assert max(outcome.peak.high_m, outcome.peak.low_m) < 2.5e-3
    assert outcome.peak.work_J < 10.0


@pytest.mark.long
@pytest.mark.parametrize("column", range(8))
def test_the_greatest_fault_that_a_bypass_makes_is_no_trip(column: int) -> None:
    coefficient = (2.6e-8, 2.6e-8, 2.6e-8, 1e-11, 1e-11, 1e-11, 9.2e-8, 4e13)[column]
    faults = np.zeros((TICKS, 8))
    faults[TICKS // 2 :, column] = coefficient
    for name in ("steps of half a second", "fast sine", "at rest"):
        assert run(HEALTHY[name], faults=faults).cause is Cause.NONE


@pytest.mark.long
@pytest.mark.parametrize("exchange", [0.15, 0.6, 1.2, 3.0])
@pytest.mark.parametrize("every", [4, 10])
def test_a_device_slower_than_the_loop_makes_no_false_trip(every: int, exchange: float) -> None:
    for motion in (HEALTHY["fast sine"], random_steps(7, 2000)):
        assert run(motion, every=every, exchange=exchange).cause is Cause.NONE


@pytest.mark.long
@pytest.mark.parametrize("fault", ["reversed encoder", "frozen encoder", "encoder of double scale"])
def test_an_encoder_that_errs_is_found_out_by_a_device_slower_than_the_loop(fault: str) -> None:
    outcome = run(HEALTHY["fast sine"], fault, 10_000, every=4, exchange=1.2)
    assert outcome.cause in CAUGHT[fault].causes
    assert 0 <= outcome.tick - 10_000 <= 2 * CAUGHT[fault].ticks


@pytest.mark.long
@pytest.mark.parametrize("every", [4, 10])
def test_a_device_slower_than_the_loop_that_falls_silent_trips_by_the_age_of_its_sample(
    every: int,
) -> None:
    assert run(HEALTHY["fast sine"], every=every).cause is Cause.NONE
    outcome = run(HEALTHY["fast sine"], "no sample", 10_000, every=every)
    assert outcome.cause is Cause.STALE_SAMPLE
    assert CAUGHT["no sample"].ticks - every <= outcome.tick - 10_000 <= CAUGHT["no sample"].ticks


@pytest.mark.long
@pytest.mark.parametrize("in_exchange", [False, True], ids=["asleep", "in an exchange"])
@pytest.mark.parametrize("stall", [1, 5, 20])
def test_missed_ticks_make_no_false_trip(stall: int, in_exchange: bool) -> None:
    for name in ("fast sine", "steps of half a second", "valve noise"):
        outcome = run(HEALTHY[name], stall=stall, in_exchange=in_exchange)
        assert outcome.cause is Cause.NONE


@dataclass(frozen=True)
class Caught:
    """By what a fault is caught during a sine of 0.2 m and 0.5 Hz, and within how many ticks."""

    causes: frozenset[Cause]
    ticks: int


def caught(ticks: int, *causes: Cause) -> Caught:
    return Caught(frozenset(causes), ticks)


CAUGHT: Final = {
    "reversed encoder": caught(50, Cause.POSITION_AGAINST_FLOW),
    "frozen encoder": caught(100, Cause.ENCODER_FROZEN),
    "jumping encoder": caught(0, Cause.ENCODER_JUMP),
    "encoder of double scale": caught(100, Cause.POSITION_AGAINST_FLOW),
    "frozen pressure": caught(frozen_samples(TICK), Cause.SENSOR_FROZEN),
    "crossed pressures": caught(100, Cause.PRESSURES_CROSSED),
    "pressure on the supply line": caught(
        100, Cause.PRESSURE_ABOVE_SUPPLY, Cause.POSITION_AGAINST_FLOW, Cause.PRESSURES_CROSSED
    ),
    "stuck spool": caught(300, Cause.SPOOL_NOT_FOLLOWING),
    "railed spool sensor": caught(5, Cause.SENSOR_RANGE),
    "dead supply sensor": caught(60, Cause.PRESSURE_ABOVE_SUPPLY),
    "no position": caught(5, Cause.SENSOR_NAN),
    "stopped device": caught(101, Cause.DEVICE_STOPPED),
    "deaf device": caught(30, Cause.DEVICE_DEAF),
    "wrong output": caught(30, Cause.COMMAND_ECHO),
    "open emergency stop": caught(0, Cause.ESTOP_OPEN),
    "watchdog": caught(0, Cause.WATCHDOG_TRIPPED),
    "disabled valve": caught(21, Cause.VALVE_NOT_ENABLED),
    "lost counts": caught(0, Cause.ENCODER_FAULT),
    "no sample": caught(101, Cause.STALE_SAMPLE),
}
"""The times that docs/safety.md states."""


@pytest.mark.parametrize("fault", FAULTS[1:])
@pytest.mark.parametrize("at", [2_000, 2_500, 3_234])
def test_each_fault_stops_a_moving_ram_by_its_name_within_its_time(fault: str, at: int) -> None:
    outcome = run(HEALTHY["fast sine"], fault, at)
    assert outcome.cause in CAUGHT[fault].causes
    assert 0 <= outcome.tick - at <= CAUGHT[fault].ticks


def test_thresholds_are_those_of_one_false_trip_in_ten_years() -> None:
    checks = 10.0 * 365.25 * 86400.0 / TICK * 12
    assert sigmas(TICK) == pytest.approx(7.22, abs=0.01)
    assert checks * 0.5 ** frozen_samples(TICK) < 1.0 < checks * 0.5 ** (frozen_samples(TICK) - 1)


def test_a_sensor_without_noise_on_its_data_sheet_is_not_called_frozen() -> None:
    silent = DATA_SHEET._replace(pressure_noise=0.0)
    tol = tolerances(NOMINAL, silent, SUPPLIED, TICK, 0.1, HomingSettings())
    assert tol.frozen_samples[FAST_INPUTS.index("pressure_1_Pa")] == 0
    assert tol.frozen_samples[FAST_INPUTS.index("spool_m")] == frozen_samples(TICK)
