"""A scenario of the chaos suite: what is done to a running rig, and what should follow."""

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
"""Prefix of a command that takes root's privileges from it (real-time priority, locked memory).

It is empty for any other user, who has none of them.
"""


@dataclass(frozen=True)
class Scenario:
    """Something that fails while a test runs, and the claims about what follows.

    Attributes:
        name: what fails, as the table calls it.
        steps: what is done to the rig, in this order.
        causes: possible first-out causes, of which the moment decides; empty if the run goes on to
            its end. The cause "" means that no process is left to state one.
        null_ms: claimed time from the last step until the valve is at null and disabled, ms; None
            if nothing is claimed. It is only printed in the table, because a machine that stalls
            would make a test of it fail.
        exit_code: exit code of `rig run`; minus the signal's number if a signal ends it.
        then: what is done, in this order, once all devices are safe.
        mentions: texts that the trip report must contain.
        unsafe: devices (valve, bypass, pump) that do not become safe, because they fail themselves.
        ordered: whether the devices become safe in the order valve, bypass, pump.
        prefix: prefix of the command that runs the campaign.
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
    """Return a step that starts a fault of the emulator (docs/emulator.md).

    Args:
        fault: name of the fault.
        target: device or signal that has the fault, if the fault needs one.
        options: further fields of the fault; `lasts` stands for the field `for`.
    """
    given = {"fault": fault, **({"target": target} if target else {}), **options}
    if "lasts" in given:
        given["for"] = given.pop("lasts")
    return lambda stage: stage.inject(**given)


def kill(number: signal.Signals, *parts: str) -> Step:
    """Return a step that sends a signal to all processes `parts` (`Stage.send`) without a pause."""
    return lambda stage: stage.send(number, *parts)


def full_disk(*parts: str) -> Step:
    """Return a step after which no file that the processes `parts` write can grow.

    The step lowers their limit on file sizes to 0, so that the system refuses their writes; this
    needs no privilege.
    """
    return lambda stage: stage.limit_files(*parts)


def pause(seconds: float) -> Step:
    """Return a step that waits for a time, s."""
    return lambda stage: time.sleep(seconds)
