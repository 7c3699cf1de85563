"""How the loop on the wire begins a segment, and goes on with one whose control was changed.

The numbers of a control law are arguments of the compiled loop, so that a tick costs the same with
any. For a change the loop is left between two ticks, and entered again with the new numbers and the
same segment, filter and memory; `rig.supervisor.processes.loop_process` does so.
"""

from math import nan

from control import (
    Moment,
    Steered,
    begin_motion,
    forget_changes,
    is_changing,
    offset_of_change,
    tracking_command,
)
from rig.loop.atomic import store_release
from rig.loop.board import Word
from rig.loop.interlocks import Action
from rig.loop.reaction import forget
from rig.plant import inner

from .layout import Drive, Going, Left


@inner
def begin_or_go_on(course, command, words, memory):
    """Return the number of the next tick, whether it has started, the action, and the held command.

    A segment that begins has no action, and its memory is made ready for it; `command` is what the
    device has now, V. One that goes on after a change of control has what `left_for` noted, and
    the board is told that the change is taken.
    """
    if course.goes_on:
        going = memory.going
        tick, started = int(going[Going.TICK]), going[Going.STARTED] != 0.0
        words[Word.CHANGED_AT] = tick
        store_release(words, Word.CHANGED.value, course.change)
        return tick, started, int(going[Going.ACTION]), going[Going.HELD]
    memory.handling[:] = nan
    memory.decided[:] = nan
    forget(memory.reaction)
    begin_motion(course.drive == Drive.TRACK and not course.open_loop, memory.control)
    forget_changes(memory.change)
    words[Word.TICK] = words[Word.LEAD] = 0
    words[Word.SEGMENT] = course.number
    return 0, False, Action.NONE.value, command


@inner
def left_for(tick, started, action, held, memory):
    """Note where the segment is, for `begin_or_go_on`; return `Left.CHANGED`.

    Args:
        tick: number of the next tick in the segment.
        started: whether the first whole sample has come.
        action: `Action` of the segment so far.
        held: command that is held up to the next sample, V.
        memory: `WireMemory`; updated.
    """
    going = memory.going
    going[Going.TICK] = tick
    going[Going.STARTED] = 1.0 if started else 0.0
    going[Going.ACTION] = action
    going[Going.HELD] = held
    return Left.CHANGED.value


@inner
def tracked_command(course, earlier, setpoint, place, position, period, memory):
    """Return the position loop's command in V at a place in the segment's setpoints.

    Args:
        course: the segment.
        earlier: its control before the last change, `Earlier`.
        setpoint: the setpoint there, m; after a skip it is beside the one that is laid out.
        place: index in the segment's setpoints.
        position: newest position, m.
        period: period of the loop, s.
        memory: `WireMemory`; its parts `control` and `change` are updated.
    """
    time_s, limit = place * period, course.limit
    ahead = _ahead(course.feedforward, place)
    expected = setpoint
    if place < course.expected.size:
        # After a skip the ram is beside its course as the setpoint is.
        expected = course.expected[place] + (setpoint - course.setpoint[place])
    if is_changing(memory.change):
        before = earlier.guide
        ahead += offset_of_change(
            Moment(setpoint, position, time_s, limit, period),
            Steered(earlier.gain, before.law, _ahead(before.feedforward, place), before.tones),
            Steered(course.gain, course.law, ahead, course.tones),
            memory.control, memory.change,
        )  # fmt: skip
    return tracking_command(
        setpoint, position, ahead, expected, time_s, course.gain, limit, period, course.law,
        course.tones, memory.control,
    )  # fmt: skip


@inner
def _ahead(feedforward, place):
    """Return the feedforward at a place in V; 0 beyond its end."""
    return feedforward[place] if place < feedforward.size else 0.0
