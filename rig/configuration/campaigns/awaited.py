"""What a test or a segment awaits is read here: `wait_for`, `until`, and those of a segment."""

from collections.abc import Callable
from typing import Annotated, Any, Final

from pydantic import create_model

from faults import Condition, Until, Verdict
from rig.configuration.reading import Located, Physical, Schema, elements_of, read_mapping
from rig.configuration.rigs import Rig, limit_schema, read_channel_limits

from .conditions import MEASURABLE, is_sound, measured_by
from .setpoints import DURATION

_AWAITED: Final = "write {channel: ..., low: ..., at_most: 10 min}, or a list of such"
_UNKNOWN: Final = "is not measured by this rig"
_FOR: Final = Annotated[float, Physical("s", 0.0, 600.0, 1.0)]
_SEGMENT_LASTS: Final = Physical("s", 1.0, 3600.0, 60.0)
"""How long a segment may wait. A channel is looked at every 50 ms, so that less than a second would
be a coarse measure; a test lasts an hour at most."""


def _verdict_file(name: str, text: str, most: Physical) -> type[Schema]:
    keys: Any = {
        "verdict": (Verdict, ...),
        "for": (_FOR, 0.0),
        "at_most": (Annotated[float, most], ...),
    }
    return create_model(name, __base__=Schema, __doc__=text, **keys)


UntilVerdictFile = _verdict_file("UntilVerdictFile", "Keys of `until` with a verdict.", DURATION)
SegmentUntilVerdictFile = _verdict_file(
    "SegmentUntilVerdictFile", "Keys of a segment's `until` with a verdict.", _SEGMENT_LASTS
)


def awaited_files() -> tuple[type[Schema], ...]:
    """Return the class of the keys of what a test waits for."""
    return (limit_schema(_awaited_keys, name="AwaitedFile"),)


def until_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of what ends a test: a channel or a verdict."""
    return (limit_schema(_until_keys, name="UntilChannelFile"), UntilVerdictFile)


def segment_until_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of what ends a segment: a channel or a verdict."""
    return (
        limit_schema(_segment_keys, name="SegmentUntilChannelFile"),
        SegmentUntilVerdictFile,
    )


def read_awaited(item: Located | None, rig: Rig | None) -> tuple[Condition, ...]:
    """Return what a test waits for before it begins; record the problems.

    Args:
        item: the list under the key `wait_for`, or the only element of it; None if there is none.
        rig: the rig; if it is None, any signal that some rig can measure may be awaited.
    """
    if item is None:
        return ()
    known = MEASURABLE if rig is None else measured_by(rig)
    given = [item] if isinstance(item.value, dict) else elements_of(item, _AWAITED)
    limits = read_channel_limits(given, _awaited_keys, MEASURABLE, known, _UNKNOWN)
    awaited = (
        (Condition(give_up_s=keys.pop("at_most"), **keys), element) for element, keys in limits
    )
    return tuple(each for each, element in awaited if is_sound(each, element))


def read_until(item: Located | None, rig: Rig | None) -> tuple[Until, float] | None:
    """Return what ends a test and its longest duration, s; if it is wrong, record why, and None.

    Args:
        item: the mapping under the key `until`; None if there is none.
        rig: the rig; if it is None, any signal that some rig can measure may be awaited.
    """
    return None if item is None else _until(item, rig, UntilVerdictFile, _until_keys)


def read_segment_until(item: Located, rig: Rig | None) -> tuple[Until, float] | None:
    """Return what ends a segment and how long it lasts at most, s; as `read_until` otherwise."""
    return _until(item, rig, SegmentUntilVerdictFile, _segment_keys)


def _until(
    item: Located,
    rig: Rig | None,
    by_verdict: type[Schema],
    keys_of: Callable[[Any], dict[str, Any]],
) -> tuple[Until, float] | None:
    if item.get("verdict") is not None:
        file: Any = read_mapping(by_verdict, item)
        if file is None:
            return None
        return Until(verdict=file.verdict, for_s=getattr(file, "for")), file.at_most
    known = MEASURABLE if rig is None else measured_by(rig)
    for _, keys in read_channel_limits([item], keys_of, MEASURABLE, known, _UNKNOWN):
        at_most = keys.pop("at_most")
        if not keys["low"] < keys["high"]:
            item.refuse("is not below high", "swap them", key="low")
            return None
        return Until(**keys), at_most
    return None


def _awaited_keys(bound: Any) -> dict[str, Any]:
    at_most = Annotated[float, Physical("s", 1.0, 7 * 86400.0, 600.0)]
    return {"hysteresis": (bound, 0.0), "for": (_FOR, 0.0), "at_most": (at_most, ...)}


def _until_keys(bound: Any) -> dict[str, Any]:
    return {"for": (_FOR, 0.0), "at_most": (Annotated[float, DURATION], ...)}


def _segment_keys(bound: Any) -> dict[str, Any]:
    return {"for": (_FOR, 0.0), "at_most": (Annotated[float, _SEGMENT_LASTS], ...)}
