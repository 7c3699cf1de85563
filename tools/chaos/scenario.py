"""A scenario of the chaos suite: what is done to a running rig, and what is claimed to follow."""

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from .stage import Stage

Step = Callable[[Stage], None]

UNPRIVILEGED: Final = (
    ("setpriv", "--bounding-set=-all", "--inh-caps=-all") if os.geteuid() == 0 else ()
)
"""Command before another that then lacks what root may do: real-time priority, locked memory."""


@dataclass(frozen=True)
class Scenario:
    """One thing that fails while a test runs, and what is claimed of it.

    Attributes:
        name: what fails, for the table.
        steps: what is done to the rig.
        causes: the first-out cause; several if it depends on the moment which is first; none if the
            run goes on to its end.
        null_ms: how soon after the last step the valve is claimed to be at null and disabled. For
            the table: a machine that stalls is late, and no test shall fail for it.
        exit_code: of `rig run`.
        then: what is done once the rig is safe.
        mentions: what the trip report says besides.
        unsafe: devices that are not seen to become safe: they are what fails.
        ordered: whether the devices become safe in the order of a trip, whoever brings them there.
        prefix: of the command that runs the campaign.
    """

    name: str
    steps: tuple[Step, ...]
    causes: tuple[str, ...] = ()
    null_ms: float | None = None
    exit_code: int = 3
    then: tuple[Step, ...] = ()
    mentions: tuple[str, ...] = ()
    unsafe: tuple[str, ...] = ()
    ordered: bool = True
    prefix: tuple[str, ...] = ()


def wire(fault: str, target: str | None = None, **options: Any) -> Step:
    """Return a step that lets a fault of the emulator begin; see docs/emulator.md."""
    given = {"fault": fault, **({"target": target} if target else {}), **options}
    if "lasts" in given:
        given["for"] = given.pop("lasts")
    return lambda stage: stage.inject(**given)


def kill(number: signal.Signals, *parts: str) -> Step:
    """Return a step that sends a signal to processes, all at the same time."""
    return lambda stage: stage.send(number, *parts)


def full_disk(*parts: str) -> Step:
    """Return a step after which no file of these processes can grow.

    The system refuses their writes as those of a user beyond his quota, which needs no privilege.
    """
    return lambda stage: stage.limit_files(*parts)


def pause(seconds: float) -> Step:
    """Return a step in which nothing is done."""
    return lambda stage: time.sleep(seconds)
