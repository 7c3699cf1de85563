"""Driver of the bypass valves: ball and needle valves over Modbus/TCP or RTU, moves verified."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isnan
from typing import ClassVar, Final, Literal

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from rig.io.driver import DriverError

from .link import BypassLink, Client
from .options import BypassOptions
from .registers import THROTTLE

_PARITY: Final = {"even": "E", "odd": "O", "none": "N"}

_SWITCH_TOLERANCE: Final = 0.0
"""A ball is where its switch says, or it is not."""

_LOOK: Final = "look at the valve, its drive and its feedback"

Clock = Callable[[], int]
"""Returns the present moment in ns, as `time.monotonic_ns`."""


class Travel:
    """The last move of one valve: whether it arrives in time, and stays where it was sent.

    Args:
        allowed_s: time within which feedback must confirm a move.
        tolerance: distance from the target that still counts as there.
        clock: returns the time.
    """

    def __init__(self, allowed_s: float, tolerance: float, clock: Clock) -> None:
        self._allowed_ns = round(allowed_s * 1e9)
        self._tolerance = tolerance
        self._clock = clock
        self._begun_ns = 0
        self._arrived = False
        self.target: float | None = None
        """Where it was sent; None before the first move."""

    def begin(self, target: float) -> None:
        """Note that the valve has just been sent to a position."""
        self.target = target
        self._arrived = False
        self._begun_ns = self._clock()

    def reached(self, position: float) -> bool:
        """Return whether a valve at `position` is where it was sent."""
        return self.target is not None and abs(position - self.target) <= self._tolerance

    def fault(self, position: float) -> str:
        """Return what is wrong with a valve that now stands at `position`; empty if nothing is."""
        if self.target is None:
            return ""
        if self.reached(position):
            self._arrived = True
            return ""
        if self._arrived:
            return f"has left {self.target:g} and stands {shown(position)}"
        elapsed_ns = self._clock() - self._begun_ns
        if elapsed_ns < self._allowed_ns:
            return ""
        return f"stuck {shown(position)} after {elapsed_ns * 1e-9:.1f} s, sent to {self.target:g}"


class BypassValves:
    """The bypass valves of a rig.

    Outputs are `<bypass>_ball`, 0 or 1, and `<bypass>_needle`, 0 to 1; inputs have the same names.
    The return throttle has no ball: 0 of its needle leaves the line free, 1 blocks it.

    Args:
        name: name in the rig file.
        options: its section there.
        clock: returns the time.
        sleep: waits for a time in s, in `safe_state` only.

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
        self._bypass_of = {
            **{f"{bypass}_ball": bypass for bypass in options.bypasses if bypass != THROTTLE},
            **{f"{bypass}_needle": bypass for bypass in options.bypasses},
        }
        self.inputs = self.outputs = tuple(self._bypass_of)
        self._travels: dict[str, Travel] = {}
        self._link: BypassLink | None = None

    def open(self) -> None:
        """Connect, verify the device's identity and arm its watchdog; no valve moves.

        Raises:
            DriverError: nobody answers there, or another device.
        """
        if self._link is None:
            self._connect()

    def read(self) -> Mapping[str, float]:
        """Return every valve's position; a ball under way is at 0.5.

        Raises:
            DriverError: the device is lost, or a valve is not where it was sent.
        """
        positions = self._connected().positions(self._options.bypasses)
        faults = {
            signal: fault
            for signal, travel in self._travels.items()
            if (fault := travel.fault(positions[signal]))
        }
        self._refuse(faults, _LOOK)
        return positions

    def write(self, outputs: Mapping[str, float]) -> None:
        """Send valves to positions; a valve that was sent there before is left alone.

        Raises:
            DriverError: a valve or position that there is not, of which nothing is sent; or the
                device is lost, or refuses.
        """
        for signal, target in outputs.items():
            self._check(signal, target)
        link = self._connected()
        for signal, target in outputs.items():
            if self._travels[signal].target != target:
                self._send(link, signal, target)

    def safe_state(self) -> None:
        """Shut every ball and set the throttle free, by a new connection, until it is confirmed.

        The balls are sent there by the present connection first: the device may still hear what it
        does not answer, and a new connection is of no use until it has answered.

        Raises:
            DriverError: it was not confirmed within the time of a move; names the valves.
        """
        deadline_ns = self._clock() + round(max(self._ball_time, self._needle_time) * 1e9)
        if self._link is not None:
            with suppress(DriverError):
                self._link.shut_balls(self._options.bypasses)
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
        """Close the connection; the device's watchdog, if armed, then shuts the valves."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _connect(self) -> BypassLink:
        options = self._options
        self._link = BypassLink(self.name, self._client(), options.map, options.unit)
        try:
            self._link.set_watchdog(options.watchdog)
        except DriverError:
            self.close()
            raise
        # Where the valves were sent before, by whomever, is not known.
        self._travels = {signal: self._travel(signal) for signal in self.outputs}
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

    def _travel(self, signal: str) -> Travel:
        if signal.endswith("_ball"):
            return Travel(self._ball_time, _SWITCH_TOLERANCE, self._clock)
        return Travel(self._needle_time, self._options.needle_tolerance, self._clock)

    @property
    def _ball_time(self) -> float:
        return self._options.ball_travel + self._options.margin

    @property
    def _needle_time(self) -> float:
        return self._options.needle_travel + self._options.margin

    def _check(self, signal: str, target: float) -> None:
        if signal not in self.outputs:
            action = f"its outputs are {', '.join(self.outputs)}"
            raise DriverError(self.name, "is not an output", action, signal)
        if signal.endswith("_ball") and target not in (0.0, 1.0):
            raise DriverError(self.name, f"{target:g} is neither 0 nor 1", "write 0 or 1", signal)
        if not 0.0 <= target <= 1.0:
            raise DriverError(self.name, f"{target:g} is not 0 to 1", "write 0 to 1", signal)

    def _send(self, link: BypassLink, signal: str, target: float) -> None:
        bypass = self._bypass_of[signal]
        if signal.endswith("_ball"):
            link.set_ball(bypass, opened=target == 1.0)
        else:
            link.set_needle(bypass, target)
        self._travels[signal].begin(target)

    def _make_safe(self) -> None:
        """Send every valve to its safe position, 0, and see whether all are there."""
        link = self._link
        if link is None or link.lost:
            link = self._connect()
        failures = {}
        for signal in self._safe_outputs:
            try:
                self._send(link, signal, 0.0)
            except DriverError as error:
                # The next one may still obey.
                failures[signal] = error.state
        if not failures:
            positions = link.positions(self._options.bypasses)
            for signal in self._safe_outputs:
                if not self._travels[signal].reached(positions[signal]):
                    failures[signal] = f"not shut, stands {shown(positions[signal])}"
        self._refuse(failures, "shut off the supply and " + _LOOK)

    @property
    def _safe_outputs(self) -> list[str]:
        """Outputs that are 0 in the safe state: a needle is nothing behind a shut ball."""
        throttle = f"{THROTTLE}_needle"
        return [signal for signal in self.outputs if signal.endswith("_ball") or signal == throttle]

    def _refuse(self, failures: Mapping[str, str], action: str) -> None:
        if failures:
            states = "; ".join(dict.fromkeys(failures.values()))
            raise DriverError(self.name, states, action, ", ".join(failures))


def shown(position: float) -> str:
    """Say where a valve stands."""
    return "with both switches on" if isnan(position) else f"at {position:.3g}"
