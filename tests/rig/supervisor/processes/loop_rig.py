"""A loop process without the rest of a session, and functions to give it orders in tests."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.filters.registry import start_memory
from rig.io.limits import ChannelLimit
from rig.io.registry import DriverSpec
from rig.io.settings import HomingSettings, LoopSettings
from rig.io.transducer_calibration import TransducerCalibration
from rig.loop.board import RING_ROWS, Board, Word
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.ladder import limit_table
from rig.loop.wire.layout import Drive, wire_channels
from rig.loop.wire.loop import WireLoop
from rig.loop.wire.orders import Open, Opened, Segment
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET
from rig.supervisor.processes.child import Child, News
from tests.waiting import COMPILE_S, until

MODEL = Model()
# The limits are long, so that a host that stalls does not trip the loop.
SETTINGS = LoopSettings(priority=0, stale_limit=10.0, exchange_timeout=0.05)


def segment(number: int, drive: Drive, **options: Any) -> Segment:
    memory = start_memory("product", MODEL)
    return Segment(number, drive, memory, MODEL.parameters, **options)


@dataclass
class LoopRig:
    """A loop process without the other processes of a session, and the board that it uses."""

    board: Board
    child: Child
    news: list[News] = field(default_factory=list)
    channels: tuple[str, ...] = wire_channels(
        start_memory("product", MODEL).filter.states, open_loop=False
    )

    def ask(self, order: object) -> Any:
        self.child.send(order)
        return self.child.answer(COMPILE_S)

    def open_driver(
        self,
        spec: DriverSpec,
        limits: tuple[ChannelLimit, ...] = (),
        calibrations: tuple[TransducerCalibration, ...] = (),
    ) -> Opened:
        self.board.words[Word.SWITCH] = 1
        opened: Opened = self.ask(
            Open(
                spec,
                SETTINGS,
                limit_table(limits, TICK),
                tolerances(
                    MODEL.parameters, DATA_SHEET, frozenset(spec.inputs), TICK,
                    SETTINGS.stale_limit, HomingSettings(),
                ),
                segment(1, Drive.NULL),
                calibrations,
            )
        )  # fmt: skip
        return opened

    def arm(self) -> None:
        """Order a segment that enables the valve and holds the ram; wait for the enabled valve."""
        number = int(self.board.words[Word.SWITCH]) + 1
        armed = segment(
            number, Drive.HOLD, valve_enable=True, reset_lamp=True, rearm=True, reset=True,
            homed=True,
        )  # fmt: skip
        self.ask(armed)
        self.board.words[Word.SWITCH] = number
        until(lambda: self.newest("valve_enabled") == 1.0, "the valve was enabled")

    def newest(self, channel: str) -> float:
        row = self.board.ring[(int(self.board.words[Word.ROWS]) - 1) % RING_ROWS]
        return float(row[self.channels.index(channel)])

    def test(self, ticks: int) -> WireLoop:
        here = self.newest("position_m")
        setpoint = here + 2e-3 * np.sin(2.0 * np.pi * np.arange(ticks) * TICK)
        return WireLoop(
            self.board, self.child, segment(0, Drive.TRACK, setpoint=setpoint, valve_enable=True),
            start_position=here, settle_ticks=100, silence_s=COMPILE_S,
        )  # fmt: skip
