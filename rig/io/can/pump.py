"""The driver of a pump unit on CAN, by which it is read, loaded and unloaded.

A DBC file describes the messages.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

from rig.io.driver import DriverError
from rig.plant import PSI, Quantity as _Quantity

from .libraries import cantools
from .link import LOOK, CanLink, CanOptions, Clock

STATUS: Final = (
    "PumpStatus",
    ("Pressure", "OilTemperature", "MotorState", "Loaded", "AliveCounter"),
)
"""Names of the status message and its signals, which the DBC must describe.

Identifier, layout and units are up to the DBC.
"""
COMMAND: Final = ("PumpCommand", ("Load", "AliveCounter"))

UNITS: Final[Mapping[str, tuple[float, float]]] = {
    "Pa": (1.0, 0.0),
    "kPa": (1e3, 0.0),
    "bar": (1e5, 0.0),
    "MPa": (1e6, 0.0),
    "psi": (PSI, 0.0),
    "K": (1.0, 0.0),
    "degC": (1.0, 273.15),
}
"""Factor and offset that convert a value in each unit that a DBC may give to SI."""

_IN_SI: Final = {"Pressure": "pump_pressure_Pa", "OilTemperature": "oil_temperature_K"}
_FAULT: Final = "FAULT"
_LOADED: Final = "pump_loaded"


@dataclass(frozen=True, kw_only=True)
class CanPumpOptions(CanOptions):
    """Keys of the driver in a rig file, besides those of its bus.

    Attributes:
        dbc: DBC file that describes the unit's messages; the shipped one is `pump_unit`.
        load_timeout: how long the unit may take to load or unload.
    """

    dbc: Path
    load_timeout: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 2.0


class CanPump:
    """The driver of a pump unit with an unloading valve.

    Its output is `pump_load`, 0 or 1, which is sent at every `read` from the first `write` on. Its
    inputs are `pump_pressure_Pa`, `oil_temperature_K` and `pump_loaded`.

    Args:
        name: name of the driver in the rig file.
        options: the driver's section there.
        clock: returns the time in s.

    Raises:
        DriverError: the DBC cannot be read, or does not describe a pump unit.
    """

    kind: ClassVar[Literal["fast", "slow"]] = "slow"
    Options: ClassVar[type] = CanPumpOptions

    inputs: tuple[str, ...] = ("pump_pressure_Pa", "oil_temperature_K", "pump_loaded")
    outputs: tuple[str, ...] = ("pump_load",)

    def __init__(self, name: str, options: CanPumpOptions, clock: Clock = time.monotonic) -> None:
        self.name = name
        self.rate_hz = options.rate
        self._options = options
        self._clock = clock
        database = self._database()
        self._status = self._message(database, *STATUS)
        self._command = self._message(database, *COMMAND)
        self._to_si = {signal: self._unit(signal) for signal in _IN_SI}
        self._motor_fault = self._motor_fault_code()
        self._link: CanLink | None = None
        self._load: bool | None = None
        self._load_until = 0.0
        self._sent = 0
        self._values: dict[str, float] = {}
        self._motor = -1
        self._loaded: bool | None = None
        self._alive = -1
        self._alive_at = clock()
        self._fresh = False

    def _database(self) -> cantools.database.Database:
        try:
            database = cantools.database.load_file(self._options.dbc)
        except (OSError, ValueError, cantools.Error) as error:
            state = f"{self._options.dbc} cannot be read: {error}"
            raise self._error(state, "give a DBC file", "dbc") from error
        assert isinstance(database, cantools.database.Database)
        return database

    def _message(
        self, database: cantools.database.Database, name: str, signals: tuple[str, ...]
    ) -> cantools.database.Message:
        found = {message.name: message for message in database.messages}
        lacking = [name]
        if name in found:
            there = {signal.name for signal in found[name].signals}
            lacking = [f"{name}.{signal}" for signal in signals if signal not in there]
        if lacking:
            state = f"{self._options.dbc} lacks {', '.join(lacking)}"
            raise self._error(state, "name its messages as docs/can.md says", "dbc")
        return found[name]

    def _unit(self, signal: str) -> tuple[float, float]:
        unit = self._status.get_signal_by_name(signal).unit or ""
        if unit not in UNITS:
            state = f"{self._options.dbc} gives {signal} in {unit or 'no unit'}"
            raise self._error(state, f"use one of {', '.join(UNITS)}", "dbc")
        return UNITS[unit]

    def _motor_fault_code(self) -> int:
        try:
            return self._status.get_signal_by_name("MotorState").choice_to_number(_FAULT)
        except KeyError:
            state = f"{self._options.dbc} has no value {_FAULT} of MotorState"
            raise self._error(state, "add it with VAL_", "dbc") from None

    def _error(self, state: str, action: str, channel: str = "") -> DriverError:
        """Return an error of this driver.

        The channel is `_LOADED` if the unit is connected, but has a fault or does not obey.
        """
        return DriverError(self.name, state, action, channel)

    def _connected(self) -> CanLink:
        if self._link is None:
            raise self._error("is not open", "open it first")
        return self._link

    def open(self) -> None:
        """Open the bus and wait for the unit's status message; nothing is commanded.

        If the driver is open already, nothing is done.

        Raises:
            DriverError: the bus cannot be opened, or no status message comes within `silence`, or
                1 s if that is longer.
        """
        if self._link is not None:
            return
        link = self._connect()
        until = self._clock() + max(1.0, self._options.silence)
        while not self._fresh:
            if self._clock() >= until:
                self.close()
                state = f"no {self._status.name} on {self._options.bus}"
                raise self._error(state, "check power, bitrate, termination and the DBC")
            self._listen(link, LOOK)

    def _connect(self) -> CanLink:
        self._fresh = False
        self._link = CanLink(
            self.name,
            self._options,
            (self._status.frame_id,),
            extended=self._status.is_extended_frame,
        )
        return self._link

    def read(self) -> Mapping[str, float]:
        """Send the command, and return the values that came since the last call, by signal, SI.

        Nothing is sent before the first `write`. To load is not sent either if the process was
        stopped during this call; see `_send`. The result is empty if no new status came.

        Raises:
            DriverError: the driver is not open, or the unit is lost or frozen, reports a fault, or
                does not do what was asked in `load_timeout`.
        """
        link = self._connected()
        began = self._clock()
        self._listen(link)
        self._send(link, began)
        self._require_alive()
        self._require_obeying()
        if not self._fresh:
            return {}
        self._fresh = False
        return {**self._values, "pump_loaded": float(bool(self._loaded))}

    def _listen(self, link: CanLink, wait: float = 0.0) -> None:
        for frame in link.receive(wait):
            self._take(bytes(frame.data))

    def _take(self, data: bytes) -> None:
        """Handle one status message; drop one of another length, or with an old alive counter."""
        if len(data) != self._status.length:
            return
        signals: Any = self._status.decode(data, decode_choices=False)
        alive = int(signals["AliveCounter"])
        if alive == self._alive:
            return
        self._alive, self._alive_at, self._fresh = alive, self._clock(), True
        self._motor, self._loaded = int(signals["MotorState"]), bool(signals["Loaded"])
        for signal, (factor, offset) in self._to_si.items():
            self._values[_IN_SI[signal]] = float(signals[signal]) * factor + offset

    def _require_alive(self) -> None:
        silent = self._clock() - self._alive_at
        if silent > self._options.silence:
            state = f"alive counter stands at {self._alive} for {silent:.2f} s: lost or frozen"
            raise self._error(state, "check the unit's power and cable")
        if self._motor == self._motor_fault:
            action = "look at the unit's motor starter"
            raise self._error("its motor reports a fault", action, _LOADED)

    def _require_obeying(self) -> None:
        if self._load is None or self._loaded == self._load or self._clock() < self._load_until:
            return
        asked, stands = ("loaded" if load else "unloaded" for load in (self._load, self._loaded))
        state = f"is {stands}, {asked} wanted for {self._options.load_timeout:g} s"
        raise self._error(state, "look at the unit's unloading valve", _LOADED)

    def write(self, outputs: Mapping[str, float]) -> None:
        """Command the unit to load or unload the pump; later calls of `read` check that it does.

        Raises:
            DriverError: there is no such output or value, the driver is not open, or the bus is
                lost.
        """
        link = self._connected()
        began = self._clock()
        for name, value in outputs.items():
            if name not in self.outputs:
                raise self._error("is not an output", "write pump_load", name)
            if value not in (0.0, 1.0):
                raise self._error(f"{value:g} is not 0 or 1", "give 0 or 1", name)
            self._ask(bool(value))
        self._send(link, began)

    def _ask(self, load: bool) -> None:
        self._load = load
        self._load_until = self._clock() + self._options.load_timeout

    def _send(self, link: CanLink, began: float) -> None:
        """Send the command, but not the one to load if the caller's turn has become too old.

        The caller looks for a trip before each turn. A turn takes milliseconds, so one that is
        older than the driver's period was stopped in between, and a trip may have unloaded the pump
        meanwhile. The next turn, before which the caller looks again, sends the command; the unit
        does without one command, as without one that is lost on the bus.

        Args:
            link: the bus.
            began: time in s at which the turn began, by the driver's clock.
        """
        if self._load is None:
            return
        data = self._encoded(self._load)

        def in_time() -> bool:
            return not self._load or self._clock() - began <= 1.0 / self.rate_hz

        extended = self._command.is_extended_frame
        link.send(self._command.frame_id, data, extended=extended, wanted=in_time)

    def _encoded(self, load: bool) -> bytes:
        self._sent = (self._sent + 1) % 16
        signals = {"Load": int(load), "AliveCounter": self._sent}
        filled = {signal.name: 0 for signal in self._command.signals} | signals
        return self._command.encode(filled, strict=False)

    def safe_state(self) -> None:
        """Unload the pump over a new connection, and wait until the unit confirms it.

        Raises:
            DriverError: the unit has not confirmed in `load_timeout`, or the bus cannot be opened.
        """
        self._ask(False)
        was_open = self._link is not None
        self.close()
        link = self._connect()
        try:
            while self._loaded or not self._fresh:
                if self._clock() >= self._load_until:
                    state = f"unloading not confirmed in {self._options.load_timeout:g} s"
                    raise self._error(state, "switch the unit's motor off", _LOADED)
                self._send(link, self._clock())
                self._listen(link, LOOK)
        finally:
            if not was_open:
                self.close()

    def close(self) -> None:
        """Close the bus; the unit unloads by itself when no command comes any more."""
        if self._link is not None:
            self._link.close()
        self._link = None
