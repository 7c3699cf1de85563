"""The fast driver of an I/O device on Modbus/TCP, with which the loop exchanges samples.

Set-up, diagnosis and nulling use pymodbus, each over a connection of its own. Samples are exchanged
over one more connection, by compiled code (`rig.io.modbus_daq.compiled_exchange`).
"""

import secrets
import socket
import time
from collections.abc import Mapping
from contextlib import closing, suppress
from math import isfinite
from typing import ClassVar, Final, Literal

import numpy as np

from rig.io.driver import DriverError, ExchangeStatus
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS

from .compiled_exchange import Checked, ExchangePlan, Tally, exception_name
from .link import DaqLink, ModbusDaqOptions
from .plan import exchange_plans
from .register_map import ExchangeMode

_EXCHANGES_IN_WATCHDOG: Final = 3
"""Least number of exchanges in the watchdog's time; with fewer, one late reply would trip it."""

_NANOSECONDS: Final = 1e9
_KEYS: Final = 0x7FFF
"""Number of keys by which a device may be owned."""

_STATES: Final = {
    ExchangeStatus.TIMEOUT: "does not reply in time",
    ExchangeStatus.WRONG_REPLY: "replies to something else than what was asked",
    ExchangeStatus.DISCONNECTED: "has closed the connection",
    ExchangeStatus.GARBAGE: "sends what is no Modbus/TCP",
    ExchangeStatus.FOREIGN_WRITE: "was written to by another master, which it refused",
    ExchangeStatus.NOT_OWNER: "is not owned by this program any more",
}


class ModbusDaq:
    """The driver of an I/O device on Modbus/TCP.

    Args:
        name: name of the driver in the rig file.
        options: the driver's section there.

    Raises:
        DriverError: the options do not fit the map.
    """

    kind: ClassVar[Literal["fast", "slow"]] = "fast"
    Options: ClassVar[type] = ModbusDaqOptions

    def __init__(self, name: str, options: ModbusDaqOptions) -> None:
        self.name = name
        self._options, self._map = options, options.map
        self.inputs = tuple(register.signal for register in self._map.read)
        self.outputs = tuple(register.signal for register in self._map.written)
        self.rate_hz = self._map.rate if options.rate is None else options.rate
        self._mode: ExchangeMode = options.exchange or self._map.exchange[0]
        self._check()
        self._socket: socket.socket | None = None
        owns = options.ownership == "required" and self._map.owner is not None
        # A complement of a key is no key, as it has the highest bit set.
        self._key = 1 + secrets.randbelow(_KEYS) if owns else 0
        self._plan, self._look = exchange_plans(self._map, self._mode, options.unit, self._key)
        self._sequence = 0
        self._given = np.zeros(len(FAST_OUTPUTS))
        self._found = np.full(len(FAST_INPUTS), np.nan)

    def open(self) -> None:
        """Connect, verify that the device is that of the map, and set it up; no output changes.

        If the driver is open already, nothing is done.

        Raises:
            DriverError: no device answers, another one does, it is too slow, is owned or driven by
                another master, does not hold the set-up that was written, or takes no second
                connection.
        """
        if self._socket is not None:
            return
        with self._link() as link:
            link.verify(self.rate_hz)
            link.require_no_other_master()
            if self._key:
                link.claim(self._key)
                self._plan.checked[Checked.REFUSED] = 0
            link.set_up()
        # Bytes that are left from an earlier connection do not belong to this one.
        self._plan.tally[Tally.RECEIVED] = 0
        # This call makes numba compile or load the exchange now, not within the first deadline.
        self._plan.exchange(-1, 0, self._given, self._found, 0)
        self._socket = self._connected()

    def fileno(self) -> int:
        """Return the descriptor of the socket for samples, in blocking mode for compiled code.

        Raises:
            DriverError: the device is not open.
        """
        if self._socket is None:
            raise DriverError(self.name, "is not open", "call open() first")
        return self._socket.fileno()

    def plan(self) -> ExchangePlan:
        """Return the plan of the exchange over the socket of `fileno`, the same at every call."""
        return self._plan

    def look_plan(self) -> ExchangePlan:
        """Return the plan of an exchange over the same socket that reads, and writes no output."""
        return self._look

    def read(self) -> Mapping[str, float]:
        """Exchange once with unchanged outputs, and return the inputs by signal, SI.

        Before the first `write`, and after `safe_state`, the outputs that are sent are 0.

        Raises:
            DriverError: the driver is not open, or the device does not reply in time, or refuses.
        """
        self._exchange()
        return {signal: float(self._found[FAST_INPUTS.index(signal)]) for signal in self.inputs}

    def write(self, outputs: Mapping[str, float]) -> None:
        """Exchange once with the given outputs changed and all others unchanged.

        The driver counts `host_counter` up by itself. Nothing is sent if one output is wrong.

        Raises:
            DriverError: the device has no such output, a value is not finite, the driver is not
                open, or the device does not reply in time, or refuses.
        """
        for signal, value in outputs.items():
            if signal not in self.outputs:
                remedy = f"it has {', '.join(self.outputs)}"
                raise DriverError(
                    self.name, f"{self._map.device} has no such output", remedy, signal
                )
            if not isfinite(value):
                raise DriverError(self.name, f"{value} is no value", "write a finite one", signal)
        for signal, value in outputs.items():
            self._given[FAST_OUTPUTS.index(signal)] = value
        self._exchange()

    def safe_state(self) -> None:
        """Bring the valve to null over a new connection, and return when the device reports that.

        A device that has a null request latches it. Any other device is sent 0 V and "valve off" as
        an ordinary command; no exchange may follow then, because it would overwrite that command.

        Raises:
            DriverError: the device cannot be reached, refuses, or did not confirm in time; the
                valve may still be driven.
        """
        self._given[:] = 0.0
        with self._link() as link:
            link.null()

    def driven(self) -> str:
        """Return a text with the first quantity of the valve that is not 0; empty if all are 0.

        Only quantities that the device reports count. They are read over a new connection.

        Raises:
            DriverError: the device does not answer, or refuses.
        """
        with self._link() as link:
            return next(link.driven(), "")

    def diagnostics(self) -> Mapping[str, float]:
        """Return the identity, map version and `facts` of the map by name, over a new connection.

        The numbers are as in the registers, not scaled.

        Raises:
            DriverError: no device answers, another one does, it is too slow, or it refuses.
        """
        with self._link() as link:
            link.verify(self.rate_hz)
            found = {"identity": self._map.identity.value}
            if self._map.version is not None:
                found["map_version"] = self._map.version.value
            return found | {
                fact.name: link.read(fact.address, fact.type) for fact in self._map.facts
            }

    def close(self) -> None:
        """Close the connection and give the device up; repeated calls do no harm.

        A device that does not hear it is free for another owner once its watchdog's time is over.
        """
        if self._socket is not None:
            self._socket.close()
            self._socket = None
            if self._key:
                with suppress(DriverError), self._link() as link:
                    link.release(self._key)

    def _check(self) -> None:
        options, register_map = self._options, self._map
        if self._mode not in register_map.exchange:
            raise self._refused("exchange", self._mode, f"use {' or '.join(register_map.exchange)}")
        if self.rate_hz > register_map.rate:
            raise self._refused("rate", f"{self.rate_hz:g} Hz", f"at most {register_map.rate:g} Hz")
        watchdog = register_map.watchdog
        if watchdog is None:
            if options.watchdog is not None:
                raise self._refused("watchdog", f"{options.watchdog:g} s", "leave it out")
            return
        shortest = max(watchdog.shortest, _EXCHANGES_IN_WATCHDOG / self.rate_hz)
        limits = f"write {shortest:g} to {watchdog.longest:g} s"
        if options.watchdog is None:
            raise DriverError(self.name, "no time is given for its watchdog", limits, "watchdog")
        if not shortest <= options.watchdog <= watchdog.longest:
            raise self._refused("watchdog", f"{options.watchdog:g} s", limits)

    def _refused(self, key: str, value: str, remedy: str) -> DriverError:
        state = f"{value} is not for {self._map.device}"
        return DriverError(self.name, state, remedy, key)

    def _link(self) -> closing[DaqLink]:
        return closing(DaqLink(self.name, self._options))

    def _connected(self) -> socket.socket:
        options = self._options
        try:
            found = socket.create_connection((options.host, options.port), options.timeout)
        except OSError as error:
            state = f"{self._map.device} takes no second connection: {error.strerror or error}"
            raise DriverError(self.name, state, "end other programs that use it") from error
        # Compiled code needs a blocking socket; Python makes one with a timeout non-blocking.
        found.settimeout(None)
        found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return found

    def _exchange(self) -> None:
        fd = self.fileno()
        counter = FAST_OUTPUTS.index("host_counter")
        self._given[counter] = (self._given[counter] + 1) % 0x10000
        self._sequence += 1
        deadline = time.monotonic_ns() + int(self._options.timeout * _NANOSECONDS)
        ended, _ = self._plan.exchange(fd, self._sequence, self._given, self._found, deadline)
        status = ExchangeStatus(ended)
        if status is ExchangeStatus.OK:
            return
        state, remedy = _STATES.get(status, ""), "check power and cable"
        if status is ExchangeStatus.EXCEPTION:
            refusal = exception_name(int(self._plan.tally[Tally.EXCEPTION]))
            state, remedy = f"refuses with {refusal}", "check the map"
        place = f"{self._options.host}:{self._options.port}"
        raise DriverError(self.name, f"{self._map.device} at {place} {state}", remedy)
