"""What the loop on the wire is asked to follow in a tick, and how far the ram is from it."""

from math import nan

from rig.plant import inner

from .layout import Drive, Handling


@inner
def setpoint_of(drive, course, tick, memory):
    """Return the setpoint for the row of a tick; NaN if there is none in the row's unit."""
    if drive == Drive.TRACK:
        return course.setpoint[tick]
    if drive == Drive.HOLD and not course.open_loop:
        return memory.handling[Handling.HELD_AT]
    return nan


@inner
def error_of(drive, setpoint, course, memory):
    """Return the distance between setpoint and position in m; NaN unless the loop tracks in m."""
    if drive != Drive.TRACK or course.open_loop:
        return nan
    return abs(setpoint - (memory.encoder[0] + course.offset))
