"""The emulated pump unit on CAN, whose messages a DBC describes, and its faults.

Like the emulated valve it is driven by two calls, `receive` and `cycle`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rig.io import COMMAND, STATUS, UNITS, cantools, python_can as can

from .nodes import Note, Send

_OIL_TEMPERATURE_K: Final = 313.15
"""Oil temperature that the unit reports; it never changes."""


@dataclass
class PumpFaults:
    """The faults of the emulated pump unit; each is present while it is True.

    Attributes:
        silent: the unit sends nothing.
        frozen: the unit sends the same message again and again.
        stuck: the unloading valve does not move.
        motor_fault: the motor starter has tripped, so that the unit is unloaded and reports FAULT.
        garbage: the unit also sends messages of a wrong length.
        watchdog_dead: the unit stays as it is when its host falls silent.
    """

    silent: bool = False
    frozen: bool = False
    stuck: bool = False
    motor_fault: bool = False
    garbage: bool = False
    watchdog_dead: bool = False


class PumpNode:
    """A pump unit with an unloading valve, which opens when the host is silent.

    Args:
        send: puts a frame on the bus.
        dbc: DBC file that describes the unit's messages.
        pressure: returns the supply pressure, Pa.
        load: called with whether the pump is loaded, when the unloading valve moves.
        note: takes note of what the unit receives and does; a repeated command is noted once.

    Attributes:
        faults: the unit's faults.
        loaded: whether the unit delivers pressure.
    """

    WATCHDOG: Final = 1.0
    """Time in s without a new command after which the unit unloads."""
    PERIOD: Final = 0.05
    """Time in s between two status messages."""

    def __init__(
        self,
        send: Send,
        dbc: Path,
        pressure: Callable[[], float],
        load: Callable[[bool], None],
        note: Note,
    ) -> None:
        self.faults = PumpFaults()
        self.loaded = False
        database: Any = cantools.database.load_file(dbc)
        self._status = database.get_message_by_name(STATUS[0])
        self._command = database.get_message_by_name(COMMAND[0])
        self._send_frame = send
        self._pressure = pressure
        self._load = load
        self._note = note
        self._now = 0.0
        self._status_at = 0.0
        self._alive = 0
        self._asked = False
        self._host_alive = -1
        self._host_at = 0.0
        self._last = b""

    def receive(self, frame: can.Message) -> None:
        """Handle a frame from the bus; only a command with a new alive counter does anything."""
        if frame.arbitration_id != self._command.frame_id or frame.dlc != self._command.length:
            return
        signals: Mapping[str, int] = self._command.decode(bytes(frame.data), decode_choices=False)
        if signals["AliveCounter"] == self._host_alive:
            return
        self._host_alive, self._host_at = signals["AliveCounter"], self._now
        if bool(signals["Load"]) != self._asked:
            self._asked = bool(signals["Load"])
            self._note("pump_command", load=self._asked)

    def cycle(self, now: float) -> None:
        """Watch the host, move the unloading valve, and send a status that is due at `now`, s."""
        self._now = now
        silent = now - self._host_at > self.WATCHDOG
        if self._asked and silent and not self.faults.watchdog_dead:
            self._asked = False
            self._note("pump_watchdog")
        if not self.faults.stuck:
            self._move(self._asked and not self.faults.motor_fault)
        if now >= self._status_at:
            self._status_at = now + self.PERIOD
            self._send_status()

    def _move(self, loaded: bool) -> None:
        if loaded != self.loaded:
            self.loaded = loaded
            self._note("pump_loaded" if loaded else "pump_unloaded")
            self._load(loaded)

    def _send_status(self) -> None:
        if self.faults.silent:
            return
        if not self.faults.frozen:
            self._alive = (self._alive + 1) % 16
            self._last = self._encoded()
        for data in (self._last, *((b"\xff" * 3,) if self.faults.garbage else ())):
            identifier, extended = self._status.frame_id, self._status.is_extended_frame
            self._send_frame(
                can.Message(arbitration_id=identifier, data=data, is_extended_id=extended)
            )

    def _encoded(self) -> bytes:
        values = {
            "AliveCounter": self._alive,
            "MotorState": "FAULT" if self.faults.motor_fault else "RUNNING",
            "Loaded": int(self.loaded),
            "Pressure": self._in_unit("Pressure", max(self._pressure(), 0.0)),
            "OilTemperature": self._in_unit("OilTemperature", _OIL_TEMPERATURE_K),
        }
        return bytes(self._status.encode(values, strict=False))

    def _in_unit(self, signal: str, value: float) -> float:
        """Convert a value in SI to the unit that the DBC gives for its signal, and return it."""
        factor, offset = UNITS[self._status.get_signal_by_name(signal).unit]
        return (value - offset) / factor
