"""Makes faults begin and end, by the times of a script or on request."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rig.emulator.plant import Clock
from rig.emulator.record import Record

from .wire_faults import WireFault

if TYPE_CHECKING:
    from rig.emulator.application import Emulator


class NotServedError(ValueError):
    """Raised for faults of parts that the emulated rig lacks; `problems` names them."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


@dataclass
class _Injected:
    """One fault that waits for its time or acts.

    Its times count from `origin_ns`, which is None while it waits for the valve's first enabling.
    """

    number: int
    fault: WireFault
    origin_ns: int | None
    acting: bool = False


class Injection:
    """The faults of a run of the emulator.

    Args:
        emulator: the emulated rig, on whose parts the faults act.
        record: takes note when a fault begins and ends.
        clock: returns the time in ns.
    """

    def __init__(self, emulator: "Emulator", record: Record, clock: Clock) -> None:
        self._emulator = emulator
        self._record = record
        self._clock = clock
        self._enabled = False
        self._faults: list[_Injected] = []
        self._numbers = 0

    def script(self, faults: Iterable[WireFault]) -> None:
        """Add a script's faults; none is added if an error is raised.

        The times of a fault count from now or, if its `after` is "enable" and the valve has not
        been enabled yet, from the valve's first enabling.

        Raises:
            NotServedError: some faults concern parts that the rig lacks.
        """
        faults = tuple(faults)
        problems = [fault.options.lacking(self._emulator) for fault in faults]
        if any(problems):
            raise NotServedError(filter(None, problems))
        for fault in faults:
            waits = fault.after == "enable" and not self._enabled
            self._numbers += 1
            self._faults.append(_Injected(self._numbers, fault, None if waits else self._clock()))

    def inject(self, fault: WireFault) -> int:
        """Add a fault; return the number by which to clear it.

        Its times count from now or, if its `after` is "enable" and the valve has not been enabled
        yet, from the valve's first enabling. A fault that is due begins at once.

        Raises:
            NotServedError: the fault concerns a part that the rig lacks.
        """
        self.script([fault])
        self.tend()
        return self._numbers

    def clear(self, number: int | None = None) -> int:
        """End the fault with this number, or all faults if it is None; return how many there were.

        Faults that wait for their time are removed too.
        """
        chosen = [f for f in self._faults if number is None or f.number == number]
        for injected in chosen:
            self._end(injected)
        return len(chosen)

    def valve_enabled(self) -> None:
        """Take note that the valve is enabled: times that count from its first enabling start now.

        Every call but the first does nothing.
        """
        self._enabled = True
        for injected in self._faults:
            if injected.origin_ns is None:
                injected.origin_ns = self._clock()

    def tend(self) -> None:
        """Begin and end the faults that are due; one that has ended is forgotten."""
        now = self._clock()
        for injected in tuple(self._faults):
            if injected.origin_ns is None:
                continue
            begin_ns = injected.origin_ns + 1e9 * injected.fault.at_s
            if not injected.acting and begin_ns <= now:
                injected.acting = True
                self._note("fault_begins", injected)
                injected.fault.options.act(self._emulator, True)
            if injected.acting and begin_ns + 1e9 * injected.fault.for_s <= now:
                self._end(injected)

    def _end(self, injected: _Injected) -> None:
        self._faults.remove(injected)
        if injected.acting:
            injected.fault.options.act(self._emulator, False)
            self._note("fault_ends", injected)

    def _note(self, event: str, injected: _Injected) -> None:
        self._record.note(event, number=injected.number, **injected.fault.described())

    def state(self) -> list[dict[str, Any]]:
        """Return the faults that act or wait, as JSON values."""
        return [
            {"number": f.number, "acting": f.acting, **f.fault.described()} for f in self._faults
        ]
