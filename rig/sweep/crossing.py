"""Finds where a case passes the bands of its limits, in the samples of the whole case.

The rules are those of a campaign's limits (`rig.runner.outcomes.limits`): a band counts as passed
once the value has been beyond it for long enough, and as kept again once the value has come back
within it by the hysteresis; a figure is computed over the last samples every 50 ms.
"""

from collections.abc import Iterator, Mapping
from math import inf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faults import TestLimit

Array = NDArray[np.float64]

_LOOK_TICKS: Final = 50
"""Ticks from one look at a figure to the next: 50 ms, as in a campaign (decision 25)."""
_INSTANT_S: Final = 1e-9


class Crossing(NamedTuple):
    """One passing of a band of a limit in a case."""

    limit: TestLimit
    band: str
    """"inner" or "outer"."""
    action: str
    """What a test would do: `warn`, `hold`, `ramp_down` or `trip`."""
    at_s: float
    """When the band counted as passed, s of the case."""
    value: float
    """The value then, SI."""
    end: float
    """The end of the band that was passed, SI."""


def crossings_of(limit: TestLimit, channels: Mapping[str, Array]) -> list[Crossing]:
    """Return the passings of a limit's bands in a case, those of the inner band first.

    Args:
        limit: the limit.
        channels: channel -> samples (ticks,), SI, with all that the limit watches, and `time_s`.
    """
    time_s = channels["time_s"]
    stretches = limit.windows_s or ((0.0, inf),)
    found: list[Crossing] = []
    for begin_s, end_s in stretches:
        here = (time_s >= begin_s - _INSTANT_S) & (time_s < end_s - _INSTANT_S)
        times, values = _watched(limit, {name: each[here] for name, each in channels.items()})
        for band in limit.bands:
            for at_s, value in _passings(times, values, band.low, band.high, limit):
                end = band.high if value > band.high else band.low
                found.append(Crossing(limit, band.name, band.action, at_s, value, end))
    return sorted(found, key=lambda crossing: crossing.band)


def _watched(limit: TestLimit, channels: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return the times in s at which a limit is judged in a stretch, and the values then, (n,)."""
    time_s = channels["time_s"]
    if limit.expression is None:
        return time_s, channels[limit.watched]
    if not limit.expression.is_number:
        return time_s, limit.expression.of(channels)
    # A figure is first judged once there is as much of the stretch as it looks back over.
    over = round(limit.over_s * 1000.0)
    looks = np.arange(_LOOK_TICKS - 1, time_s.size, _LOOK_TICKS)
    looks = looks[looks >= over]
    needed = {name: channels[name] for name in limit.expression.channels}
    values = [
        limit.expression.of({name: each[at - over : at + 1] for name, each in needed.items()})
        for at in looks.tolist()
    ]
    return time_s[looks], np.array(values, np.float64)


def _passings(
    times: Array, values: Array, low: float, high: float, limit: TestLimit
) -> Iterator[tuple[float, float]]:
    """Yield (time in s, value) of each passing of a band.

    Args:
        times: times at which the value is judged, s, (n,).
        values: the values, SI, (n,); NaN counts as within.
        low: lower end of the band, SI.
        high: upper end of the band, SI.
        limit: the limit, for how long a passing must last and how far back the value must come.
    """
    beyond = (values < low) | (values > high)
    if not beyond.any():
        return
    back = limit.hysteresis
    outside = np.flatnonzero(beyond)
    inside, kept = (
        np.append(np.flatnonzero(~each), times.size)
        for each in (beyond, (values < low + back) | (values > high - back))
    )
    at = 0
    while True:
        place = np.searchsorted(outside, at)
        if place == outside.size:
            return
        begin = int(outside[place])
        end = int(inside[np.searchsorted(inside, begin)])
        lasted = np.flatnonzero(times[begin:end] - times[begin] >= limit.for_s - _INSTANT_S)
        at = end
        if lasted.size:
            passed = begin + int(lasted[0])
            yield float(times[passed]), float(values[passed])
            at = int(kept[np.searchsorted(kept, passed)])
