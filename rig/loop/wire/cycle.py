"""The loop on the wire: wait, exchange, estimate, check, record, in one compiled function.

At tick k the loop writes a frame with the command that follows from sample k-1 and setpoint k; the
same transaction returns sample k (docs/decisions/0007). Nothing here returns to Python, and the
loop waits for nothing but the clock and the device.
"""

from math import isnan, nan
from typing import Final

from rig.io import FAST_INPUTS, FAST_OUTPUTS, METERS, ExchangeStatus, exchange, monotonic_ns
from rig.jit import njit
from rig.loop.atomic import load_acquire, store_release
from rig.loop.board import DECISIONS_KEPT, Word
from rig.loop.clock import sleep_until
from rig.loop.cycle import DECISION_COLUMNS, READINGS_AT, STATES_AT, limited_command, sample_row
from rig.loop.decided import DECIDED
from rig.loop.interlocks import (
    NO_CHANNEL,
    Action,
    Cause,
    Tick,
    allowed_command,
    check_sample,
    held_position,
)
from rig.loop.reaction import Reaction, react, tolerating
from rig.plant import READING_COUNT, inner

from .changing import begin_or_go_on, left_for, tracked_command
from .following import error_of, setpoint_of, take_skip, wanted_at
from .layout import MEASURED, STATUS, TIMINGS, Count, Drive, Handling, Left, Overrun
from .null_check import VALVE_ENABLED, is_null, look_at_null
from .scaling import bring_to_scale

_COMMAND: Final = FAST_OUTPUTS.index("command_V")
_VALVE_ENABLE: Final = FAST_OUTPUTS.index("valve_enable")
_HOST_COUNTER: Final = FAST_OUTPUTS.index("host_counter")
_RESET_LAMP: Final = FAST_OUTPUTS.index("reset_lamp")
_REARM: Final = FAST_OUTPUTS.index("rearm")
_POSITION: Final = FAST_INPUTS.index("position_m")
_ENCODER_FAULT: Final = FAST_INPUTS.index("encoder_fault")
_DEVICE_COUNTER: Final = FAST_INPUTS.index("device_counter")
_METERS: Final = len(METERS)
_METERS_AT: Final = READING_COUNT - _METERS
_STATUS_AT: Final = len(TIMINGS)
_STATUS_COUNT: Final = len(STATUS)
_SLOW_AT: Final = _STATUS_AT + _STATUS_COUNT
_DECIDED: Final = len(DECIDED)

_COUNTER_SPAN: Final = 65536
"""Number of values of `host_counter`, which counts modulo this."""
_CONFIRM_NS: Final = 200_000_000
"""Time in ns within which the device must confirm null after a trip, and confirm it again and
again; otherwise another connection brings it there."""
_S_PER_NS: Final = 1e-9
_NOT_EXCHANGED: Final = -1
_NOT_DONE: Final = (nan, nan, nan, nan, nan, float(_NOT_EXCHANGED))
"""The measured timings of a tick that did not take place."""


@njit(cache=True, error_model="numpy", nogil=True)
def wire_ticks(course, earlier, filt, interlock, pace, fd, plan, look, memory, shared):
    """Run one segment until another one, or another control, is asked for; return why, a `Left`.

    Args:
        course: the segment, `Course`.
        earlier: its control before the last change of it, `Earlier`.
        filt: the filter, `CompiledFilter`; updated. The first sample with position and both
            pressures starts it and the segment.
        interlock: `Interlock`; its memory is updated.
        pace: `Pace`.
        fd: descriptor of the device's connection; below 0 nothing is exchanged or checked.
        plan: plan of the driver, whose class has the exchange; see `rig.io.driver.Plan`.
        look: plan that reads the device and writes no output.
        memory: `WireMemory`, the same for all segments of a session; updated.
        shared: the board, `Board`; updated.
    """
    words, counts, outputs = shared.words, memory.counts, memory.outputs
    at = STATES_AT + filt.x.size + DECISION_COLUMNS
    tick, started, action, held = begin_or_go_on(course, outputs[_COMMAND], words, memory)
    while load_acquire(words, Word.SWITCH.value) == course.number:
        if words[Word.CHANGE] != course.change:
            return left_for(tick, started, action, held, memory)
        due, woken, missed = _wait_for_tick(counts, pace)
        words[Word.MISSED] += missed
        # Words of other processes are read before any command: this one may have been stopped.
        cause = _cause_at_wakeup(words, counts, woken, missed, pace)
        if cause != Cause.NONE.value:
            _trip(words, cause, NO_CHANNEL, woken)
        action = max(action, words[Word.STOP])
        _take_decision(course.number, counts, memory, shared)
        # A missed tick has no row if the time grid moves, or before the first whole sample.
        skipped = missed if started and pace.overrun != Overrun.REALIGN else 0
        now = tick + skipped

        taken = react(course.on_fault, memory.decided, now * pace.period_s, memory.reaction)
        if taken == Reaction.TRIP:
            _trip(words, Cause.FAULT_CONFIRMED.value, NO_CHANNEL, woken)
        # Rows of missed ticks come from before a skip.
        passed = words[Word.LEAD]
        place = now + take_skip(course, now, action, memory, words)
        drive = _drive(course, place, action, taken, words)
        command = allowed_command(
            _command(drive, course, earlier, filt, place, pace, interlock.limits, memory, words),
            words[Word.HOMED] != 0,
            interlock.tolerances, interlock.memory,
        )  # fmt: skip
        enable = _enable(drive, course, place, pace, memory, words)
        leaves = counts[Count.LEAVE] != 0
        if leaves:
            command, enable = 0.0, 0.0
        previous, begun, sent, status = outputs[_COMMAND], woken, 0, _NOT_EXCHANGED
        if fd >= 0 and (now % pace.every == 0 or enable == 0.0):
            if enable == 0.0 and counts[Count.NULL_NS] != 0:
                look_at_null(fd, look, interlock.tolerances, pace, memory)
            begun = monotonic_ns()
            status, sent = _exchange(fd, plan, command, enable, course, pace, memory, words)
        ended = monotonic_ns()
        if leaves:
            return Left.ASKED.value
        if status == ExchangeStatus.DISCONNECTED.value:
            _trip(words, Cause.EXCHANGE_LOST.value, NO_CHANNEL, ended)

        memory.reading[:] = nan
        # This is a variable because numba would compile the row once more for a constant.
        starts = not started
        for k in range(tick, now):
            was = k + passed
            setpoint = setpoint_of(_drive(course, was, action, taken, words), course, was, memory)
            row = _begin_row(k, setpoint, previous, held, starts, filt, pace, memory, shared)
            _end_row(row, at, _NOT_DONE, course, k, was, action, memory, shared, woken, pace)
            held = previous
        tick = now

        fresh = status == ExchangeStatus.OK.value
        if fresh:
            _take_sample(course.offset, ended, memory, words)
        # A filter can start from position and both pressures.
        whole = not isnan(memory.reading[0] + memory.reading[1] + memory.reading[2])
        starts = not started and whole
        started = started or starts
        setpoint = setpoint_of(drive, course, place, memory)
        command = outputs[_COMMAND]
        if started:
            row = _begin_row(tick, setpoint, command, held, starts, filt, pace, memory, shared)
        else:
            row = _waiting_row(setpoint, command, pace, memory, shared)
        held = command
        if fd >= 0:
            age = (ended - counts[Count.SAMPLED_NS]) // pace.period_ns
            seen = Tick(
                memory.inputs, fresh, missed + 1, (ended - begun) / pace.period_ns, age, command,
                outputs[_HOST_COUNTER], counts[Count.DRIVEN] != 0, words[Word.HOMED] != 0,
                error_of(drive, setpoint, course, memory), course.number, tick, place,
            )  # fmt: skip
            judged, cause, channel = check_sample(seen, interlock)
            if judged == Action.TRIP.value and words[Word.LOOP_TRIP] == 0:
                _trip(words, cause, channel, ended)
                _exchange(fd, plan, 0.0, 0.0, course, pace, memory, words)
            action = _acted_upon(judged, cause, channel, action, words)
        done = monotonic_ns()
        timing = (
            _S_PER_NS * (woken - due),
            nan if sent == 0 else _S_PER_NS * (sent - due),
            nan if status == _NOT_EXCHANGED else _S_PER_NS * (ended - begun),
            _S_PER_NS * (done - ended),
            _S_PER_NS * (ended - counts[Count.SAMPLED_NS]), float(status),
        )  # fmt: skip
        _end_row(row, at, timing, course, tick if started else -1, place, action, memory, shared,
                 woken, pace)  # fmt: skip
        if started:
            tick += 1
        words[Word.TICK] = tick
        words[Word.LOOP_BEAT] = done
        if fd >= 0 and _is_unconfirmed(status, done, counts, words, pace):
            return Left.UNCONFIRMED.value
    return Left.SWITCHED.value


@inner
def _wait_for_tick(counts, pace):
    """Sleep to the next tick; return when it was due, when the loop woke, and how many were missed.

    The two times are in ns on CLOCK_MONOTONIC. A tick counts as missed if it cannot begin before
    half its period has passed, so that two exchanges are never less than half a period apart.
    """
    due, missed = counts[Count.DUE_NS], 0
    if due == 0:
        due = monotonic_ns() + pace.period_ns
        counts[Count.SAMPLED_NS] = due
    while True:
        sleep_until(due)
        woken = monotonic_ns()
        late = (woken - due + pace.period_ns // 2) // pace.period_ns
        if late <= 0:
            break
        missed += late
        due = woken if pace.overrun == Overrun.REALIGN else due + late * pace.period_ns
    counts[Count.DUE_NS] = due + pace.period_ns
    return due, woken, missed


@inner
def _cause_at_wakeup(words, counts, now, missed, pace):
    """Return the cause for which other processes or the clock make the loop trip, or `NONE`."""
    if words[Word.FIELD_TRIP] != 0:
        return words[Word.FIELD_TRIP]
    if words[Word.SUPERVISOR_TRIP] != 0:
        return words[Word.SUPERVISOR_TRIP]
    if words[Word.STOP] == Action.TRIP:
        return Cause.OPERATOR_STOP.value
    if _is_silent(words[Word.SUPERVISOR_BEAT], now, pace.supervisor_ns):
        return Cause.SUPERVISOR_LOST.value
    if _is_silent(words[Word.FIELD_BEAT], now, pace.field_ns):
        return Cause.FIELD_LOST.value
    if _is_silent(words[Word.RECORDER_BEAT], now, pace.recorder_ns):
        return Cause.RECORDER_LOST.value
    if counts[Count.DRIVEN] == 0:
        return Cause.NONE.value
    if pace.overrun == Overrun.TRIP and missed >= pace.trip_after:
        return Cause.OVERRUN.value
    if missed > 0 and now - counts[Count.SAMPLED_NS] > pace.stale_ns:
        # The loop also misses ticks while it waits for a reply; its own pause is between two ticks.
        paused = now - words[Word.LOOP_BEAT] > 2 * pace.period_ns
        return Cause.OVERRUN.value if paused else Cause.STALE_SAMPLE.value
    return Cause.NONE.value


@inner
def _take_decision(segment, counts, memory, shared):
    """Copy the newest decision, if it is new, to `memory.decided`, if it is about this segment.

    A decision that may have been overwritten while it was copied is left for the next tick.
    """
    number = load_acquire(shared.words, Word.DECISIONS.value)
    if number == counts[Count.DECISION]:
        return
    place = shared.decisions[number % DECISIONS_KEPT]
    for i in range(place.size):
        memory.posted[i] = place[i]
    # After so many newer decisions, the place may have been overwritten while it was copied.
    if load_acquire(shared.words, Word.DECISIONS.value) - number >= DECISIONS_KEPT - 1:
        return
    counts[Count.DECISION] = number
    if memory.posted[0] == segment:
        for i in range(_DECIDED):
            memory.decided[i] = memory.posted[1 + i]


@inner
def _is_silent(beat, now, limit):
    """Return whether the last beat, if there was one, is over `limit` ns ago; 0: no limit."""
    return limit > 0 and beat != 0 and now - beat > limit


@inner
def _trip(words, cause, channel, now):
    """Latch a trip with its cause on the board, unless a trip is latched already."""
    if words[Word.LOOP_TRIP] == 0:
        words[Word.LOOP_TRIP_AT] = now
        words[Word.ACTION] = Action.TRIP.value
        words[Word.ACTION_CAUSE] = cause
        words[Word.ACTION_CHANNEL] = channel
        store_release(words, Word.LOOP_TRIP.value, cause)


@inner
def _acted_upon(judged, cause, channel, action, words):
    """Return the segment's action from now on: `action`, or `judged` if that is worse.

    An INDICATE does not change it; after a trip it is TRIP. If `judged` is worse than `action`, or
    both are NONE, it is put on the board with its cause and channel.
    """
    if words[Word.LOOP_TRIP] != 0:
        return Action.TRIP.value
    if judged > action or judged == Action.NONE.value == action:
        words[Word.ACTION] = judged
        words[Word.ACTION_CAUSE] = cause
        words[Word.ACTION_CHANNEL] = channel
    return max(action, judged) if judged >= Action.HOLD.value else action


@inner
def _drive(course, place, action, taken, words):
    """Return the `Drive` at a place: that of the course, unless an action or reaction changes it.

    Args:
        course: the segment.
        place: index in the segment's setpoints.
        action: `Action` of the interlock or of the operator.
        taken: present `Reaction` to a confirmed fault.
        words: words of the board.
    """
    if taken == Reaction.HOLD:
        action = max(action, Action.HOLD.value)
    if words[Word.LOOP_TRIP] != 0 or course.drive == Drive.NULL:
        return Drive.NULL.value
    if action >= Action.RAMP_DOWN.value:
        return Drive.RAMP_DOWN.value
    if course.drive == Drive.TRACK and place < course.setpoint.size and action < Action.HOLD.value:
        return Drive.TRACK.value
    return Drive.HOLD.value


@inner
def _command(drive, course, earlier, filt, place, pace, limits, memory, words):
    """Return the command in V at a place in the segment's setpoints, as `drive` asks.

    When a hold or a ramp down begins, note in `memory.handling` where it does.
    """
    handling, position = memory.handling, memory.encoder[0] + course.offset
    if drive == Drive.TRACK:
        setpoint, limit = wanted_at(course, place, memory), course.limit
        if course.open_loop:
            return limited_command(True, setpoint, position, course.gain, limit)
        command = tracked_command(course, earlier, setpoint, place, position, pace.period_s, memory)
        return tolerating(command, course.on_fault, memory.decided, filt.x, filt.parameters, limit,
                          pace.period_s, memory.reaction)  # fmt: skip
    if drive == Drive.HOLD:
        if isnan(handling[Handling.HELD_AT]):
            handling[Handling.HELD_AT] = held_position(position, words[Word.HOMED] != 0, limits)
        setpoint = handling[Handling.HELD_AT]
        return limited_command(False, setpoint, position, course.gain, course.limit)
    if drive == Drive.RAMP_DOWN:
        if isnan(handling[Handling.RAMP_FROM]):
            handling[Handling.RAMP_FROM] = memory.outputs[_COMMAND]
            handling[Handling.RAMP_TICK] = place
        return handling[Handling.RAMP_FROM] * _ramp_left(place, pace, memory)
    return 0.0


@inner
def _ramp_left(place, pace, memory):
    """Return the part of the ramp down that is still ahead, from 1 to 0."""
    return max(1.0 - (place - memory.handling[Handling.RAMP_TICK]) / pace.ramp_ticks, 0.0)


@inner
def _enable(drive, course, place, pace, memory, words):
    """Return 1.0 if the valve is to be enabled at a place, else 0.0.

    It is not after a trip, at the end of a ramp down, or unless the course enables it.
    """
    if words[Word.LOOP_TRIP] != 0:
        return 0.0
    if drive == Drive.RAMP_DOWN and _ramp_left(place, pace, memory) == 0.0:
        return 0.0
    return course.valve_enable


@inner
def _exchange(fd, plan, command, enable, course, pace, memory, words):
    """Write command and enabling to the device, and read `memory.inputs` from it, in one exchange.

    The counts in `memory` and the words of the board that follow from it are updated, such as that
    the device has confirmed null after a trip. The inputs are brought to the scale of the rig, and
    the command leaves with the sign of the valve's wiring.

    Returns:
        The `ExchangeStatus`, and the time in ns at which the command left, 0 if it did not.
    """
    outputs, counts = memory.outputs, memory.counts
    counts[Count.SEQUENCE] += 1
    counts[Count.WRITTEN] += 1
    outputs[_COMMAND] = memory.corrections.command_sign[0] * command
    outputs[_VALVE_ENABLE] = enable
    outputs[_HOST_COUNTER] = counts[Count.WRITTEN] % _COUNTER_SPAN
    outputs[_RESET_LAMP] = course.reset_lamp
    outputs[_REARM] = course.rearm
    deadline = monotonic_ns() + pace.timeout_ns
    status, sent = exchange(fd, plan, counts[Count.SEQUENCE], outputs, memory.inputs, deadline)
    outputs[_COMMAND] = command
    if status >= ExchangeStatus.FOREIGN_WRITE.value:
        _trip(words, Cause.FOREIGN_MASTER.value, NO_CHANNEL, monotonic_ns())
        if status == ExchangeStatus.FOREIGN_WRITE.value:
            status = ExchangeStatus.OK.value  # its sample is sound
    enabled = memory.inputs[VALVE_ENABLED]
    if enable == 0.0:
        counts[Count.DRIVEN] = 0
    else:
        counts[Count.NULL_NS] = counts[Count.SETTLED] = counts[Count.AWAY] = 0
    if status != ExchangeStatus.OK:
        words[Word.EXCHANGE_ERRORS] += 1
        return status, sent
    bring_to_scale(memory.inputs, course.offset, memory.corrections)
    if enable == 1.0 and enabled != 0.0:
        counts[Count.DRIVEN] = 1
    if enable == 0.0 and is_null(memory.inputs):
        counts[Count.NULL_NS] = monotonic_ns()
        if words[Word.LOOP_TRIP] != 0 and words[Word.VALVE_NULL_AT] == 0:
            words[Word.VALVE_NULL_AT] = counts[Count.NULL_NS]
    return status, sent


@inner
def _is_unconfirmed(status, now, counts, words, pace):
    """Return whether, after a trip, this connection does not confirm that the valve is at null.

    A valve that was confirmed at null counts as being there while the device is silent, for as long
    as a device may be silent without a trip. So a process that was stopped for a moment goes on.
    """
    if words[Word.LOOP_TRIP] == 0:
        return False
    if status == ExchangeStatus.DISCONNECTED:
        return True
    since = now - max(words[Word.LOOP_TRIP_AT], counts[Count.NULL_NS])
    is_denied = status == ExchangeStatus.OK or words[Word.VALVE_NULL_AT] == 0
    return since > _CONFIRM_NS and (is_denied or since > pace.stale_ns)


@inner
def _take_sample(offset, now, memory, words):
    """Copy the inputs to the reading, unless the device has taken no sample since the last one.

    If the device reports an encoder fault with the sample, the ram is no longer homed.
    """
    inputs = memory.inputs
    if inputs[_DEVICE_COUNTER] == memory.device_counter[0]:
        return
    memory.device_counter[0] = inputs[_DEVICE_COUNTER]
    memory.counts[Count.SAMPLED_NS] = now
    for i in range(READING_COUNT):
        memory.reading[i] = inputs[i]
    if not isnan(inputs[_POSITION]):
        memory.encoder[0] = inputs[_POSITION] - offset
    if inputs[_ENCODER_FAULT] == 1.0:
        words[Word.HOMED] = 0


@inner
def _begin_row(tick, setpoint, command, held, starts, filt, pace, memory, shared):
    """Update the filter by `memory.reading`; return the ring's next row, filled by `sample_row`.

    Readers of the ring do not see the row before `_end_row`.
    """
    row = shared.ring[shared.words[Word.ROWS] % shared.ring.shape[0]]
    sample_row(
        starts, (tick * pace.period_s, setpoint, command), held, memory.reading, filt,
        memory.decided, memory.reaction.acted, row,
    )  # fmt: skip
    return row


@inner
def _waiting_row(setpoint, command, pace, memory, shared):
    """Return the ring's next row for a tick before the first whole sample, without estimates.

    Its time is one period before 0.
    """
    row = shared.ring[shared.words[Word.ROWS] % shared.ring.shape[0]]
    row[:] = nan
    row[0] = -pace.period_s
    row[1] = setpoint
    row[2] = command
    for i in range(READING_COUNT):
        row[READINGS_AT + i] = memory.reading[i]
    return row


@inner
def _end_row(row, at, timing, course, tick, place, action, memory, shared, now, pace):
    """Fill the row from column `at` on, and count it on the board, so that readers see it.

    Args:
        row: the row that `_begin_row` or `_waiting_row` returned.
        at: index of the first column of `TIMINGS`.
        timing: the measured timings, the first `MEASURED` of these columns.
        course: the segment; its number is recorded while its setpoints last, else -1.
        tick: number of the tick in the segment, -1 before its start.
        place: index in the segment's setpoints.
        action: `Action` of the segment.
        memory: `WireMemory`, for the status inputs, which are NaN without an exchange.
        shared: the board.
        now: time on CLOCK_MONOTONIC in ns, by which slow values that are too old become NaN.
        pace: `Pace`, for the greatest age of slow values.
    """
    words = shared.words
    for i in range(MEASURED):
        row[at + i] = timing[i]
    row[at + MEASURED] = course.number if 0 <= tick <= place < course.setpoint.size else -1.0
    row[at + MEASURED + 1] = tick
    row[at + MEASURED + 2] = action
    for i in range(_STATUS_COUNT):
        known = timing[MEASURED - 1] != _NOT_EXCHANGED
        row[at + _STATUS_AT + i] = memory.inputs[READING_COUNT + i] if known else nan
    for i in range(shared.slow.size):
        value = shared.slow[i]
        if now - shared.slow_at[i] > pace.slow_stale_ns:
            value = nan
        if i >= _METERS:
            row[at + _SLOW_AT + i - _METERS] = value
        elif isnan(row[READINGS_AT + _METERS_AT + i]):
            row[READINGS_AT + _METERS_AT + i] = value
    store_release(words, Word.ROWS.value, words[Word.ROWS] + 1)
