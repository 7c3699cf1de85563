"""The section `control` of rigs and tests: what the position loop adds to gain times error."""

from collections.abc import Iterator
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from control import ControlSettings
from rig.configuration.reading import Located, options_of, read_options

from .writing import with_section

UNLESS_USUAL: Final = MappingProxyType({"unless_usual": True})
"""Metadata of a dataclass's field that `plain` leaves out while it has its default, so that
recordings and journals of rigs and tests without the section stay as they were."""


def read_control(
    item: Located | None, rig: ControlSettings | None = None
) -> ControlSettings | None:
    """Return the control settings that a section gives; None if they are unusable.

    Problems are recorded. A key that is not given has the value of the rig's settings `rig`, or its
    default without them. The word `proportional` instead of keys means the loop of the thesis.
    """
    usual = rig or ControlSettings()
    if item is None:
        return usual
    if item.value == "proportional":
        return ControlSettings()
    if not isinstance(item.value, dict):
        item.refuse("is not a control law", "write `proportional`, or keys below it")
        return None
    given = read_options(ControlSettings, item)
    if given is None:
        return None
    settings = replace(usual, **{key: getattr(given, key) for key, _ in item.items()})
    if settings.feedforward == "model" and settings.feedforward_gain is not None:
        limit = "is given although the feedforward is that of the model"
        item.refuse(limit, "remove it, or write `feedforward: none`", key="feedforward_gain")
        return None
    return settings


def control_lines(settings: ControlSettings, comment: str) -> Iterator[str]:
    """Yield the lines of a section `control` that reads back as `settings`, a comment first.

    Keys that have their default are left out.
    """
    yield f"# {comment}"
    yield "control:"
    usual = ControlSettings()
    for key, option in options_of(ControlSettings).items():
        value = getattr(settings, key)
        if value == getattr(usual, key):
            continue
        if isinstance(value, float) and option.quantity is not None:
            yield f"  {key}: {value!r} {option.quantity.unit}".rstrip()
        else:
            yield f"  {key}: {str(value).lower() if isinstance(value, bool) else value}"


def with_control(text: str, settings: ControlSettings, comment: str) -> str:
    """Return the text of a rig file with another section `control`; all other lines stay.

    The section takes the place of the one that is there, or comes last.

    Args:
        text: YAML of a rig file, a mapping in block style.
        settings: the control settings.
        comment: comment above the section, on one line.
    """
    return with_section(text, "control", list(control_lines(settings, comment)), "by rig ")
