"""Tries one failure after another in the processes of a session on the emulated rig."""

import json
import os
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import yaml

from tools.chaos.judge import driven
from tools.chaos.stage import ROOT, Stage, StageError

from .injection import VARIABLE, Order, Site
from .judging import Ended, problems_of
from .simulated import HOOKS
from .trying import Tried, named, noted, of_address_space, without_aborts

PATIENCE_S: Final = 180.0
"""s: how long a run may take; untroubled it takes 15 s, beside other programs up to a minute."""
COMPILE_S: Final = 900.0
"""s: how long the first run may take, before which the loop may have to be compiled."""
SAFE_S: Final = 30.0
"""s within which the devices must be safe and all processes ended, once `rig run` has: a part that
is told nothing misses the others after 20 s at most (`_PATIENT`)."""
_POLL_S: Final = 0.05
_TEST: Final[dict[str, Any]] = {
    "name": "one",
    "duration": "6 s",
    "settle": "0.2 s",
    "setpoint": {"type": "sine", "mean": "0.3 m", "amplitude": "0.1 m", "frequency": "0.5 Hz"},
    "faults": [
        {"type": "internal_leakage", "at": "1 s", "flow": "0.5 L/min", "pressure": "2.5 MPa"}
    ],
    "expect": "inconclusive",
}
"""A test that is too short for a verdict, but moves the ram, a bypass valve and the pump."""


_PATIENT: Final[dict[str, dict[str, str]]] = {
    "loop": {
        "stale_limit": "3 s", "loop_silence": "4 s", "field_silence": "4 s",
        "supervisor_silence": "10 s", "recorder_silence": "20 s",
    },
    "bypass": {"watchdog": "5 s"},
    "drive": {"silence": "5 s", "watchdog": "5 s"},
    "pump": {"silence": "5 s"},
}  # fmt: skip
"""Time limits of the rig file: some ten times those of the shipped one. What is tried is whether a
failure is met at all; how fast is what `python -m tools.chaos` measures."""


class EmulatedTrials:
    """A folder in which a campaign is run again and again on an emulated rig.

    Args:
        folder: an empty folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number = 0

    def sites(self) -> dict[Site, int]:
        """Return how often a run reaches each site, in all its processes.

        Raises:
            StageError: an untroubled run does not come to its end.
        """
        place, ended, found = self._run(Order(""), COMPILE_S)
        if ended.exit_code or found:
            raise StageError(f"an untroubled run ended with {ended}: {found}")
        return Counter(site for site, _ in noted(place / "notes.jsonl"))

    def tried(self, site: Site, after: int = 0) -> Tried | None:
        """Let a site fail once it was reached `after` times, and return what came of it.

        It is None if the site was not reached as often this time, as threads differ in that.
        """
        place, ended, found = self._run(Order("", site, after))
        if not any(fails for _, fails in noted(place / "notes.jsonl")):
            if after:
                return None
            found.append("it was not reached")
        return self._told(named(site, after), site.kind, site.process, ended, found)

    def with_address_space(self, limit: int) -> Tried:
        """Run with a limit on the address space of each process, in bytes; return what came."""
        _, ended, found = self._run(Order("", None, 0, limit))
        return self._told(of_address_space(limit), "memory", "all", ended, found)

    def _told(self, name: str, group: str, process: str, ended: Ended, found: list[str]) -> Tried:
        told = " / ".join(ended.printed.strip().splitlines()[-4:])
        return Tried(name, group, process, ended.exit_code, None, told, tuple(found), ended.killed)

    def _run(self, order: Order, patience_s: float = PATIENCE_S) -> tuple[Path, Ended, list[str]]:
        self._number += 1
        place = self._folder / str(self._number)
        place.mkdir()
        order = order._replace(notes=str(place / "notes.jsonl"))
        paths = os.pathsep.join((str(HOOKS), str(ROOT)))
        prefix = ("env", f"{VARIABLE}={order.to_json()}", f"PYTHONPATH={paths}")
        found = []
        with Stage(place, prefix, (_TEST,)) as stage:
            _make_patient(place / "rig.yaml")
            stage.start()
            ends = _waited(lambda: stage.run.poll() is not None, patience_s)
            if not _waited(stage.is_safe, SAFE_S):
                found.append("the devices are not safe")
            _waited(lambda: not _living(order.notes), SAFE_S)
            alive = _living(order.notes) if ends else {}
            for pid in _living(order.notes):
                with suppress(ProcessLookupError):
                    os.kill(pid, 9)
            code = stage.run.wait() if ends else None
        printed = stage.printed
        log = stage.out / "session.log"
        # A process whose libraries cannot be loaded can only leave Python's own words in the log.
        if log.exists() and (order.target is None or order.target.in_product):
            printed += log.read_text(errors="replace")
        events = [json.loads(line) for line in stage.record.read_text().splitlines()]
        found += [f"by its own record the {part} is not safe" for part in driven(events)]
        ended = Ended(code, printed, tuple(alive.values()))
        ended = without_aborts(ended) if order.bytes_of_address_space else ended
        return place, ended, found + problems_of(ended, stage.out, {})


def _make_patient(path: Path) -> None:
    """Give a rig file such time limits that a busy machine trips nothing, only what fails does."""
    rig = yaml.safe_load(path.read_text())
    for section, changed in _PATIENT.items():
        known = rig.setdefault("loop", {}) if section == "loop" else rig["drivers"][section]
        known.update(changed)
    path.write_text(yaml.safe_dump(rig))


def _waited(done: Any, patience_s: float) -> bool:
    """Wait until `done()` is true, for `patience_s` seconds at most; return whether it is."""
    until = time.monotonic() + patience_s
    while not done():
        if time.monotonic() > until:
            return False
        time.sleep(_POLL_S)
    return True


def _living(notes: str) -> dict[int, str]:
    """Return the command lines of the processes that have the order with this file of notes."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if notes.encode() in (folder / "environ").read_bytes():
                found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
    return found
