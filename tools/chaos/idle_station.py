"""Lets a station stand idle, and tells how memory, descriptors and disk grow in that time.

Run as `python -m tools.chaos.idle_station [--minutes 30] [--hours 8]`. An idle station is bound to
the wall clock, as its devices are, so that its eight hours are not played: the slopes of a shorter
time are measured, and what they come to in `--hours` is reckoned from them and said to be so.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Final

import yaml

from .lab import Lab, lab_in, parts_of, patient
from .signals import end_by_signals
from .slopes import DESCRIPTORS, DISK, MEMORY, RESOURCES, is_leak, slope
from .soak import Series, memory_mb

MINUTES: Final = 30.0
HOURS: Final = 8.0
_SAMPLE_S: Final = 2.0


def idle(lab: Lab, minutes: float) -> Series:
    """Let the lab's station stand idle for so long; return the samples of its processes.

    Raises:
        RuntimeError: the station or one of its parts ended, so that there is no slope of it.
    """
    station = lab.station()
    parts = parts_of(station.pid)
    folder = lab.stage.folder / "runs"
    series: Series = defaultdict(lambda: ([], []))
    began_s = time.monotonic()
    while (now_s := time.monotonic() - began_s) < 60.0 * minutes:
        if station.poll() is not None:
            raise RuntimeError(f"the station ended with exit code {station.returncode}")
        if parts_of(station.pid) != parts:
            raise RuntimeError(f"a part of the station ended: {lab.log[-1]['text']}")
        for part, pid in {"supervisor": station.pid, **parts}.items():
            memory, opened = memory_mb(pid), len(os.listdir(f"/proc/{pid}/fd"))
            for resource, value in ((MEMORY, memory), (DESCRIPTORS, float(opened))):
                times_s, values = series[part, resource.name]
                times_s.append(now_s)
                values.append(value)
        times_s, values = series["folder", DISK.name]
        times_s.append(now_s)
        values.append(1e-6 * sum(map(_size, folder.rglob("*"))))
        time.sleep(_SAMPLE_S)
    return series


def _size(path: Path) -> int:
    """Return a file's size in bytes; 0 of a folder, and of a file that is gone meanwhile."""
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0


def told(series: Series, hours: float) -> tuple[list[str], bool]:
    """Return a line for each series, and whether one of them is a leak.

    A line has the growth per hour, its 95 % interval, and what its upper end comes to in so many
    hours.
    """
    lines, leaks = [], False
    known = {resource.name: resource for resource in RESOURCES}
    for (part, name), (times_s, values) in sorted(series.items()):
        resource, found = known[name], slope(times_s, values)
        leak = is_leak(found, resource)
        leaks = leaks or leak
        lines.append(
            f"{part}: {name} {values[-1]:.3f} {resource.unit}, {found.per_h:+.4f} per hour "
            f"({found.low:+.4f} to {found.high:+.4f}), at most {hours * found.high:+.2f} in "
            f"{hours:g} h{': a LEAK' if leak else ''}"
        )
    return lines, leaks


def main() -> int:
    """Play it; exit code 1 if something leaks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("--hours", type=float, default=HOURS)
    given = parser.parse_args()
    end_by_signals()
    with tempfile.TemporaryDirectory(prefix="rig-idle-") as name, lab_in(Path(name)) as lab:
        # A trip by a machine that is busy would be a step in every series, and no slope.
        file = lab.stage.folder / "rig.yaml"
        file.write_text(yaml.safe_dump(patient(yaml.safe_load(file.read_text()))))
        series = idle(lab, given.minutes)
        kept = lab.log
    lines, leaks = told(series, given.hours)
    print("\n".join(lines))
    print(f"the station's log has {len(kept)} lines; the last: {kept[-1]['text']}")
    return int(leaks)


if __name__ == "__main__":
    sys.exit(main())
