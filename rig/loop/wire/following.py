"""What the loop on the wire is asked to follow in a tick, and how far the ram is from it.

The setpoints of a segment are laid out in advance. A stretch of them can be skipped: the setpoint
then goes over to the one at the place of the order along a raised cosine.
"""

from math import cos, nan, pi
from typing import Final

from rig.loop.atomic import load_acquire, store_release
from rig.loop.board import Word
from rig.loop.interlocks import Action
from rig.plant import inner

from .layout import Drive, Handling

_PLACE_AT: Final = 20
_NUMBER_AT: Final = 42
"""Bits of an order at which the place and the segment's number begin. An order is one integer, so
that it is written and read whole: 20 bits hold a blend of 17 minutes, 22 bits the setpoints of an
hour, and 21 bits two million segments."""


def skip_order(segment: int, place: int, blend_ticks: int) -> int:
    """Return the order to skip to another place of a segment's setpoints, for `Word.SKIP`.

    Args:
        segment: number of the segment.
        place: index of the setpoint with which the loop goes on; their number to end there.
        blend_ticks: number of ticks in which the setpoint goes over to the later ones.

    Raises:
        ValueError: place or blend do not fit.
    """
    if not 0 <= place < 1 << _NUMBER_AT - _PLACE_AT or not 0 <= blend_ticks < 1 << _PLACE_AT:
        raise ValueError(f"cannot skip to setpoint {place} with a blend of {blend_ticks} ticks")
    return segment << _NUMBER_AT | place << _PLACE_AT | blend_ticks


@inner
def take_skip(course, tick, action, memory, words):
    """Carry out a new order to skip; return by how many setpoints the loop is ahead of its ticks.

    An order to a place that was reached already, or while the ram does not follow the setpoints,
    changes nothing.
    """
    lead = words[Word.LEAD]
    order = load_acquire(words, Word.SKIP.value)
    if order == words[Word.SKIPPED] or order >> _NUMBER_AT != course.number:
        return lead
    place = (order >> _PLACE_AT) & ((1 << _NUMBER_AT - _PLACE_AT) - 1)
    here = tick + lead
    if course.drive == Drive.TRACK and action < Action.HOLD.value and place > here:
        if place < course.setpoint.size:
            from_m = wanted_at(course, here, memory) - course.setpoint[place]
            memory.handling[Handling.SKIP_FROM] = from_m
            memory.handling[Handling.SKIP_PLACE] = place
            memory.handling[Handling.SKIP_TICKS] = order & ((1 << _PLACE_AT) - 1)
        lead = words[Word.LEAD] = place - tick
    store_release(words, Word.SKIPPED.value, order)
    return lead


@inner
def wanted_at(course, place, memory):
    """Return the setpoint at a place, which joins smoothly the one before a skip."""
    setpoint = course.setpoint[place]
    gone = place - memory.handling[Handling.SKIP_PLACE]
    # Both are NaN before the first skip, which no comparison with them is true for.
    if gone < memory.handling[Handling.SKIP_TICKS]:
        share = 0.5 + 0.5 * cos(pi * gone / memory.handling[Handling.SKIP_TICKS])
        setpoint += memory.handling[Handling.SKIP_FROM] * share
    return setpoint


@inner
def setpoint_of(drive, course, place, memory):
    """Return the setpoint for a row, at a place; NaN if there is none in the row's unit."""
    if drive == Drive.TRACK:
        return wanted_at(course, place, memory)
    if drive == Drive.HOLD and not course.open_loop:
        return memory.handling[Handling.HELD_AT]
    return nan


@inner
def error_of(drive, setpoint, course, memory):
    """Return the distance between setpoint and position in m; NaN unless the loop tracks in m."""
    if drive != Drive.TRACK or course.open_loop:
        return nan
    return abs(setpoint - (memory.encoder[0] + course.offset))
