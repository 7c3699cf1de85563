"""Makes faults begin and end: by a script's times, or at once when somebody asks."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

from rig.emulator.plant import Clock
from rig.emulator.record import Record

from .wire_faults import WireFault


class Effects(Protocol):
    """What lets faults act on an emulated rig: `rig.emulator.script.effects.FaultEffects`."""

    def require(self, *faults: Any) -> None:
        """Verify that the rig has what the faults concern.

        Raises:
            ValueError: it has not.
        """

    def apply(self, fault: Any, begins: bool) -> None:
        """Let a fault begin or end."""


@dataclass
class _Injected:
    """One fault on its way: waiting for its time, acting, or over."""

    number: int
    fault: WireFault
    origin_ns: int | None
    acting: bool = False

    @property
    def begin_ns(self) -> float:
        """When the fault begins, ns; inf while the event that it waits for has not happened."""
        return inf if self.origin_ns is None else self.origin_ns + 1e9 * self.fault.at_s

    @property
    def end_ns(self) -> float:
        return self.begin_ns + 1e9 * self.fault.for_s


class Injection:
    """The faults of a run of the emulator.

    Args:
        effects: what makes faults begin and end.
        record: takes note of each.
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
        """Take up the faults of a script, whose times count from now or from the first enable.

        Raises:
            ValueError: some concern what the rig does not have.
        """
        faults = tuple(faults)
        self._effects.require(*(fault.options for fault in faults))
        for fault in faults:
            self._add(fault)

    def inject(self, fault: WireFault) -> int:
        """Take up a fault whose time counts from now; return the number to clear it by.

        Raises:
            ValueError: it concerns what the rig does not have.
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
        """End a fault, acting or waiting, or all of them; return how many there were."""
        chosen = [f for f in self._faults if number is None or f.number == number]
        for injected in chosen:
            self._end(injected)
        return len(chosen)

    def valve_enabled(self) -> None:
        """Let the times begin that count from the first time the valve is enabled."""
        self._enabled = True
        for injected in self._faults:
            if injected.origin_ns is None:
                injected.origin_ns = self._clock()

    def tend(self) -> None:
        """Begin and end what is due."""
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
        """Return the faults that act or wait."""
        return [
            {"number": f.number, "acting": f.acting, **f.fault.described()} for f in self._faults
        ]
