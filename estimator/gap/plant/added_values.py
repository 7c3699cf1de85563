"""Compiled functions that compute what the additions in a model's slots add, sample by sample."""

from math import copysign, exp, pi, sin
from typing import Final

from numba import float64, int64, void

from rig.jit import njit
from rig.plant import inlined

from .additions import (
    BEYOND,
    CONSTANT_OF,
    EXTENSION,
    IN_EQUATION,
    IN_PARAMETER,
    IN_READING,
    KNOTS,
    LAG,
    NOWHERE,
    PLAY,
    RESONANCE,
    SLOTS,
    TABLE,
    TIME_OF,
    TONE,
    WIDTH,
    X_AT,
)
from .memories import (
    follow_lag,
    follow_play,
    follow_resonance,
    lag_behind,
    play_behind,
    resonance_behind,
)

_ADD: Final = void(EXTENSION, float64[::1], float64[::1], float64[:, ::1], int64, float64[::1])


@inlined
def _quantity(number, measured, time_s):
    """Return the quantity that a slot refers to by a number.

    It is 1 for `CONSTANT_OF`, the time for `TIME_OF`, else that element of `measured`.
    """
    if number == CONSTANT_OF:
        return 1.0
    if number == TIME_OF:
        return time_s
    return measured[int(number)]


@inlined
def _table(numbers, first, x):
    """Return the value at x of the table whose knots begin at index `first`.

    Between knots it is interpolated, and beyond the outermost ones it is constant.
    """
    if not x > numbers[first]:
        return numbers[first + KNOTS]
    for k in range(1, KNOTS):
        above = numbers[first + k]
        if x < above:
            below = numbers[first + k - 1]
            low, high = numbers[first + KNOTS + k - 1], numbers[first + KNOTS + k]
            return low + (high - low) * (x - below) / (above - below)
    return numbers[first + 2 * KNOTS - 1]


@inlined
def _shape(form, x, at, by):
    """Return the value at x of the form in symbols with the index `form` in `FORMS`, of size 1."""
    if form == BEYOND:
        return copysign(max(abs(x) - at, 0.0), x)
    if form == 0:
        return 1.0
    if form == 1:
        return x
    if form == 2:
        return abs(x)
    if form == 3:
        return x * x
    if form == 4:
        return x * abs(x)
    if form == 5:
        return sin(2.0 * pi * x / at + by)
    if form == 6:
        return exp(-min(((x - at) / by) ** 2, 700.0))
    return max(x - at, 0.0)


@njit(
    float64(float64[::1], int64, float64[::1], float64[::1], float64, float64, int64),
    cache=True, error_model="numpy",
)  # fmt: skip
def added_value(parameters, first, measured, followed, time_s, period, recording):
    """Return the disturbance of the slot whose numbers begin at `first`, SI.

    Args:
        parameters: float64 (parameters,), the plant's own and the slots.
        first: index of the slot's first number.
        measured: float64 (quantities and rates,), of `Plant.measures`.
        followed: float64 (FOLLOWED,), what the slot remembers of its quantity (`memories`).
        time_s: time since the recording began, s.
        period: sampling period, s.
        recording: number of the recording.
    """
    x = _quantity(parameters[first + 2], measured, time_s)
    form = int(parameters[first + 4])
    knots = first + X_AT
    if form == TABLE:
        value = _table(parameters, knots, x)
    elif form == TONE:
        phase = parameters[knots + 1 + recording]
        value = 0.0
        if phase != 0.0:
            value = parameters[knots + KNOTS] * sin(2.0 * pi * x / parameters[knots] + phase)
    elif form == LAG:
        behind = lag_behind(x, parameters[knots], period, followed)
        value = parameters[knots + KNOTS] * behind
    elif form == RESONANCE:
        behind, speed = resonance_behind(
            x, parameters[knots], parameters[knots + 1], period, followed
        )
        value = parameters[knots + KNOTS] * behind + parameters[knots + KNOTS + 1] * speed
    elif form == PLAY:
        value = parameters[knots + KNOTS] * play_behind(x, parameters[knots], followed)
    else:
        value = parameters[knots + KNOTS] * _shape(
            form, x, parameters[knots], parameters[knots + 1]
        )
    return value * _quantity(parameters[first + 3], measured, time_s)


@inlined
def _of_slot(extension, parameters, measured, followed, t, slot):
    """Return the disturbance of a slot in sample `t`, SI (`added_value`)."""
    time_s = extension.time_s + t * extension.period
    first = extension.own + slot * WIDTH
    return added_value(
        parameters, first, measured, followed[slot], time_s, extension.period, extension.recording
    )


@njit(_ADD, cache=True, error_model="numpy")
def add_to_parameters(extension, parameters, measured, followed, t, present):
    """Write to `present` those parameters of sample `t` to which slots add something.

    What is written is the value in `parameters` and what the slots add. All other parameters must
    be in `present` already.
    """
    for slot in range(SLOTS):
        first = extension.own + slot * WIDTH
        if parameters[first] == IN_PARAMETER:
            for k in range(2):
                changed = extension.changed[int(parameters[first + 1]), k]
                if changed >= 0:
                    present[changed] = parameters[changed]
    for slot in range(SLOTS):
        first = extension.own + slot * WIDTH
        if parameters[first] == IN_PARAMETER:
            added = _of_slot(extension, parameters, measured, followed, t, slot)
            for k in range(2):
                changed = extension.changed[int(parameters[first + 1]), k]
                if changed >= 0:
                    present[changed] += added


@njit(_ADD, cache=True, error_model="numpy")
def add_to_readings(extension, parameters, measured, followed, t, readings):
    """Add the disturbances of slots that enter readings to the readings (outputs,) of sample `t`.

    The readings are changed in place.
    """
    for slot in range(SLOTS):
        first = extension.own + slot * WIDTH
        if parameters[first] == IN_READING:
            added = _of_slot(extension, parameters, measured, followed, t, slot)
            readings[int(parameters[first + 1])] += added


@njit(_ADD, cache=True, error_model="numpy")
def add_to_state(extension, parameters, measured, followed, t, state):
    """Add what slots that enter equations change in one sample to the state (states,) after a step.

    The state is changed in place. `measured` has the quantities and rates of the state before the
    step of sample `t`.
    """
    for slot in range(SLOTS):
        first = extension.own + slot * WIDTH
        if parameters[first] == IN_EQUATION:
            added = _of_slot(extension, parameters, measured, followed, t, slot)
            equation = int(parameters[first + 1])
            for k in range(2):
                kicked = extension.kicked[equation, k]
                if kicked >= 0:
                    rate = measured[extension.quantities + 2 * equation + k]
                    state[kicked] += rate * added


@njit(
    void(EXTENSION, float64[::1], float64[::1], float64[::1], float64[:, ::1]),
    cache=True, error_model="numpy",
)  # fmt: skip
def remember_quantities(extension, parameters, before, after, followed):
    """Advance in place what slots remember of their quantities (SLOTS, FOLLOWED) by one sample.

    `before` and `after` have the quantities at the beginning and the end of the sample, with the
    inputs of the sample. Slots that remember nothing are left as they are.
    """
    for slot in range(SLOTS):
        first = extension.own + slot * WIDTH
        if parameters[first] == NOWHERE:
            continue
        x = _quantity(parameters[first + 2], before, 0.0)
        y = _quantity(parameters[first + 2], after, 0.0)
        form, at = int(parameters[first + 4]), first + X_AT
        if form == LAG:
            follow_lag(x, y, parameters[at], extension.period, followed[slot])
        elif form == RESONANCE:
            follow_resonance(
                x, y, parameters[at], parameters[at + 1], extension.period, followed[slot]
            )
        elif form == PLAY:
            follow_play(x, y, parameters[at], followed[slot])
