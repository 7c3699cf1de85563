"""A fault that the grammar draws, a case of two of them, and which promises hold for the case."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from tools.chaos.scenario import Step

from .bounds import ORDINARY

DEVICES: Final = ("valve", "bypass", "pump")


@dataclass(frozen=True)
class Fault:
    """Something that fails, and what may follow of it.

    Attributes:
        name: what fails.
        steps: what is done to the rig, in this order.
        causes: possible first-out causes, or reasons why the run was stopped.
        null_ms: claimed time from the strike until the valve is at null and disabled, ms. None if
            the fault need not end the motion.
        exits: exit codes that the run may have because of it.
        needs: what detects it and brings the valve to null: parts of the session, and `daq` for the
            way to the I/O node. Empty where the device does it by itself.
        takes: what is lost by it, of the same, and the slow devices `bypass`, `drive` and `pump`.
        lasts_ms: after which time what it takes is there again, ms; None if it is lost for good, or
            for longer than a promise.
        spoils: devices that cannot become safe.
        stops: parts that it leaves stopped (SIGSTOP).
        at_emulator: whether striking it needs an emulator that answers.
        is_sensor: whether a transducer is wrong, so that checks of several may find it.
        keeps_results: whether the run's results can be written.
        keeps_folder: whether the run's folder stays where it is.
    """

    name: str
    steps: tuple[Step, ...]
    causes: tuple[str, ...] = ()
    null_ms: float | None = None
    exits: frozenset[int] = frozenset({0, 1})
    needs: frozenset[str] = frozenset()
    takes: frozenset[str] = frozenset()
    lasts_ms: float | None = None
    spoils: frozenset[str] = frozenset()
    stops: tuple[str, ...] = ()
    at_emulator: bool = True
    is_sensor: bool = False
    keeps_results: bool = True
    keeps_folder: bool = True


@dataclass(frozen=True)
class Strike:
    """A fault of a case, and when it strikes: s after the first leak of the test has opened."""

    at_s: float
    fault: Fault


@dataclass(frozen=True)
class Case:
    """A case: a number, and its two strikes in order of time.

    Attributes:
        seed, number: what it was drawn from.
        strikes: the faults with their moments.
        with_plots: whether the run makes its whole report, with plots.
    """

    seed: int
    number: int
    strikes: tuple[Strike, Strike]
    with_plots: bool = False

    @property
    def name(self) -> str:
        """What fails and when, in words."""
        return "; then ".join(f"at {each.at_s:.3f} s {each.fault.name}" for each in self.strikes)


@dataclass(frozen=True)
class Struck:
    """A fault that was struck: when its last step began and ended, CLOCK_MONOTONIC in ns."""

    fault: Fault
    at_ns: int
    done_ns: int

    @property
    def back_ns(self) -> int | None:
        """When what the fault takes is there again, ns; None if it does not come back in time."""
        lasts_ms = self.fault.lasts_ms
        return None if lasts_ms is None else self.done_ns + round(1e6 * lasts_ms)


def null_deadlines(struck: Iterable[Struck]) -> Iterator[tuple[str, int]]:
    """Yield for each promise of a valve at null that holds (its fault, until when in ns).

    A promise holds unless the other fault takes a part that it needs before its time is over: then
    the promise of losing that part holds instead, or, if the part comes back, the time begins anew
    when it is there again. A part that is lost needs other parts than itself to be missed, so that
    one promise is left.
    """
    known = list(struck)
    for each in known:
        if each.fault.null_ms is None:
            continue
        slack_ms = ORDINARY.ms if each.fault.needs & {"supervisor", "field"} else 0.0
        allowed_ns = round(1e6 * (each.fault.null_ms + slack_ms))
        until_ns = each.at_ns + allowed_ns
        others = [
            other
            for other in known
            if other is not each
            and other.at_ns <= until_ns
            and other.fault.takes & each.fault.needs
        ]
        backs = [other.back_ns for other in others]
        if all(back is not None for back in backs):
            again_ns = [back + allowed_ns for back in backs if back is not None]
            yield each.fault.name, max([until_ns, *again_ns])
