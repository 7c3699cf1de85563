"""The driver of the bypass valves: it moves balls and needles by Modbus, and verifies the moves."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isnan
from typing import ClassVar, Final, Literal

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from rig.channels import BLOCKING
from rig.io.driver import DriverError

from .link import BypassLink, Client
from .options import BypassOptions
from .registers import THROTTLE

_PARITY: Final = {"even": "E", "odd": "O", "none": "N"}

_SWITCH_TOLERANCE: Final = 0.0
"""Tolerance of a ball's position; it is 0, since the switches give that as 0, 0.5 or 1."""

_LOOK: Final = "look at the valve, its drive and its feedback"

_RELIEVE: Final = (
    "a chamber may be locked with its pressure: relieve it by hand before anybody opens a line"
)

BLOCKING_TRAVEL_S: Final = 2.0
"""Time in s that a blocking valve may take; no rig file can give its valves a longer travel."""

Clock = Callable[[], int]
"""Returns the present time in ns, as `time.monotonic_ns` does."""


@dataclass
class Travel:
    """A move of one valve, checked: it must arrive in time, and stay at its target.

    Attributes:
        target: position to which the valve was sent.
        begun_ns: time in ns at which it was sent there.
        allowed_s: time in s within which the feedback must confirm the move.
        tolerance: greatest distance from the target at which the valve counts as arrived.
        arrived: whether the feedback has confirmed the move.
    """

    target: float
    begun_ns: int
    allowed_s: float
    tolerance: float
    arrived: bool = False

    def reached(self, position: float) -> bool:
        """Return whether `position` is the target, within the tolerance."""
        return abs(position - self.target) <= self.tolerance

    def fault(self, position: float, now_ns: int) -> str:
        """Return what is wrong with the valve, which is now at `position`; empty if nothing is.

        Wrong is a valve that has not reached its target in the time allowed, or that has left it
        after an earlier call found it there. A call that finds it there sets `arrived`.
        """
        if self.reached(position):
            self.arrived = True
            return ""
        if self.arrived:
            return f"has left {self.target:g} and stands {shown(position)}"
        elapsed_ns = now_ns - self.begun_ns
        if elapsed_ns < round(self.allowed_s * 1e9):
            return ""
        return f"stuck {shown(position)} after {elapsed_ns * 1e-9:.1f} s, sent to {self.target:g}"


class BypassValves:
    """The driver of the bypass valves of a rig.

    Outputs are `<bypass>_ball`, 0 or 1, and `<bypass>_needle`, 0 to 1; inputs have the same names.
    The return throttle has no ball; at 0 its needle leaves the line free, at 1 it blocks the line.
    With the option `blocking`, the signals of `rig.channels.BLOCKING` are outputs and inputs too, 0
    (open) or 1 (shut). In the safe state the balls are shut, and throttle and blocking valves open.

    Args:
        name: name of the driver in the rig file.
        options: the driver's section there.
        clock: returns the time in ns.
        sleep: waits for a time in s; only `safe_state` uses it.

    Raises:
        DriverError: the options do not fit together.
    """

    kind: ClassVar[Literal["fast", "slow"]] = "slow"
    Options: ClassVar[type] = BypassOptions

    def __init__(
        self,
        name: str,
        options: BypassOptions,
        clock: Clock = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        problems = list(options.problems())
        if problems:
            raise DriverError(name, "; ".join(problems), "correct its section in the rig file")
        self.name = name
        self.rate_hz = options.rate
        self._options = options
        self._clock = clock
        self._sleep = sleep
        balls = [f"{bypass}_ball" for bypass in options.bypasses if bypass != THROTTLE]
        needles = [f"{bypass}_needle" for bypass in options.bypasses]
        blocking = BLOCKING if options.blocking else ()
        self.inputs = self.outputs = (*balls, *needles, *blocking)
        # A needle behind a shut ball does not matter in the safe state.
        self._safe_outputs = [*balls, *(n for n in needles if n.startswith(THROTTLE)), *blocking]
        ball_s = options.ball_travel + options.margin
        needle_s = options.needle_travel + options.margin
        blocking_s = BLOCKING_TRAVEL_S + options.margin if blocking else 0.0
        self._slowest_s = max(ball_s, needle_s, blocking_s)
        self._limits = {
            **dict.fromkeys(balls, (ball_s, _SWITCH_TOLERANCE)),
            **dict.fromkeys(needles, (needle_s, options.needle_tolerance)),
            **dict.fromkeys(blocking, (blocking_s, _SWITCH_TOLERANCE)),
        }
        # The last move of each valve that was sent anywhere over this connection.
        self._travels: dict[str, Travel] = {}
        self._link: BypassLink | None = None

    def open(self) -> None:
        """Connect, verify the device's identity and set its watchdog; no valve moves.

        If the driver is open already, nothing is done.

        Raises:
            DriverError: no device answers there, another one does, or it refuses.
        """
        if self._link is None:
            self._connect()

    def read(self) -> Mapping[str, float]:
        """Return every valve's position by signal; a ball between its ends is at 0.5.

        A ball whose two position switches are both on is NaN.

        Raises:
            DriverError: the driver is not open, the device is lost, a valve that was moved did not
                arrive in time, or one left its target.
        """
        positions = self._positions(self._connected())
        now_ns = self._clock()
        moves = {signal: self._travels.get(signal) for signal in self.outputs}
        faults = {
            signal: fault
            for signal, travel in moves.items()
            if travel and (fault := travel.fault(positions[signal], now_ns))
        }
        self._refuse(faults, _LOOK)
        return positions

    def write(self, outputs: Mapping[str, float]) -> None:
        """Send valves to positions; a valve whose last target is the same gets no command.

        Raises:
            DriverError: there is no such valve or position, and nothing is sent; or the driver is
                not open, or the device is lost, or refuses.
        """
        for signal, target in outputs.items():
            self._check(signal, target)
        link = self._connected()
        for signal, target in outputs.items():
            last = self._travels.get(signal)
            if last is None or last.target != target:
                self._send(link, signal, target)

    def safe_state(self) -> None:
        """Shut every ball, open throttle and blocking valves; return when the device confirms it.

        This uses a new connection, which stays open. Before that, the valves are commanded there
        over the present one: the device may still receive commands there though it does not answer,
        and a new connection is of no use before the device answers.

        Raises:
            DriverError: it was not confirmed within the time that the slowest move may take.
        """
        deadline_ns = self._clock() + round(self._slowest_s * 1e9)
        if self._link is not None:
            with suppress(DriverError):
                self._link.shut_balls(self._options.bypasses)
                if self._options.blocking:
                    self._link.open_blocking()
        self.close()
        while True:
            try:
                self._make_safe()
                return
            except DriverError:
                if self._clock() >= deadline_ns:
                    raise
            self._sleep(1.0 / self.rate_hz)

    def close(self) -> None:
        """Close the connection; the device's watchdog, if it is armed, then shuts the valves."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _connect(self) -> BypassLink:
        options = self._options
        self._link = BypassLink(self.name, self._client(), options.map, options.unit)
        try:
            if options.blocking:
                self._link.check_blocking()
            self._link.set_watchdog(options.watchdog)
        except DriverError:
            self.close()
            raise
        # Targets from before this connection are not known; another program may have set them.
        self._travels = {}
        return self._link

    def _client(self) -> Client:
        options = self._options
        if options.transport == "tcp":
            return ModbusTcpClient(
                options.host, port=options.port, timeout=options.timeout, retries=0
            )
        return ModbusSerialClient(
            options.device,
            baudrate=options.baud,
            parity=_PARITY[options.parity],
            timeout=options.timeout,
            retries=0,
        )

    def _connected(self) -> BypassLink:
        if self._link is None:
            raise DriverError(self.name, "is not open", "open it first")
        return self._link

    def _check(self, signal: str, target: float) -> None:
        if signal not in self.outputs:
            action = f"its outputs are {', '.join(self.outputs)}"
            raise DriverError(self.name, "is not an output", action, signal)
        is_switched = signal.endswith("_ball") or signal in BLOCKING
        if is_switched and target not in (0.0, 1.0):
            raise DriverError(self.name, f"{target:g} is neither 0 nor 1", "write 0 or 1", signal)
        if not 0.0 <= target <= 1.0:
            raise DriverError(self.name, f"{target:g} is not 0 to 1", "write 0 to 1", signal)

    def _positions(self, link: BypassLink) -> dict[str, float]:
        positions = dict(link.positions(self._options.bypasses))
        if self._options.blocking:
            positions |= link.blocking()
        return positions

    def _send(self, link: BypassLink, signal: str, target: float) -> None:
        link.move(signal, target)
        self._travels[signal] = Travel(target, self._clock(), *self._limits[signal])

    def _make_safe(self) -> None:
        """Command every valve of the safe state to 0; raise `DriverError` unless all are there."""
        link = self._link
        if link is None or link.lost:
            link = self._connect()
        failures = {}
        for signal in self._safe_outputs:
            try:
                self._send(link, signal, 0.0)
            except DriverError as error:
                # The other valves may still obey.
                failures[signal] = error.state
        if not failures:
            positions = self._positions(link)
            for signal in self._safe_outputs:
                if not self._travels[signal].reached(positions[signal]):
                    wanted = "open" if signal in BLOCKING else "shut"
                    failures[signal] = f"not {wanted}, stands {shown(positions[signal])}"
        self._refuse(failures, "shut off the supply and " + _LOOK)

    def _refuse(self, failures: Mapping[str, str], action: str) -> None:
        if not failures.keys().isdisjoint(BLOCKING):
            action = f"{action}; {_RELIEVE}"
        if failures:
            states = "; ".join(dict.fromkeys(failures.values()))
            raise DriverError(self.name, states, action, ", ".join(failures))


def shown(position: float) -> str:
    """Return a valve's position in words; NaN is that of a ball whose switches are both on."""
    return "with both switches on" if isnan(position) else f"at {position:.3g}"
