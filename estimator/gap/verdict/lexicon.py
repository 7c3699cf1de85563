"""This module names a disturbance by its shape, in an engineer's words.

A shape has a name, parts of a rig that make it, and an experiment that would confirm it. It says
how a disturbance looks, not what its cause is.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Addition, Array, Plant

LOCAL: Final = 0.4
"""Part of a quantity's range; a table that is large in less of it is local."""
BENT: Final = 0.15
"""Part of a table's reach by which it must leave a straight line for a bend to be named."""


@dataclass(frozen=True)
class Word:
    """An entry of the lexicon.

    Attributes:
        name: name of the shape.
        says: what the disturbance does, to be followed by its place.
        parts: parts of a rig that make such a shape, likeliest first.
        experiment: what to run to confirm it.
    """

    name: str
    says: str
    parts: str
    experiment: str


_SLOW: Final = "slow strokes over the whole length, both ways"
LEXICON: Final = {
    word.name: word
    for word in (
        Word("constant", "is constant", "a weight, a zero that is off, or a leak",
             "the same motion with another load, and a rest at both ends"),
        Word("periodic_in_position", "repeats along the stroke",
             "cogging of a motor or rack, a screw, or an encoder that is eccentric",
             f"{_SLOW}, at two speeds: the pitch stays the same in mm"),
        Word("local_in_position", "acts at one place of the stroke",
             "a tight spot, a worn or scored bore, or a damaged piece of the scale",
             f"{_SLOW}, through that place"),
        Word("grows_with_pressure", "grows with the pressure",
             "a seal that is pressed on, or a part that gives way under pressure",
             "the same motion at two supply pressures"),
        Word("power_of_velocity", "grows with a power of the velocity",
             "drag of oil in a line or port, or a damper", "strokes at three speeds"),
        Word("depends_on_velocity", "goes with the velocity",
             "friction of another form than the model's, or drag", "ramps from creep to full speed"),
        Word("depends_on_position", "goes with the position",
             "a spring, a stroke whose bore changes, or a scale that is not straight", _SLOW),
        Word("depends_on_pressure", "goes with the pressure",
             "air in the oil, a hose, or a transducer that is not straight",
             "the same motion at two supply pressures"),
        Word("depends_on_opening", "goes with the opening of the valve",
             "edges of the spool that are not square, or worn", "slow strokes through null"),
        Word("threshold", "begins at a threshold",
             "a relief or check valve that opens, a stop, or a spring that is met",
             "a motion that passes the threshold slowly"),
        Word("tone", "is a tone", "a pump, a pulsation damper, or electrical hum",
             "a rest with the pump on, then off"),
        Word("trend", "drifts with time", "oil that warms, or an amplifier that drifts",
             "the same motion cold and warm"),
        Word("step_in_time", "changes at one moment", "something that came loose, or slipped",
             "the same motion again: it stays as it was at the end"),
        Word("lag", "is late", "a line, a filter, or slow electronics", "steps and fast sines"),
        Word("resonance", "rings", "a pilot stage, a mass on a spring, or a line",
             "a sweep through its frequency"),
        Word("random_delay", "comes at random times",
             "a bus or a controller that is overloaded", "small steps, many of them"),
        Word("play", "follows with play", "a worn joint or a spool that sticks",
             "small reversals"),
        Word("saturation", "stops growing", "an amplifier or a valve at its end",
             "large and small steps"),
        Word("stuck_channel", "does not follow", "a transducer or cable that failed",
             "a look at the channel alone"),
        Word("mixed_up_channel", "is that of another channel", "cables that are swapped",
             "a look at the cables"),
    )
}  # fmt: skip


def shape_of(addition: Addition, low: float, high: float) -> str:
    """Return the name of an addition's shape, from its form and what it depends on.

    Args:
        addition: the disturbance.
        low: least value of its quantity in the recordings, SI.
        high: greatest value.
    """
    of, form = addition.of, addition.form
    if form == "wave":
        return "tone" if of == "time" else "periodic_in_position"
    if form == "bump":
        return "local_in_position" if of == "position" else _general(of)
    if form == "hinge":
        return "threshold"
    if not of or form == "constant":
        return "constant"
    x = np.linspace(low, high, 201)
    y = addition.shape(x)
    if of == "time":
        return "step_in_time" if _is_step(x, y) else "trend"
    if form == "table":
        return _of_table(of, x, y)
    if of == "velocity" and form in ("x^2", "x |x|"):
        return "power_of_velocity"
    if of.startswith("pressure") and float(np.ptp(np.abs(y))) > 0.0:
        return "grows_with_pressure"
    return _general(of)


def _general(of: str) -> str:
    if of.startswith("pressure"):
        return "depends_on_pressure"
    if of in ("velocity", "direction"):
        return "depends_on_velocity"
    if of in ("spool opening", "command"):
        return "depends_on_opening"
    return "depends_on_position" if of == "position" else "constant"


def _of_table(of: str, x: Array, y: Array) -> str:
    """Return the name of the shape of a table with values y (n,) at evenly spaced places x (n,)."""
    reach = float(np.ptp(y))
    if not reach > 0.0:
        return "constant"
    if reach < BENT * float(np.abs(y).max()):
        return "constant"
    edge = 0.5 * (y[0] + y[-1])
    away = np.abs(y - edge)
    if of == "position":
        near = float(np.mean(away > 0.5 * away.max()))
        ends = abs(y[0] - y[-1]) < 0.5 * away.max()
        return "local_in_position" if near < LOCAL and ends else "depends_on_position"
    if of.startswith("pressure"):
        if _is_hinge(x, y):
            return "threshold"
        rising = float(np.mean(np.diff(np.abs(y)) >= -0.02 * reach))
        return "grows_with_pressure" if rising > 0.8 else "depends_on_pressure"
    if of == "velocity":
        speeds = np.abs(x)
        curved = np.column_stack([np.sign(x) * speeds**2, np.ones_like(x)])
        rest = y - curved @ np.linalg.lstsq(curved, y, rcond=None)[0]
        if float(np.var(rest)) < BENT * float(np.var(y)):
            return "power_of_velocity"
    if of == "command" and _is_flat_outside(x, y):
        return "saturation"
    return _general(of)


def _is_hinge(x: Array, y: Array) -> bool:
    """Return whether a curve is flat at first and then rises, much better than a straight line."""
    line = np.column_stack([x, np.ones_like(x)])
    straight = float(np.sum((y - line @ np.linalg.lstsq(line, y, rcond=None)[0]) ** 2))
    best = straight
    for at in x[30:-20:10]:
        bent = np.column_stack([np.maximum(x - at, 0.0), np.ones_like(x)])
        best = min(best, float(np.sum((y - bent @ np.linalg.lstsq(bent, y, rcond=None)[0]) ** 2)))
    return best < 0.3 * straight and straight > 0.02 * float(np.sum((y - y.mean()) ** 2))


def _is_step(x: Array, y: Array) -> bool:
    """Return whether a course in time is one step, much better than a straight line."""
    line = np.column_stack([x, np.ones_like(x)])
    straight = float(np.sum((y - line @ np.linalg.lstsq(line, y, rcond=None)[0]) ** 2))
    steps = (
        float(np.sum((y[:k] - y[:k].mean()) ** 2) + np.sum((y[k:] - y[k:].mean()) ** 2))
        for k in range(20, len(y) - 20, 5)
    )
    return min(steps) < 0.5 * straight


def _is_flat_outside(x: Array, y: Array) -> bool:
    """Return whether a curve rises in the middle and is flat at both ends."""
    third = len(x) // 4
    middle = abs(float(y[2 * third] - y[third])) + abs(float(y[3 * third] - y[2 * third]))
    ends = abs(float(y[third] - y[0])) + abs(float(y[-1] - y[3 * third]))
    return ends < 0.25 * middle


def sentence(addition: Addition, word: Word, plant: Plant, low: float, high: float) -> str:
    """Return what a disturbance is, in one sentence with units, and what makes it.

    Args:
        addition: the disturbance.
        word: its entry in the lexicon.
        plant: plant that it belongs to.
        low: least value of its quantity in the recordings, SI.
        high: greatest value.
    """
    unit, factor = unit_of(addition.place, plant)
    x = np.linspace(low, high, 201) if addition.of else np.zeros(1)
    y = addition.shape(x)
    top = int(np.argmax(np.abs(y)))
    of_unit, of_factor = quantity_unit(addition.of, plant)
    size = f"{y[top] * factor:.3g} {unit}".strip()
    what = f"{addition.place}: a disturbance that {word.says}"
    if addition.form == "wave":
        pitch = f"{addition.at[0] * of_factor:.4g} {of_unit}"
        what += f", {abs(addition.values[0]) * factor:.3g} {unit} with a pitch of {pitch}"
    elif addition.form == "hinge":
        begins = f"{addition.at[0] * of_factor:.4g} {of_unit}"
        what += f", from {addition.of} {begins} on; up to {size}"
    elif addition.of:
        at = f"{x[top] * of_factor:.4g} {of_unit}"
        what += f" ({addition.of}{' and the direction' if addition.times else ''}), {size} at {at}"
    else:
        what += f", {size}"
    return f"{what}. It could be {word.parts}."


def unit_of(place: str, plant: Plant) -> tuple[str, float]:
    """Return the unit in which a disturbance of a place is shown, and its number in one SI unit."""
    for equation in plant.equations:
        if equation.name == place:
            return equation.shown
    for varying in plant.varying:
        if varying.name == place:
            return varying.shown
    for output in plant.outputs:
        if place == f"reading of {output.channel}":
            return output.shown or (output.unit, 1.0)
    return "", 1.0


def si_unit_of(place: str, plant: Plant) -> str:
    """Return the SI unit of a disturbance of a place."""
    places = {
        **{each.name: each.unit for each in plant.equations},
        **{each.name: each.unit for each in plant.varying},
        **{f"reading of {each.channel}": each.unit for each in plant.outputs},
    }
    return places.get(place, "")


def quantity_unit(of: str, plant: Plant) -> tuple[str, float]:
    """Return the unit in which a quantity is shown, and its number in one SI unit."""
    if of in plant.regions:
        return plant.regions[of].shown
    return ("s", 1.0) if of == "time" else ("", 1.0)


_LEAKING: Final = {"flow, chamber 1": ("pressure 1", -1.0), "flow, chamber 2": ("pressure 2", -1.0)}
_ACROSS: Final = "leak across the piston"


def is_leak(addition: Addition, low: float, high: float) -> bool:
    """Return whether an addition takes oil out of a chamber and grows with a pressure.

    An opening across the piston does so wherever it is: what passes it grows with the difference of
    the pressures. A flow does so if less comes in, or more goes out, at higher pressures.
    """
    if addition.place == _ACROSS:
        return True
    if addition.place not in _LEAKING:
        return False
    pressure, sign = _LEAKING[addition.place]
    if addition.of != pressure:
        return False
    x = np.linspace(low, high, 101)
    y = sign * addition.shape(x)
    slope = float(np.polyfit(x, y, 1)[0])
    return slope > 0.0 and bool(y.max() > 0.0)
