"""Refuses to serve where another emulator on this machine serves already.

A TCP port belongs to one program, and the system refuses a second one. A multicast group and the
link of a serial line do not: two emulators would answer on one bus, and the later one would take
the line away from the earlier one. A lock for each of them refuses the second emulator instead.
"""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rig.io import CanOptions, LockedError, locked

from .addresses import Endpoints


class ServedAlreadyError(ValueError):
    """Raised if another emulator serves a bus or a line; the command line shows `problems`."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


@contextmanager
def sole_use(endpoints: Endpoints) -> Iterator[None]:
    """Keep other emulators, in a `with` block, from the CAN buses and serial lines of this one.

    Raises:
        ServedAlreadyError: another emulator has some of them; the message names each, the process
            that has it, and the remedy. Or a lock cannot be opened.
    """
    problems = []
    with ExitStack() as locks:
        for place, remedy in _places(endpoints).items():
            try:
                locks.enter_context(locked(f"emulated {place}"))
            except LockedError as error:
                owner = f"the emulator of process {error.owner}"
                problems.append(f"{place} is served by {owner} already; end it, or {remedy}")
            except OSError as error:
                problems.append(f"{place}: its lock cannot be opened: {error}; delete that file")
        if problems:
            raise ServedAlreadyError(problems)
        yield


def _places(endpoints: Endpoints) -> dict[str, str]:
    """Return what the remedy is, by the name of each place that only one emulator may serve."""
    remedies = {}
    for driver in (endpoints.drive, endpoints.pump):
        if driver is not None and driver.interface != "virtual":
            place, remedy = _bus(driver)
            remedies[place] = remedy
    for line, key in ((endpoints.meters, "port"), (endpoints.bypass, "device")):
        if isinstance(line, Path):
            remedies[f"the serial line {line.absolute()}"] = (
                f"give another path as `{key}` of its driver in the rig file"
            )
    return remedies


def _bus(options: CanOptions) -> tuple[str, str]:
    """Return the name of a CAN bus, and how the rig file names another one.

    A multicast bus is named by its UDP port alone: Linux passes on what comes to any group that a
    program on this machine has joined, so that two groups at one port are one bus.
    """
    if options.interface == "udp_multicast":
        remedy = "give the drivers of the CAN bus another `port` in the rig file"
        return f"CAN by multicast at the UDP port {options.port}", f"{remedy} (not the group alone)"
    remedy = "give the drivers of the CAN bus another `channel` in the rig file"
    return f"the CAN bus {options.channel}", remedy
