"""A recording of the loop on the wire replays to what was judged and estimated while it ran.

The loop is the compiled one, the device an emulated one behind a socket. It goes on by a few
milliseconds with every exchange, however long that takes: what is found depends on no clock.
"""

import json
import os
import socket
import threading
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import OUTPUTS, compiled_filter, start_memory
from estimator.leaks.replaying import detector_for
from rig.cli import main
from rig.configuration import plain
from rig.configuration.rigs.rig import load_rig
from rig.emulator.instruments import Instruments
from rig.emulator.modbus.functions import serve
from rig.emulator.modbus.io_node import IoNode
from rig.emulator.modbus.mapped_device import MappedDevice
from rig.emulator.plant import EmulatedPlant
from rig.emulator.record import Record
from rig.io.modbus_daq.plan import exchange_plans
from rig.io.modbus_daq.register_map import ExchangeMode, RegisterMap
from rig.io.settings import HomingSettings, LoopSettings
from rig.io.signals import FAST_INPUTS
from rig.loop.board import Board, Word
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.judging import interlock
from rig.loop.interlocks.ladder import limit_table
from rig.loop.wire.cycle import wire_ticks
from rig.loop.wire.layout import Drive, pace, wire_channels, wire_memory
from rig.loop.wire.orders import Segment, control_in, course
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import DATA_SHEET
from rig.recording import division_of, read_recording
from rig.recording.formats.mcap_writer import McapWriter
from rig.recording.recording import content_hash
from rig.runner.campaign.judging import Judge
from rig.runner.outcomes.recorded import with_estimates

Array = NDArray[np.float64]

TICKS = 10_000
LEAK, LEAK_AT_S = "external_leakage_1", 5.0
COEFFICIENT = 0.8 * LITRE_PER_MINUTE / np.sqrt(6.9e6)
SEGMENT, ENDED = 1, 2
FOREVER_S = 1e3
READING = (3, 23, 76)
"""Modbus functions with which an exchange ends."""
CHANNELS = wire_channels(start_memory("product", Model()).filter.states, open_loop=False)


@dataclass(frozen=True)
class Wire:
    """The device of a shipped rig, and how samples are exchanged with it."""

    rig: str
    mode: ExchangeMode
    rate_hz: float

    @property
    def map(self) -> RegisterMap:
        """Its registers."""
        (spec,) = (spec for spec in load_rig(self.rig).drivers if spec.kind == "fast")
        registers: RegisterMap = spec.options.map
        return registers


class Device:
    """An emulated device behind a socket, whose time goes on with each exchange."""

    def __init__(self, wire: Wire, leak: float, board: Board) -> None:
        self.socket, self._mine = socket.socketpair()
        self.now_ns = 0
        self._words = board.words
        self._period_ns = round(1e9 / wire.rate_hz)
        rig = load_rig(wire.rig)
        self._needle = rig.bypass_valves[LEAK].needle_opening_for(leak) if leak else 0.0
        self._plant = EmulatedPlant(
            rig.plant, rig.sensors, bypass_valves=rig.bypass_valves, clock=lambda: self.now_ns
        )
        self.start_m = self._plant.sensors.position_resolution * self._plant.encoder_counts()
        parts = Instruments(self._plant), self._plant.drive_valve, Record(clock=lambda: self.now_ns)
        self._device: IoNode | MappedDevice
        if wire.rig == "emulated":
            self._device = IoNode(*parts)
        else:
            self._device = MappedDevice(wire.map, *parts)
        self._thread = threading.Thread(target=self._serve, name="device")

    def __enter__(self) -> "Device":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()
        self._thread.join()
        self._mine.close()

    def _serve(self) -> None:
        while request := self._mine.recv(1024):
            reply = serve(self._device, request[7:])
            self._mine.sendall(
                request[:4] + (len(reply) + 1).to_bytes(2, "big") + request[6:7] + reply
            )
            if request[7] in READING:
                self._go_on()

    def _go_on(self) -> None:
        self.now_ns += self._period_ns
        self._device.press_reset(self._device.lamp and not self._device.enabled)
        if self.now_ns == round(1e9 * LEAK_AT_S):
            self._plant.set_bypass(LEAK, float(self._needle > 0.0), self._needle)
        if self.now_ns > round(1e9 * TICK * TICKS):
            self._words[Word.SWITCH] = ENDED


def streamed(wire: Wire, leak: float) -> Array:
    """Return the rows of a test over a wire, with a leak (coefficient, SI) or none from 5 s on."""
    board = Board.create(len(CHANNELS))
    board.words[Word.SWITCH], board.words[Word.HOMED] = SEGMENT, 1
    settings = LoopSettings(overrun="realign")
    tol = tolerances(
        Model().parameters, DATA_SHEET, frozenset(FAST_INPUTS[:4]), TICK, FOREVER_S,
        HomingSettings(),
    )  # fmt: skip
    # The loop's own time is not the device's, and what compares both has nothing to go by.
    tol = tol._replace(flow_account_m=inf, spool_m=inf)
    # A period must be longer than twice the time that this machine takes to wake up.
    hurried = pace(settings, wire.rate_hz)._replace(
        period_ns=200_000, timeout_ns=round(1e9 * FOREVER_S), stale_ns=round(1e9 * FOREVER_S)
    )
    with Device(wire, leak, board) as device:
        setpoint = device.start_m + 0.2 * np.sin(np.pi * TICK * np.arange(TICKS))
        memory = start_memory("product", Model())
        planned = course(Segment(
            SEGMENT, Drive.TRACK, memory, Model().parameters, setpoint=setpoint,
            offset_m=device.start_m, valve_enable=True, reset_lamp=True,
        ))  # fmt: skip
        wire_ticks(
            planned, control_in(planned),
            compiled_filter(memory, Model().parameters),
            interlock(limit_table((), TICK), tol),
            hurried,
            device.socket.fileno(),
            *exchange_plans(wire.map, wire.mode, 1),
            wire_memory(),
            board,
        )  # fmt: skip
    assert not board.words[Word.LOOP_TRIP]
    rows = board.ring[: int(board.words[Word.ROWS])].copy()
    os.close(board.fd)
    return rows[rows[:, CHANNELS.index("segment")] == SEGMENT]


def judged(rows: Array) -> Judge:
    """Return what was held while the rows came, however many at a time."""
    memory = start_memory("product", Model())
    judge = Judge(detector_for("product", Model(), 1.0), memory, CHANNELS)
    while len(rows):
        some = min(70, judge.ticks_due)
        judge.take(rows[:some])
        rows = rows[some:]
    judge.finish()
    return judge


@pytest.mark.parametrize(
    ("wire", "leak"),
    [
        (Wire("emulated", "fc23", 1000.0), COEFFICIENT),
        (Wire("emulated", "fc16_fc3", 250.0), 0.0),
        (Wire("labjack", "fc76", 250.0), COEFFICIENT),
    ],
    ids=["1 kHz", "250 Hz, two transactions", "LabJack"],
)
def test_a_recording_of_the_wire_replays_to_the_same_verdict_and_the_same_bits(
    wire: Wire, leak: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = streamed(wire, leak)
    fresh = np.isfinite(rows[:, CHANNELS.index("position_m")])
    assert np.flatnonzero(fresh).tolist() == list(range(0, TICKS, round(1000.0 / wire.rate_hz)))

    path = tmp_path / "wire.mcap"
    noted = {"model": plain(Model()), "detector": {"filter": "product"}}
    with McapWriter(path, CHANNELS, noted, division_of(CHANNELS)) as writer:
        writer.write(rows)
    with pytest.raises(SystemExit):
        main(["replay", "--json", str(path)])
    told = json.loads(capsys.readouterr().out)
    judge = judged(rows)
    assert judge.decision is not None
    assert told["verdict"] == judge.decision.verdict == (LEAK if leak else "healthy")
    assert told["detected_at_s"] == judge.detected_at_s
    assert told["onset_s"] == judge.decision.onset_s
    assert told["leak_coefficient"] == judge.decision.coefficient
    if leak:
        assert told["leak_coefficient"] == pytest.approx(leak, rel=0.05)

    recording = read_recording(path)
    assert set(OUTPUTS) <= set(recording.replayed)
    recorded = {
        name: np.ascontiguousarray(values) for name, values in zip(CHANNELS, rows.T, strict=True)
    }
    assert with_estimates(recording).content_hash() == content_hash(recorded)
