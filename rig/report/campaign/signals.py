"""Draws the panels of position, command, chamber pressures, and the filter's innovations."""

from typing import Any, Final

import numpy as np

from estimator.filters import THESIS_WINDOW, moving_average_absolute
from rig.report.panel import Panel, TestData, Trace, limits_of, line

_MM: Final = 1e3
_MPA: Final = 1e-6
_KPA: Final = 1e-3
_CHAMBERS: Final = ((1, "chamber_1"), (2, "chamber_2"))


def motion(data: TestData) -> Panel | None:
    """Return the panel of setpoint and position; None if neither is recorded."""
    traces = (
        *_signal(data, "setpoint_m", "setpoint", "reference", _MM, width=3.2),
        *_signal(data, "position_m", "position", "ink", _MM, width=1.2),
    )
    asked = data.channel("setpoint_m") is not None
    caption = "What the ram was asked to do, and what it did." if asked else "Where the ram went."
    return Panel("motion", "Position", caption, "mm", traces) if traces else None


def command(data: TestData) -> Panel | None:
    """Return the panel of the valve command of an open-loop test; None for other tests."""
    traces = tuple(_signal(data, "setpoint_V", "valve command", "ink", 1.0, width=1.4))
    caption = "Open loop: the valve is driven directly, and nothing corrects the position."
    return Panel("command", "Valve command", caption, "V", traces) if traces else None


def pressures(data: TestData) -> Panel | None:
    """Return the panel of both chamber pressures, measured and estimated; None if not recorded."""
    measured: list[Trace] = []
    estimated: list[Trace] = []
    shown = []
    for i, role in _CHAMBERS:
        channel = f"pressure_{i}_Pa"
        measured += _signal(data, channel, f"chamber {i}, measured", role, _MPA, width=3.4,
                            opacity=0.4)  # fmt: skip
        estimated += _signal(data, f"est_{channel}", f"chamber {i}, estimated", role, _MPA,
                             width=1.1)  # fmt: skip
        if (values := data.channel(channel)) is not None:
            shown.append(values * _MPA)
    if not measured and not estimated:
        return None
    caption = (
        "Pale: measured. Fine: the filter's estimate, which should run along the middle of it."
    )
    traces = (*measured, *estimated)
    return Panel("pressures", "Chamber pressures", caption, "MPa", traces, limits_of(shown))


def innovation(data: TestData) -> Panel | None:
    """Return the panel of the pressures' innovations, in kPa.

    It also has the moving averages of their absolute values, and thresholds if the detector has
    them. The panel is None if no innovations are recorded.
    """
    raw: list[Trace] = []
    averages, thresholds, shown = [], [], []
    for i, role in _CHAMBERS:
        channel = f"innovation_pressure_{i}_Pa"
        values = data.channel(channel)
        if values is None:
            continue
        raw += _signal(data, channel, f"chamber {i}", role, _KPA, width=0.8, opacity=0.3)
        average = moving_average_absolute(values) * _KPA
        name = f"chamber {i}, mean of {THESIS_WINDOW}"
        averages.append(data.line(name, role, average, width=2.6, points=data.points // 2))
        # While the filter settles, its innovations do not describe the rig.
        shown.append(average[THESIS_WINDOW:] if average.size > 2 * THESIS_WINDOW else average)
        threshold = _threshold(data, i)
        if threshold is None:
            shown.append(values * _KPA)
        else:
            ends = data.recording.time_s[[0, -1]]
            level = np.full(2, threshold)
            thresholds.append(line(f"chamber {i}, threshold", role, ends, level, width=2.0,
                                   dash="dash"))  # fmt: skip
            shown.append(np.append(level, 0.0))
    if not raw:
        return None
    caption = (
        "Measured pressure less what the filter foresaw a millisecond earlier (pale), and the mean "
        f"of its absolute value over the last {THESIS_WINDOW} samples ({THESIS_WINDOW * 1e-3:g} s)."
    )
    if thresholds:
        caption += (
            " The detector compares the means with the dashed thresholds: one chamber above, an "
            "external leak there; both, an internal one. A double click zooms out to the whole "
            "innovations."
        )
    traces = (*raw, *averages, *thresholds)
    return Panel("innovation", "Innovation", caption, "kPa", traces, limits_of(shown))


def _threshold(data: TestData, chamber: int) -> float | None:
    """Return a chamber's threshold in kPa; None if the detector has none."""
    decision = data.outcome.decision
    value = None if decision is None else decision.details.get(f"threshold_{chamber}_Pa")
    return None if value is None or not np.isfinite(value) else value * _KPA


def _signal(
    data: TestData, channel: str, name: str, role: str, scale: float, **style: Any
) -> list[Trace]:
    """Return a list with the trace of a channel times `scale`; empty if it is not recorded."""
    values = data.channel(channel)
    if values is None:
        return []
    return [data.line(name, role, values * scale, **style)]
