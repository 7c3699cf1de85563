"""The loop process drives a device over a real socket, and leaves it safe whichever way it ends."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control import PLAIN
from estimator.filters.registry import OUTPUTS, run_filter
from rig.configuration.rigs.rig import load_rig
from rig.emulator.running import EmulatorThread
from rig.emulator.script.fault_script import Script
from rig.io.driver import DriverError
from rig.io.limits import ChannelLimit
from rig.io.modbus_daq.register_map import Register
from rig.io.signals import FAST_INPUTS
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError
from rig.loop.wire.orders import Close, Closed, Opened
from rig.recording import McapWriter, read_recording
from rig.supervisor.processes.child import Child, News
from tests.rig.patience import long_watchdogs, patient
from tests.rig.supervisor.processes.loop_rig import MODEL, LoopRig
from tests.waiting import COMPILE_S, until

TANK = "tank_temperature_K"
HIGH_SUPPLY = TransducerCalibration(
    "supply_pressure_Pa",
    "PT-3",
    date(2026, 3, 2),
    date(2027, 3, 2),
    (CalibrationPoint(0.0, 1e6), CalibrationPoint(2e7, 2.1e7)),
)
"""A transducer that is said to indicate 1 MPa too much."""


@dataclass
class Rig(LoopRig):
    """An emulated rig, and the loop process that drives it."""

    emulator: EmulatorThread = field(kw_only=True)

    def open(
        self,
        port: int | None = None,
        limits: tuple[ChannelLimit, ...] = (),
        calibrations: tuple[TransducerCalibration, ...] = (),
        **options: Any,
    ) -> Opened:
        (spec,) = (spec for spec in load_rig("emulated").drivers if spec.kind == "fast")
        port = port or int(self.emulator.ports["daq"])
        return self.open_driver(patient(spec, port=port, **options), limits, calibrations)

    @property
    def is_null(self) -> bool:
        device = self.emulator.status()["daq"]
        return device["output_V"] == 0.0 and not device["valve_enabled"]


@contextmanager
def connected(folder: Path) -> Iterator[Rig]:
    board = Board.create(len(Rig.channels))
    news: list[News] = []
    with long_watchdogs(), EmulatorThread(script=Script(attentive=True)) as emulator:
        child = Child(
            "loop",
            "rig.supervisor.processes.loop_process",
            board,
            folder / "log",
            on_news=news.append,
        )
        try:
            yield Rig(board, child, news, emulator=emulator)
        finally:
            child.end()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with connected(tmp_path) as rig:
        yield rig


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """One that outlives its trips: those who use it arm it anew.

    Nobody can after the lost count, which the emulated encoder's interface reports for good.
    """
    with connected(tmp_path_factory.mktemp("opened")) as rig:
        rig.open()
        yield rig


def test_a_calibrated_test_runs_to_its_end_and_its_filter_follows_from_the_rows_bit_for_bit(
    rig: Rig,
) -> None:
    # A device that is not there is refused with its name, and may be there later.
    with pytest.raises(DriverError, match="daq"):
        rig.open(port=1)
    assert rig.open(calibrations=(HIGH_SUPPLY,)).grants
    rig.arm()
    loop = rig.test(300)
    loop.position()
    assert loop.ready() == loop.number
    batches = []
    while loop.ticks_left:
        batches.append(loop.advance(70))
        if len(batches) == 1:
            # Another gain between two ticks takes no row away and keeps the filter's memory.
            changed_at = loop.change(80.0, PLAIN)
            assert changed_at is not None
            assert changed_at >= 70
    rows = np.concatenate(batches)
    assert rows[:, loop.channels.index("tick")].tolist() == list(range(300))
    supply = np.nanmean(rows[:, loop.channels.index("supply_pressure_Pa")])
    assert supply == pytest.approx(MODEL.parameters.supply_pressure - 1e6, abs=2e5)
    again = run_filter(rows[:, 0], rows[:, 2].copy(), rows[:, 3:8].copy(), MODEL)
    at = loop.channels.index(OUTPUTS[0])
    outputs, states = np.split(rows[:, at:], [len(OUTPUTS)], axis=1)
    assert np.array_equal(again.outputs, outputs, equal_nan=True)
    assert np.array_equal(again.states, states[:, : again.states.shape[1]], equal_nan=True)
    loop.safe_state()
    assert rig.board.words[Word.SEGMENT] == loop.number + 1
    assert rig.ask(Close()) == Closed()
    assert rig.is_null


def test_a_trip_of_another_process_nulls_the_valve_and_ends_the_test(opened: Rig) -> None:
    rig = opened
    rig.arm()
    loop = rig.test(60_000)
    loop.advance(10)
    rig.board.words[Word.FIELD_TRIP] = Cause.BYPASS_STUCK
    before = loop.advance(60_000)
    assert len(before) < 60_000
    with pytest.raises(LoopStoppedError, match="bypass") as stopped:
        loop.advance(1)
    assert (stopped.value.action, stopped.value.cause) == (Action.TRIP, Cause.BYPASS_STUCK)
    until(lambda: bool(rig.board.words[Word.VALVE_NULL_AT]), "null was confirmed")
    assert rig.is_null
    rig.board.words[Word.FIELD_TRIP] = Cause.NONE


def test_a_lost_count_trips_and_the_position_is_no_longer_known(opened: Rig) -> None:
    rig = opened
    rig.arm()
    assert rig.board.words[Word.HOMED] == 1
    rig.emulator.inject(fault="lost_counts", counts=40, flagged=True)
    until(lambda: bool(rig.board.words[Word.VALVE_NULL_AT]), "null was confirmed")
    assert rig.board.words[Word.LOOP_TRIP] == Cause.ENCODER_FAULT
    assert rig.board.words[Word.HOMED] == 0
    assert rig.is_null


def test_a_carried_transducer_is_recorded_and_its_limits_warn_and_then_trip(
    rig: Rig, tmp_path: Path
) -> None:
    (spec,) = (spec for spec in load_rig("emulated").drivers if spec.kind == "fast")
    registers = patient(spec).options.map
    register = Register(TANK, 276, "F32", "r", unit="K")
    rig.open(
        map=replace(registers, registers=(*registers.registers, register)),
        limits=(ChannelLimit(TANK, high=310.0, action="indicate"), ChannelLimit(TANK, high=330.0)),
    )
    rig.arm()
    loop = rig.test(60_000)
    rows = [loop.advance(10)]
    words = rig.board.words
    assert (words[Word.ACTION], words[Word.ACTION_CAUSE]) == (Action.INDICATE, Cause.LIMIT_HIGH)
    assert words[Word.ACTION_CHANNEL] == FAST_INPUTS.index(TANK)
    rig.emulator.inject(fault="sensor", target=TANK, reads="drift", rate=12.0)
    rows.append(loop.advance(60_000))
    until(lambda: bool(words[Word.VALVE_NULL_AT]), "null was confirmed")
    assert words[Word.LOOP_TRIP] == Cause.LIMIT_HIGH
    assert rig.is_null

    path = tmp_path / "tank.mcap"
    with McapWriter(path, rig.channels) as writer:
        writer.write(np.concatenate(rows))
    recording = read_recording(path, required=())
    assert recording[TANK][0] == pytest.approx(313.15, abs=1e-4)
    assert 329.0 < np.nanmax(recording[TANK]) < 331.0


@pytest.mark.parametrize("way", ["SIGTERM", "supervisor gone"])
def test_however_the_loop_process_ends_the_device_is_left_at_null(rig: Rig, way: str) -> None:
    rig.open()
    rig.arm()
    assert not rig.is_null
    if way == "SIGTERM":
        os.kill(rig.child._process.pid, signal.SIGTERM)
        assert rig.child.answer(COMPILE_S) == Closed()
    rig.child.end()
    assert rig.is_null
    assert rig.child.ended == "ended with exit code 0"
