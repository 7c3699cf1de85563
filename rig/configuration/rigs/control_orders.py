"""What an operator orders of the control of a running test, in the keys of a section `control`."""

from collections.abc import Iterator
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Final

import yaml

from control import ControlSettings, Margins, least_margins
from rig.configuration.reading import LONGEST_NUMBER, Located, Place, Sources, options_of, show
from rig.plant import TICK, Parameters

from .control import read_control
from .rig import Rig

_ORDER: Final = Path("set")
"""The word of the order in place of a file's name in messages, as `rig control DIR set` has it."""
_NOT_GIVEN: Final = "none"
"""What takes a key back that may be left out of a file; it is no value of such a key."""
_PLACES: Final = (0.0, 0.5, 1.0)
"""Places at which the margins are looked at, as parts of the way between the position limits. The
oil's resonance is lowest near the middle and highest at an end."""
_STEP: Final = 0.95
_STEPS: Final = 90
"""Factor and number of the steps by which a smaller gain is looked for that keeps the margins: down
to a hundredth of the gain that was asked for, within half a second."""


def ordered_control(text: str, now: ControlSettings) -> ControlSettings:
    """Return the control settings that an order asks for; keys that it does not name stay.

    The order is a list of KEY=VALUE with commas between them, the value as a file has it, such as
    `gain=80 V/m, integral_time=0.5 s`. The value `none` takes back a key that a file may leave out.
    The word `proportional` alone asks for the loop of the thesis, with the present gain.

    Args:
        text: the order.
        now: the present settings.

    Raises:
        ConfigError: the order cannot be used; it lists all that is wrong.
    """
    sources = Sources()
    place = Place(_ORDER, 0, 0)
    order = Located(text.strip(), place, "control", sources)
    if not order.value:
        order.refuse("names no key", _example())
        return sources.finished(None)
    if order.value != "proportional":
        order = order.with_value(dict(_entries(order)))
    found = read_control(order, now)
    if found is not None and order.value == "proportional":
        return ControlSettings(gain=now.gain)
    return sources.finished(found)


def margins_by_model(settings: ControlSettings, gain: float, rig: Rig, par: Parameters) -> Margins:
    """Return the margins that a model expects of a rig's position loop, the least of its stroke.

    Args:
        settings: the control settings.
        gain: gain of the position loop, V/m.
        rig: the rig, with its position limits and its backend.
        par: the parameters of the model, SI.
    """
    limits = rig.limits
    width = limits.position_max_m - limits.position_min_m
    places = tuple(limits.position_min_m + part * width for part in _PLACES)
    # On hardware a command follows from the sample before it (docs/decisions/0007).
    delay_s = TICK if rig.backend == "hardware" else 0.0
    return least_margins(settings, gain, par, delay_s, places)


def remedy_of_margins(settings: ControlSettings, gain: float, rig: Rig, par: Parameters) -> str:
    """Return in words what gives a position loop the margins that it must keep by the model.

    It is the greatest smaller gain that keeps them, within 5 %, or other keys if no gain does.

    Args:
        settings: the control settings, which leave too small margins.
        gain: gain of the position loop, V/m.
        rig: the rig, with its position limits and its backend.
        par: the parameters of the model, SI.
    """
    for _ in range(_STEPS):
        gain *= _STEP
        if margins_by_model(replace(settings, gain=gain), gain, rig, par).kept:
            return f"the greatest gain that keeps them is about {gain:.3g} V/m"
    return "give it a longer integral_time, or less deadband"


def margins_in_words(margins: Margins) -> str:
    """Return margins in words: "12.3 dB and 45 degrees", or that there are none."""
    if margins.gain_dB <= 0.0 or margins.phase <= 0.0:
        return "no margin at all"
    return f"{margins.gain_dB:.1f} dB and {degrees(margins.phase):.0f} degrees"


def control_in_words(control: ControlSettings, before: ControlSettings | None = None) -> str:
    """Return the keys of control settings that differ from others, with their values.

    Args:
        control: the settings: "gain 80 V/m, cyclic true".
        before: the settings before a change, of which the values are given too: "gain 50 V/m -> 80
            V/m, cyclic false -> true"; if not given, keys that have their default are left out.
    """
    parts = []
    usual = before or ControlSettings()
    for key, option in options_of(ControlSettings).items():
        old, new = getattr(usual, key), getattr(control, key)
        if old != new:
            unit = "" if option.quantity is None else option.quantity.unit
            was = "" if before is None else f"{_shown(old, unit)} -> "
            parts.append(f"{key} {was}{_shown(new, unit)}")
    return ", ".join(parts)


def _entries(order: Located) -> Iterator[tuple[str, Located]]:
    """Yield key and value of every item of an order's text; record the problems of the others."""
    seen = set()
    optional = {key for key, each in options_of(ControlSettings).items() if each.default is None}
    for item in order.value.split(","):
        key, equals, written = (part.strip() for part in item.partition("="))
        entry = Located(written, order.place, key or "control", order.sources)
        if not (key and equals and written):
            order.with_value(item.strip()).refuse("is not of the form KEY=VALUE", _example())
        elif key in seen:
            entry.refuse("is given twice", "keep one")
        else:
            seen.add(key)
            is_none = written == _NOT_GIVEN and key in optional
            yield key, entry.with_value(None if is_none else _scalar(written))


def _scalar(written: str) -> object:
    """Return a value as YAML reads it: a truth value, a number or a text.

    What is no such value, such as a day that no calendar has, or is longer than any number of a
    configuration, is a text.
    """
    if len(written) > LONGEST_NUMBER:
        return written
    try:
        value = yaml.safe_load(written)
    except (yaml.YAMLError, ValueError):
        return written
    return value if isinstance(value, bool | int | float) else written


def _shown(value: object, unit: str) -> str:
    if value is None:
        return _NOT_GIVEN
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, int | float):
        return str(value)
    # A gain is written in V/m everywhere, and would be shown in V/mm from 1000 V/m on.
    return f"{value:g} {unit}" if unit == "V/m" else show(float(value), unit)


def _example() -> str:
    keys = ", ".join(options_of(ControlSettings))
    return f"write as in gain=80V/m integral_time=0.5s; keys: {keys}"
