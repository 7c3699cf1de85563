"""Compares proportional and tolerant control of a leaking rig with the loop of a healthy one.

The comparison is made for several places and sizes of the leak, motions, and loads.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.plant import NOMINAL, Parameters
from rig.plant.integrator import TICK
from tools.thesis_tables.markdown import fixed, heading_row, table

from .runs import MEASURED_FROM_S, Array, Run, leak_coefficients, run, ticks

PLACES: Final = ("chamber 1", "chamber 2", "internal")
FLOWS: Final = (0.5, 1.0, 2.0, 4.0)
"""Sizes of the leaks, L/min: at half the supply pressure, or for internal leaks at 2.6 MPa."""
LOADS: Final[Mapping[str, Parameters]] = {
    "unloaded": NOMINAL,
    "spring": NOMINAL._replace(spring_stiffness=3e4),
}
"""Rigs by their load. The ram meets the spring of 3e4 N/m at 0.22 m and presses it with up to
5.4 kN; it could press with 8.7 kN."""

_MM: Final = 1e3
HEAD: Final = (
    "leak, L/min", "rms error, mm", "greatest error, mm", "left at the end, mm", "rms command, V",
)  # fmt: skip


def _sine(time_s: Array) -> Array:
    return 0.3 + 0.1 * np.sin(np.pi * time_s)


def _quick_sine(time_s: Array) -> Array:
    return 0.3 + 0.02 * np.sin(2.0 * np.pi * time_s)


def _steps(time_s: Array) -> Array:
    return np.where(time_s % 6.0 < 3.0, 0.35, 0.25)


def _hold(time_s: Array) -> Array:
    """Return a sine until `MEASURED_FROM_S`, then one constant level (m)."""
    return np.where(time_s < MEASURED_FROM_S, _sine(time_s), 0.35)


MOTIONS: Final[Mapping[str, Callable[[Array], Array]]] = {
    "sine, 100 mm at 0.5 Hz": _sine,
    "sine, 20 mm at 1 Hz": _quick_sine,
    "steps of 100 mm every 3 s": _steps,
    "step of 50 mm, then hold": _hold,
}


@dataclass(frozen=True)
class Comparison:
    """Three runs of one motion under one load: healthy, and leaking with either controller.

    Attributes:
        motion, load: names in `MOTIONS` and `LOADS`.
        place: index of the leak in `PLACES`.
        flow: size of the leak, L/min; see `FLOWS`.
        healthy: run without a leak.
        proportional: run with the leak, which the loop does not make up for.
        tolerant: run with the leak under tolerant control.
    """

    motion: str
    load: str
    place: int
    flow: float
    healthy: Run
    proportional: Run
    tolerant: Run

    @property
    def moves(self) -> bool:
        """Whether the ram keeps moving while errors are measured, rather than being held."""
        return not self.motion.endswith("hold")


def setpoint(motion: str) -> Array:
    """Return the setpoint of a motion in `MOTIONS`, float64 (ticks,), m."""
    return MOTIONS[motion](np.arange(ticks(), dtype=np.float64) * TICK)


def comparisons(leak_is_given: bool, tracking: bool = False) -> Iterator[Comparison]:
    """Yield a comparison for every leak in every motion under every load.

    If `leak_is_given`, the tolerant controller gets the true leak `TOLD_AFTER_S` after its onset;
    otherwise the detector in the loop has to find the leak. With `tracking`, all three runs have
    the tracking law in place of the gain alone.
    """
    for motion in MOTIONS:
        wanted = setpoint(motion)
        for load, rig in LOADS.items():
            healthy = run(wanted, rig=rig, tracking=tracking)
            for place in range(len(PLACES)):
                for flow in FLOWS:
                    leaks = leak_coefficients(place, flow)
                    plain = run(wanted, rig=rig, leaks=leaks, tracking=tracking)
                    known = leaks if leak_is_given else None
                    tolerant = run(wanted, rig=rig, leaks=leaks, told=known, tracking=tracking)
                    yield Comparison(motion, load, place, flow, healthy, plain, tolerant)


def comparison_table(found: list[Comparison]) -> str:
    """Return the table in Markdown, with a row for each comparison, in the order given.

    Its cells state healthy / proportional / tolerant values; only holds have errors that are left.
    """
    rows: list[list[str]] = []
    last = ""
    for one in found:
        heading = f"{one.motion}, {one.load}"
        if heading != last:
            rows.append(heading_row(heading, len(HEAD)))
        last = heading
        three = (one.healthy, one.proportional, one.tolerant)
        rows.append(
            [
                f"{one.flow:g}, {PLACES[one.place]}",
                " / ".join(fixed(_MM * each.rms_error, 2) for each in three),
                " / ".join(fixed(_MM * each.worst_error, 1) for each in three),
                " / ".join(fixed(_MM * each.final_error, 2) for each in three)
                if not one.moves
                else "",
                " / ".join(fixed(each.effort, 2) for each in three),
            ]
        )
    return table(HEAD, rows)


def summary_table(found: list[Comparison]) -> str:
    """Return a table with a row for each size of leak: the worst errors over all comparisons.

    Errors of motions are divided by the healthy loop's, and the greatest ratio is given. For holds,
    the row has the median and the largest of the errors that are left at the end, in mm.
    """
    rows = []
    for flow in FLOWS:
        moving = [one for one in found if one.moves and one.flow == flow]
        holds = [one for one in found if not one.moves and one.flow == flow]
        cells = [f"{flow:g}"]
        for way in ("proportional", "tolerant"):
            runs = [(getattr(one, way), one.healthy) for one in moving]
            cells += [
                fixed(max(mine.rms_error / healthy.rms_error for mine, healthy in runs), 2),
                fixed(max(mine.worst_error / healthy.worst_error for mine, healthy in runs), 2),
            ]
        for way in ("proportional", "tolerant"):
            left = [_MM * getattr(one, way).final_error for one in holds]
            cells.append(f"{fixed(float(np.median(left)), 1)} / {fixed(max(left), 1)}")
        rows.append(cells)
    head = (
        "leak, L/min",
        "proportional: rms", "greatest",
        "tolerant: rms", "greatest",
        "proportional: left at hold, mm", "tolerant: left at hold, mm",
    )  # fmt: skip
    return table(head, rows)


def tracking_table(found: list[Comparison]) -> str:
    """Return a table with a row for each size of leak: errors of the tracking law, in mm.

    As the healthy loop's error is next to nothing in a sine, errors are not divided by it. The row
    has the most by which a leak adds to the healthy loop's rms error in a motion, and for holds the
    median and the largest error left at the end, each with the leak not made up for and made up
    for.
    """
    rows = []
    for flow in FLOWS:
        moving = [one for one in found if one.moves and one.flow == flow]
        holds = [one for one in found if not one.moves and one.flow == flow]
        cells = [f"{flow:g}"]
        for way in ("proportional", "tolerant"):
            added = [getattr(one, way).rms_error - one.healthy.rms_error for one in moving]
            cells.append(fixed(_MM * max(added), 2))
        for way in ("proportional", "tolerant"):
            left = [_MM * getattr(one, way).final_error for one in holds]
            cells.append(f"{fixed(float(np.median(left)), 2)} / {fixed(max(left), 2)}")
        rows.append(cells)
    head = (
        "leak, L/min",
        "not made up for: added to the rms error, mm", "made up for: added, mm",
        "not made up for: left at hold, mm", "made up for: left at hold, mm",
    )  # fmt: skip
    return table(head, rows)


def late(found: list[Comparison]) -> str:
    """Return a sentence that states how many leaks were compensated for, and the latest time (s).

    The time counts from the start of the run, not from the leak's onset.
    """
    times = [one.tolerant.confirmed_s for one in found]
    known = [time for time in times if time is not None]
    missed = len(times) - len(known)
    latest = f"the latest from {max(known):.1f} s on" if known else "none"
    return f"{len(known)} of {len(times)} leaks were made up for, {latest}; {missed} were not."
