"""Runs long campaigns and tells how memory, descriptors and disk of each process grow: `make soak`.

Run as `python -m tools.chaos.soak [--wire MINUTES] [--simulated HOURS]`. It runs on the emulated
rig for 30 minutes, and on the simulated one, at the fast clock, for 24 h of its time, unless other
times are given; 0 leaves one out. It is called a leak if the whole interval of a slope lies above
the bound in `slopes.py`, also of a run that ended early. If both ran for their full time without a
leak, the table of docs/safety.md is written.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from math import ceil
from pathlib import Path
from typing import Any, Final

import yaml

from rig.runner.run_folder import MOST_HELD
from tools.pages.marked_tables import fill, markdown
from tools.pages.safety import PAGE

from .lab import patient
from .signals import end_by_signals
from .slopes import DESCRIPTORS, DISK, MEMORY, RESOURCES, Resource, is_leak, slope
from .stage import COMPILE_S, FIRST_FAULT, TEST, Stage

WIRE_MIN: Final = 30.0
SIMULATED_H: Final = 24.0
_SAMPLE_S: Final = 1.0
_WIRE_TEST_S: Final = 60.0
"""Duration of a test on the wire, s: what a test leaves behind shows after a few of them."""
_SIMULATED_TEST_S: Final = 600.0
_KEPT: Final = 2
"""Number of the newest recordings that stay on the disk; a day of them would take 30 GB."""
_HEAD: Final = (
    "rig, process",
    "what",
    "growth per hour",
    "95 % interval",
    "a leak above",
    "judged",
)

Series = dict[tuple[str, str], tuple[list[float], list[float]]]
"""(process, resource) -> times in s and values."""


def planned_tests(count: int, duration_s: float) -> Iterator[dict[str, Any]]:
    """Yield so many tests, each with a leak that comes and goes in its first half."""
    fault = FIRST_FAULT | {"at": f"{0.1 * duration_s:g} s", "until": f"{0.5 * duration_s:g} s"}
    for number in range(count):
        yield {
            "name": f"soak {number + 1}",
            "duration": f"{duration_s:g} s",
            "settle": "0.5 s",
            "setpoint": TEST["setpoint"],
            "faults": [fault],
        }


def soak(folder: Path, *, emulated: bool, hours: float) -> tuple[Series, float, str]:
    """Run tests of so many hours of rig time.

    Returns:
        the samples; the duration, s; and what the run printed last if it ended early, as after a
        trip on a busy machine, else "".

    Raises:
        StageError: the run did not begin.
    """
    duration_s = _WIRE_TEST_S if emulated else _SIMULATED_TEST_S
    planned = tuple(planned_tests(ceil(3600.0 * hours / duration_s), duration_s))
    series: Series = defaultdict(lambda: ([], []))
    with Stage(folder, tests=planned, emulated=emulated, plain_report=True) as stage:
        if emulated:
            file = folder / "rig.yaml"
            file.write_text(yaml.safe_dump(patient(yaml.safe_load(file.read_text()))))
            stage.begin()
        else:
            stage.start("--pace", "fast")
            stage.wait(lambda: list(stage.out.glob("*.mcap")) != [], "the first test", COMPILE_S)
        began_s = time.monotonic()
        while stage.run.poll() is None:
            now_s = time.monotonic() - began_s
            if len(stage.living()) <= len(stage.children):
                # One of its processes has ended, so that the others give back what they have.
                time.sleep(_SAMPLE_S)
                continue
            for process, resource, value in _looked_at(stage, emulated=emulated):
                at_s, values = series[process, resource.name]
                at_s.append(now_s)
                values.append(value)
            _thin_out(stage.out)
            time.sleep(_SAMPLE_S)
        code = stage.run.returncode
        cut = "" if code in (0, 1) else f"exit code {code}: {stage.printed[-2000:]}"
    return series, time.monotonic() - began_s, cut


def _looked_at(stage: Stage, *, emulated: bool) -> Iterator[tuple[str, Resource, float]]:
    parts = (*stage.children, "supervisor", *(("emulator",) if emulated else ()))
    for part in parts:
        try:
            pid = stage.pid(part)
            yield part, MEMORY, memory_mb(pid)
            yield part, DESCRIPTORS, float(unbounded_descriptors(pid, stage.out))
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            # It ends, and has neither memory nor descriptors any more.
            continue
    yield "folder", DISK, _disk_mb(stage.out)


def unbounded_descriptors(pid: int, run: Path) -> int:
    """Return the number of a process's descriptors that nothing bounds.

    A run holds each of its files open on purpose, once, up to `MOST_HELD` of them: these are not
    counted. A second descriptor of the same file is.

    Raises:
        FileNotFoundError: there is no such process, or it has ended.
    """
    entries = list(Path(f"/proc/{pid}/fd").iterdir())
    held = set()
    for entry in entries:
        with suppress(FileNotFoundError):
            if os.readlink(entry).startswith(f"{run}/"):
                held.add(entry.stat().st_ino)
    return len(entries) - min(len(held), MOST_HELD)


def memory_mb(pid: int) -> float:
    """Return the memory, MB, that a process has for itself: pages that belong to no file.

    Raises:
        FileNotFoundError: there is no such process, or it has ended.
    """
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return 1024e-6 * float(line.split()[1])
    raise FileNotFoundError(f"process {pid} has ended")


def _disk_mb(folder: Path) -> float:
    sizes = [path.stat().st_size for path in folder.iterdir() if path.suffix != ".mcap"]
    return 1e-6 * sum(sizes)


def _thin_out(folder: Path) -> None:
    """Remove all recordings but the newest ones; the run reads none of the others again."""
    recordings = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime)
    for path in recordings[:-_KEPT]:
        path.unlink()


def rows(rig: str, series: Series) -> Iterator[tuple[tuple[str, ...], bool]]:
    """Yield the table's row for each series, and whether it is a leak."""
    known = {resource.name: resource for resource in RESOURCES}
    for (process, name), (times_s, values) in sorted(series.items()):
        resource = known[name]
        try:
            found = slope(times_s, values)
        except ValueError as error:
            yield (f"{rig}: {process}", name, "", "", f"{resource.bound:.1f}", str(error)), False
            continue
        leaks = is_leak(found, resource)
        yield (
            (
                f"{rig}: {process}", name, f"{found.per_h:+.2f} {resource.unit}".strip(),
                f"{found.low:+.2f} to {found.high:+.2f}", f"{resource.bound:.1f}",
                "**leak**" if leaks else "none",
            ),
            leaks,
        )  # fmt: skip


def main() -> int:
    """Soak both rigs; return the number of leaks and of runs that ended early."""
    parser = argparse.ArgumentParser(prog="python -m tools.chaos.soak", description=__doc__)
    wire = "minutes on the emulated rig (default: %(default)g)"
    simulated = "hours of rig time on the simulated rig (default: %(default)g)"
    parser.add_argument("--wire", type=float, default=WIRE_MIN, help=wire)
    parser.add_argument("--simulated", type=float, default=SIMULATED_H, help=simulated)
    given = parser.parse_args()
    end_by_signals()
    table, leaks, early = [], 0, 0
    for rig, hours in (("emulated", given.wire / 60.0), ("simulated", given.simulated)):
        if hours <= 0.0:
            continue
        print(f"{rig}: {hours:g} h of rig time ...", flush=True)
        with tempfile.TemporaryDirectory(prefix="rig-soak-") as folder:
            series, took_s, cut = soak(Path(folder), emulated=rig == "emulated", hours=hours)
        print(f"{rig}: took {took_s / 60.0:.1f} min", flush=True)
        if cut:
            print(f"{rig}: ended early, with {cut}", flush=True)
            early += 1
        found = list(rows(rig, series))
        print(markdown(_HEAD, (row for row, _ in found)), flush=True)
        table += [row for row, _ in found]
        leaks += sum(leaking for _, leaking in found)
    print(f"{leaks} leaks")
    if not leaks and not early and given.wire >= WIRE_MIN and given.simulated >= SIMULATED_H:
        fill(PAGE, {"soak": markdown(_HEAD, table)})
    return leaks + early


if __name__ == "__main__":
    sys.exit(main())
