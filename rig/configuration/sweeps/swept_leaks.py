"""The `leaks` of a sweep are read here: how many cases leak, where, how much and from when on."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, get_args

from faults import LEAK_KINDS, TYPICAL_PRESSURE
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Under,
    elements_of,
    quantity_in,
    read_mapping,
    show,
    suggestion,
)
from rig.configuration.rigs import Rig
from rig.plant import TICK, LeakName

from .distributions import Distribution, Drawn, Random, resolved
from .sweep_plan import SweptLeaks, SweptLevel
from .swept_adaptive import AdaptiveFile, read_adaptive

INTERNAL_PRESSURE: Final = 2.5e6
"""Pressure difference in Pa that friction makes between the chambers of a moving ram.

The flow of an internal leak is stated at this drop.
"""
_AFTER_ONSET_S: Final = 4.0
_LEAKAGE: Final = Physical("m^3/(s Pa^0.5)", 0.0, 1e-6, 4e-9)
_FLOW: Final = Physical("m^3/s", 0.0, 1e-3, 1e-5)
_SECONDS: Final = Physical("s", 0.0, 3600.0, 20.0)
_MOST_LEVELS: Final = 100
_AT_ONCE: Final = Distribution("fixed", (0.0,))


class LeaksFile(Schema):
    """Keys of `leaks` in a sweep file: how many cases leak, where, how much and from when on."""

    healthy: Annotated[float, Physical("", 0.0, 1.0, 0.25)] = 0.25
    places: tuple[LeakName, ...] = get_args(LeakName)
    flow: Annotated[Any, Random(_FLOW)] = None
    coefficient: Annotated[Any, Random(_LEAKAGE)] = None
    pressure: Annotated[float | None, Physical("Pa", 1e3, 3.5e7, TYPICAL_PRESSURE)] = None
    onset: Annotated[Any, Random(_SECONDS)] = None
    profile: Annotated[Any, Under(lambda: (LevelFile,), many=True)] = None
    adaptive: Annotated[Any, Under(lambda: (AdaptiveFile,))] = None


class LevelFile(Schema):
    """Keys of a level of a leak's `profile`: from when on the leak has which size."""

    at: Annotated[Any, Random(_SECONDS)]
    ramp: Annotated[Any, Random(_SECONDS)] = None
    flow: Annotated[Any, Random(_FLOW)] = None
    coefficient: Annotated[Any, Random(_LEAKAGE)] = None


_HINTS: Final = {
    "until": "a leak of a sweep stays to the end of its case, where the verdict is looked at",
    "needle_opening": "lanes have no needle valves; give flow or coefficient",
    "linear_coefficient": "leaks of a sweep follow the square-root law; give flow or coefficient",
}


def read_leaks(
    item: Located | None,
    duration_s: float | None,
    learning_s: float | None,
    rig: Rig | None,
    cases: int | None = None,
) -> SweptLeaks | None:
    """Return the leaks of a sweep; None if all cases are healthy or if they cannot be used.

    Problems are recorded.

    Args:
        item: the mapping under `leaks`; None if there is none.
        duration_s: duration of a case, s; None if it is not known.
        learning_s: time from the begin of a case in which the filter learns what is healthy, so
            that no leak may begin in it, s; None for a filter that does not.
        rig: the rig, whose bypasses make the leaks; None if it is unusable.
        cases: number of cases of the sweep; None if it is not known.
    """
    if item is None or item.value == "none":
        return None
    file = read_mapping(LeaksFile, item, _HINTS)
    if file is None:
        return None
    _check_places(item, file, rig)
    sized = ("flow", "coefficient", "onset", "profile", "adaptive")
    if file.healthy == 1.0 and all(item.get(key) is None for key in sized):
        return None
    if item.get("profile") is not None:
        for key in ("flow", "coefficient", "onset"):
            if item.get(key) is not None:
                limit = "is given beside a profile, whose levels have their own"
                item.refuse(limit, "move it into the profile", key=key)
        levels, key = _profile(item.find("profile"))
        read_adaptive(item.get("adaptive"), None, file.healthy, cases)
        if not levels:
            return None
        size, onset, profile = levels[-1].size, levels[0].at, levels
        first, last = (item.find("profile").elements()[end].find("at") for end in (0, -1))
        last_s = levels[-1].at.support[1] + levels[-1].ramp.support[1]
        _check_times(last, onset.support[0], last_s, duration_s, None)
        _check_times(first, onset.support[0], onset.support[1], duration_s, learning_s)
        adaptive = None
    else:
        found = _size(item, file)
        flow = found[1] if found is not None and found[0] == "flow" else None
        adaptive = read_adaptive(item.get("adaptive"), flow, file.healthy, cases)
        if item.get("onset") is None:
            item.refuse("has no begin", "give `onset: 20 s`, or a profile", "", name="leaks")
            return None
        entry = item.find("onset")
        begin = None
        if file.onset is not None:  # else it is wrong, which is recorded already
            begin = quantity_in(entry, lambda: resolved(file.onset, _SECONDS))
        if begin is not None:
            _check_times(entry, begin.support[0], begin.support[1], duration_s, learning_s)
        if found is None or begin is None:
            return None
        (key, size), onset, profile = found, begin, ()
    usual = {**dict.fromkeys(file.places, TYPICAL_PRESSURE), "internal_leakage": INTERNAL_PRESSURE}
    pressures = tuple(file.pressure or usual[place] for place in file.places)
    return SweptLeaks(
        file.healthy,
        tuple(file.places),
        size,
        pressures if key == "flow" else None,
        onset,
        profile,
        adaptive,
    )


def _size(item: Located, file: LeaksFile | LevelFile) -> tuple[str, Distribution] | None:
    """Return the key that gives a size, and its distribution; if there is none, record why."""
    sizes = {name: drawn for name in ("flow", "coefficient") if (drawn := getattr(file, name))}
    if len(sizes) != 1:
        limit = "has both flow and coefficient" if sizes else "has no size"
        item.refuse(limit, "give flow or coefficient", "")
        return None
    name, drawn = next(iter(sizes.items()))
    entry, limits = item.find(name), _FLOW if name == "flow" else _LEAKAGE
    size = quantity_in(entry, lambda: resolved(drawn, limits))
    if size is not None and size.support[0] <= 0.0:
        entry.refuse("may be no leak at all", "give its part of all cases as `healthy`")
    return None if size is None else (name, size)


def _profile(item: Located) -> tuple[tuple[SweptLevel, ...], str]:
    """Return the levels of a leak's profile, and the key that gives their sizes.

    If a level is wrong, record why, and return no levels.
    """
    problems = item.sources.problems
    before = problems.reported
    entries = elements_of(item, "write a list of levels: - {at: 12 s, flow: 0.1 L/min}")
    if not 1 <= len(entries) <= _MOST_LEVELS:
        item.refuse(f"has {len(entries)} levels", f"give 1 to {_MOST_LEVELS}", "")
    found = list(_levels(entries))
    keys = {key for key, _ in found}
    if len(keys) > 1:
        item.refuse("mixes flows and coefficients", "give all sizes by the same key", "")
    for index in range(1, len(found)):
        before_s = found[index - 1][1].at.support[1] + found[index - 1][1].ramp.support[1]
        if len(found) == len(entries) and found[index][1].at.support[0] < before_s - 0.5 * TICK:
            limit = f"may begin before the level before is reached, at {show(before_s, 's')}"
            remedy = "keep their times apart, the ramp included"
            entries[index].refuse(limit, remedy, key="at")
    if problems.reported > before:
        return (), ""
    return tuple(level for _, level in found), next(iter(keys))


def _levels(entries: list[Located]) -> Iterator[tuple[str, SweptLevel]]:
    for entry in entries:
        file = read_mapping(LevelFile, entry, _HINTS)
        size = None if file is None else _size(entry, file)
        if file is None or size is None:
            continue
        at = _time(entry, "at", file.at)
        ramp = _AT_ONCE if file.ramp is None else _time(entry, "ramp", file.ramp)
        if at is not None and ramp is not None:
            yield size[0], SweptLevel(at, ramp, size[1])


def _time(item: Located, key: str, drawn: Drawn) -> Distribution | None:
    return quantity_in(item.find(key), lambda: resolved(drawn, _SECONDS))


def _check_places(item: Located, file: LeaksFile, rig: Rig | None) -> None:
    if not file.places:
        remedy = f"name some of {', '.join(LEAK_KINDS)}"
        item.refuse("is empty", remedy, "[]", "places")
    if len(set(file.places)) < len(file.places):
        item.refuse("names one twice", "name each once", key="places")
    for place in file.places:
        if rig is not None and place not in rig.injectable:
            remedy = suggestion(place, rig.injectable, "bypasses")
            item.refuse(f"is no bypass of {rig.name}", remedy, place, "places")


def _check_times(
    entry: Located,
    first_s: float,
    last_s: float,
    duration_s: float | None,
    learning_s: float | None,
) -> None:
    """Record a problem if a leak may begin too early, or have its last size too late, to judge it.

    Args:
        entry: the value that gives the times.
        first_s: earliest time at which a leak begins, s.
        last_s: latest time at which it has its last size, s.
        duration_s: duration of a case, s; None if it is not known.
        learning_s: time in which the filter learns what is healthy, s; None if it does not.
    """
    if duration_s is not None and last_s > duration_s - _AFTER_ONSET_S:
        limit = f"may come later than {_AFTER_ONSET_S:g} s before the end, {duration_s:g} s"
        entry.refuse(limit, "let it begin earlier")
    if duration_s is not None and learning_s is not None and first_s < learning_s:
        limit = f"may fall into the {learning_s:g} s in which thesis-7 learns what is healthy"
        entry.refuse(limit, "let it begin later")
