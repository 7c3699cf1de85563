"""Calibration files hold needle valves as `rig calibrate valves` measured them, for rig files.

Those of transducers are another kind of file (`transducers.py`).
"""

import datetime
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from faults import NeedleCalibration
from rig.configuration.reading import Located, Schema, display_path, read_mapping
from rig.recording import replace_text

_UNIT: Final = "m^3/(s Pa^0.5)"


class CalibrationFile(Schema):
    """Keys of a calibration file."""

    rig: str
    date: datetime.date
    needles: Any


class NeedleReference(Schema):
    """Keys of a needle whose points are in a calibration file."""

    calibration: str


_HINTS: Final = dict.fromkeys(
    ("channel", "transducer", "points"),
    "a calibration of a transducer belongs in the rig file's list `calibrations`",
)


def find_needle(kind: str, item: Located) -> Located | None:
    """Return the entry of a bypass's needle in the calibration file that a rig file names.

    If the file cannot be used or has no such needle, add a problem and return None. `kind` is the
    fault that the bypass makes; `item` is the mapping in the rig file that names the calibration
    file, whose path is relative to the folder of the rig file.
    """
    reference = read_mapping(NeedleReference, item)
    if reference is None:
        return None
    named = item.find("calibration")
    path = named.path_to(reference.calibration).resolve()
    root = item.sources.read_yaml(path, named)
    if root is None or read_mapping(CalibrationFile, root, _HINTS) is None:
        return None
    needles = root.find("needles")
    needle = needles.get(kind)
    if needle is None:
        there = ", ".join(name for name, _ in needles.items()) or "none"
        remedy = f"needles there: {there}; measure it by `rig calibrate valves --valve {kind}`"
        named.refuse(f"has no needle of {kind}", remedy, display_path(path))
    return needle


def dump_calibration(
    path: Path, rig: str, date: datetime.date, needles: Mapping[str, NeedleCalibration]
) -> None:
    """Write a calibration file, for rig files to name; on an error, an older file stays as it is.

    Args:
        path: path of the file.
        rig: name of the rig.
        date: day of the calibration.
        needles: fault -> calibrated needle of the bypass that makes this fault.

    Raises:
        OSError: the file cannot be written.
    """
    lines = [
        "# Needle valves as `rig calibrate valves` measured them. In a rig file, of each bypass:",
        f"# `needle: {{calibration: {path.name}}}`; the path counts from the rig file's folder.",
        f"rig: {json.dumps(rig)}",
        f"date: {date.isoformat()}",
        "needles:",
    ]
    for kind, calibration in needles.items():
        lines += [f"  {kind}:", *(f"    {line}" for line in _needle(calibration))]
    replace_text(path, "\n".join(lines) + "\n")


def _needle(calibration: NeedleCalibration) -> Iterator[str]:
    needle = calibration.needle
    yield f"id: {json.dumps(needle.id)}"
    if needle.date is not None:
        yield f"date: {needle.date.isoformat()}"
    yield "points:  # of the needle alone; +- one standard error; by how much more on the way up"
    table = dict(zip(needle.openings, needle.coefficients, strict=True))
    for point in calibration.points:
        comment = f"+- {point.coefficient.standard_error:.1e}, {point.hysteresis:+.1e}"
        if not point.coefficient.is_resolved:
            comment = f"below what the meter resolves: {point.bound:.1e} at most"
        if point.opening in table:
            yield f"  - [{point.opening:g}, {table[point.opening]:.6g} {_UNIT}]  # {comment}"
        else:
            yield f"  # {point.opening:g}: {comment}"
