"""The section `control` of a rig file or a test: what the position loop adds to gain times error."""

from dataclasses import replace
from types import MappingProxyType
from typing import Final

from control import ControlSettings
from rig.configuration.reading import Located, read_options

UNLESS_USUAL: Final = MappingProxyType({"unless_usual": True})
"""Metadata of a dataclass's field that `plain` leaves out while it has its default, so that
recordings and journals of rigs and tests without the section stay as they were."""


def read_control(item: Located | None, rig: ControlSettings | None = None) -> ControlSettings | None:
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
