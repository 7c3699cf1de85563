"""Makes faults begin and end, by the times of a script or on request."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

from rig.emulator.plant import Clock
from rig.emulator.record import Record

from .wire_faults import WireFault


class Effects(Protocol):
    """What makes faults act on an emulated rig: `rig.emulator.script.effects.FaultEffects`."""

    def require(self, *faults: Any) -> None:
        """Check that the rig has the parts that the faults concern.

        Raises:
            ValueError: the rig lacks one.
        """

    def apply(self, fault: Any, begins: bool) -> None:
        """Make a fault begin or, if not `begins`, end."""


@dataclass
class _Injected:
    """One fault that waits for its time or acts."""

    number: int
    fault: WireFault
    origin_ns: int | None
    acting: bool = False

    @property
    def begin_ns(self) -> float:
        """Time in ns at which the fault begins; inf while it waits for the valve's enabling."""
        return inf if self.origin_ns is None else self.origin_ns + 1e9 * self.fault.at_s

    @property
    def end_ns(self) -> float:
        return self.begin_ns + 1e9 * self.fault.for_s


class Injection:
    """The faults of a run of the emulator.

    Args:
        effects: makes faults begin and end.
        record: takes note when a fault begins and ends.
        clock: returns the time in ns.
    """

    def __init__(self, effects: Effects, record: Record, clock: Clock) -> None:
        self._effects = effects
        self._record = record
        self._clock = clock
        self._enabled = False
        self._faults: list[_Injected] = []
        self._numbers = 0

    def script(self, faults: Iterable[WireFault]) -> None:
        """Add a script's faults, whose times count from now or from the valve's first enabling.

        None is added if an error is raised.

        Raises:
            ValueError: some faults concern parts that the rig lacks.
        """
        faults = tuple(faults)
        self._effects.require(*(fault.options for fault in faults))
        for fault in faults:
            self._add(fault)

    def inject(self, fault: WireFault) -> int:
        """Add a fault, whose time counts as in a script; return the number by which to clear it.

        Raises:
            ValueError: the fault concerns a part that the rig lacks.
        """
        self._effects.require(fault.options)
        number = self._add(fault)
        self.tend()
        return number

    def _add(self, fault: WireFault) -> int:
        waits = fault.after == "enable" and not self._enabled
        self._numbers += 1
        self._faults.append(_Injected(self._numbers, fault, None if waits else self._clock()))
        return self._numbers

    def clear(self, number: int | None = None) -> int:
        """End the fault of a number, whether it acts or waits, or all; return how many ended."""
        chosen = [f for f in self._faults if number is None or f.number == number]
        for injected in chosen:
            self._end(injected)
        return len(chosen)

    def valve_enabled(self) -> None:
        """Start the times of faults that wait for the first time that the valve is enabled."""
        self._enabled = True
        for injected in self._faults:
            if injected.origin_ns is None:
                injected.origin_ns = self._clock()

    def tend(self) -> None:
        """Begin and end the faults that are due; one that has ended is forgotten."""
        now = self._clock()
        for injected in tuple(self._faults):
            if not injected.acting and injected.begin_ns <= now:
                injected.acting = True
                self._note("fault_begins", injected)
                self._effects.apply(injected.fault.options, True)
            if injected.acting and injected.end_ns <= now:
                self._end(injected)

    def _end(self, injected: _Injected) -> None:
        self._faults.remove(injected)
        if injected.acting:
            self._effects.apply(injected.fault.options, False)
            self._note("fault_ends", injected)

    def _note(self, event: str, injected: _Injected) -> None:
        self._record.note(event, number=injected.number, **injected.fault.described())

    def state(self) -> list[dict[str, Any]]:
        """Return the faults that act or wait, as JSON values."""
        return [
            {"number": f.number, "acting": f.acting, **f.fault.described()} for f in self._faults
        ]
