"""This module names a disturbance by its shape, in an engineer's words.

A shape has a name, parts of a rig that make it, and an experiment that would confirm it. It says
how a disturbance looks, not what its cause is. `sentences` puts a disturbance into a sentence.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import DIRECTION, MEMORIES, TIME_NAME, Addition, Array, Plant

from .sentences import si_unit_of

LOCAL: Final = 0.4
"""Part of a quantity's range; a table that is large in less of it is local."""
BENT: Final = 0.15
"""Part of a table's variance, or of its largest value, that counts as a mere ripple on a simpler
shape."""
_POINTS: Final = 201
"""Number of evenly spaced places at which a disturbance is looked at."""


@dataclass(frozen=True)
class Word:
    """An entry of the lexicon: what a shape means.

    Attributes:
        experiment: what to run to confirm it.
        parts: parts of a rig that make such a shape, likeliest first; those of a place of another
            kind than the attributes below, or of a kind whose attribute is empty.
        force: parts that make it in a place of the kind "force" (`kind_of`).
        flow: parts for the kind "flow".
        valve: parts for the kind "valve".
        edges: parts for the kind "edges".
        reading: parts for the kind "reading".
        oil: parts for the kind "oil".
        supply: parts for the kind "supply".
    """

    experiment: str
    parts: str
    force: str = ""
    flow: str = ""
    valve: str = ""
    edges: str = ""
    reading: str = ""
    oil: str = ""
    supply: str = ""


_SLOW: Final = "slow strokes over the whole length, both ways"
_TWO_SUPPLIES: Final = "the same motion at two supply pressures"
LEXICON: Final = {
    "constant": Word(
        "the same motion with another load, and a rest at both ends",
        "a value of the data sheet that does not hold",
        force="a weight, a preloaded spring, or a seal whose friction is other",
        flow="a leak, or a connection that is not shut",
        valve="a spool that is off its centre",
        edges="edges of the spool that are worn, or ground with another lap",
        reading="a transducer whose zero is off",
    ),
    "periodic_in_position": Word(
        f"{_SLOW}, at two speeds: the pitch stays the same",
        "something that turns as the ram moves",
        force="the teeth of a rack, the pitch of a screw, a shaft that is bent, or the poles of a "
        "motor",
        reading="an encoder whose wheel is eccentric, or the teeth that it runs on",
    ),
    "local_in_position": Word(
        f"{_SLOW}, through that place",
        "a damaged place of the stroke",
        force="a tight spot, a guide that is bent, or a seal that passes a burr",
        flow="a bore that is worn or scored there",
        reading="a damaged piece of the scale",
    ),
    "grows_with_pressure": Word(
        _TWO_SUPPLIES,
        "a part that gives way under pressure",
        force="a seal that is pressed on by the pressure",
        flow="a leak, or a hose that widens",
        reading="a transducer whose gain is off, or that is not linear",
        oil="air in the oil",
    ),
    "power_of_velocity": Word(
        "strokes at three speeds",
        "a flow through something narrow",
        force="drag of oil in a line or port, or a damper",
        flow="a narrow line or port",
    ),
    "depends_on_velocity": Word(
        "ramps from creep to full speed",
        "something that moves with the ram",
        force="friction whose course is other than the model's, or a damper",
        flow="a seal that carries oil along, or a piston area that is other",
        reading="a transducer that is late",
    ),
    "depends_on_position": Word(
        _SLOW,
        "something that changes along the stroke",
        force="a spring, a load that hangs over, or a bore that narrows",
        flow="a bore that is worn, or a volume other than the model's",
        reading="a scale that is not straight",
    ),
    "depends_on_pressure": Word(
        _TWO_SUPPLIES,
        "a part that gives way under pressure",
        force="seals that are pressed on, or unequal piston areas",
        flow="air in the oil, a hose, or a valve that opens",
        reading="a transducer that is not linear",
        oil="air in the oil, or a hose",
    ),
    "depends_on_opening": Word(
        "slow strokes through null",
        "the valve or its amplifier",
        flow="edges of the spool that are worn, or not square",
        valve="edges of the spool that are worn, or not square",
        edges="edges of the spool that are worn, or not square",
        reading="crosstalk of the valve's command into the transducer's cable",
    ),
    "depends_on_a_quantity": Word(
        "a motion in which this quantity changes and all others stay",
        "something that the model does not have",
    ),
    "threshold": Word(
        "a motion that passes the threshold slowly",
        "something that opens or is met there",
        force="a stop or a spring that is met, or a cushion",
        flow="a relief or check valve that opens",
        valve="a spool that is held until it is asked to go far",
    ),
    "tone": Word(
        "a rest with the pump on, then off",
        "hum of the mains, or a pump",
        flow="the strokes of a pump, or a pulsation damper",
        supply="the strokes of a pump, or a controller of it that hunts",
        force="a machine beside the rig, or something that turns on it",
    ),
    "trend": Word(
        "the same motion cold and warm",
        "oil that warms",
        reading="a transducer or amplifier that drifts",
        valve="an amplifier that drifts, or a valve that warms",
    ),
    "step_in_time": Word(
        "the same motion again: it stays as it was at the end",
        "something that came loose or slipped",
        reading="a transducer that was knocked, or a connector that slipped",
        flow="a leak that opened",
    ),
    "lag": Word(
        "steps and fast sines",
        "a filter, slow electronics, or a long line to the transducer",
        force="a damper in series with a spring, or a seal that creeps",
        flow="oil or air in a dead end behind a narrow bore, or a hose that creeps",
        valve="a filter before the valve, or a pilot stage that is slow",
    ),
    "resonance": Word(
        "a sweep through its frequency",
        "a pilot stage, a mass on a spring, or a line",
        force="a mass on a spring: a load or a frame that is not held stiffly",
        flow="a line to a dead end, such as a gauge's or an accumulator's",
        valve="a pilot stage or an amplifier that is hardly damped",
    ),
    "random_delay": Word("small steps, many of them", "a bus or a controller that is overloaded"),
    "play": Word(
        "small reversals",
        "a worn joint, or a coupling with play",
        force="a seal or a joint that gives way like a spring before it slides",
        flow="a hose or a seal that creeps back",
        reading="a gauge, a linkage or a scale that sticks",
        valve="a spool that sticks, or hysteresis of its magnet",
    ),
    "saturation": Word("large and small steps", "an amplifier or a valve at its end"),
    "stuck_channel": Word("a look at the channel alone", "a transducer or cable that failed"),
    "mixed_up_channel": Word("a look at the cables", "cables that are swapped"),
}
"""All shapes by name. Curves show no `resonance`, `random_delay` (`at_random`), `stuck_channel` and
`mixed_up_channel`: whoever finds these in another way names them so. A `lag` is a curve in readings
only."""


def likely_parts(name: str, place: str, plant: Plant) -> str:
    """Return which parts of a rig make a shape with this name at a place, in words."""
    word, kind = LEXICON[name], kind_of(place, plant)
    return (getattr(word, kind) if kind else "") or word.parts


_KINDS: Final = {
    "spool": "valve", "valve edges": "edges", "null of the spool": "valve",
    "spool per volt": "valve", "discharge coefficient": "valve", "command": "valve",
    "friction level": "force", "viscous friction": "force", "payload": "force",
    "bulk modulus": "oil", "supply pressure": "supply", "return pressure": "supply",
}  # fmt: skip
"""Kinds of places that their units do not tell, by the names that the servo-actuator gives them."""
_BY_UNIT: Final = {"N": "force", "N m": "force", "m^3/s": "flow", "m^3/(s Pa^0.5)": "flow"}


def kind_of(place: str, plant: Plant) -> str:
    """Return the kind of a place: force, flow, valve, edges, reading, oil or supply; else ""."""
    if place.startswith(("reading of ", "gain of ")):
        return "reading"
    return _KINDS.get(place, _BY_UNIT.get(si_unit_of(place, plant), ""))


def shape_of(addition: Addition, low: float, high: float, plant: Plant) -> str:
    """Return the name of an addition's shape, from its form and what it depends on.

    Args:
        addition: the disturbance.
        low: least value of its quantity in the recordings, SI.
        high: greatest value.
        plant: plant that the disturbance belongs to.
    """
    form, times = addition.form, addition.times
    if form in MEMORIES:
        return form
    sort = _sort_of(addition.of, plant)
    turns = DIRECTION in (addition.of, times)
    if turns and (form == "constant" or addition.of == DIRECTION):
        is_play = kind_of(addition.place, plant) in ("reading", "valve")
        return "play" if is_play else "depends_on_velocity"
    if not addition.of or form == "constant":
        return "constant"
    if form == "tone":
        return "tone"
    if form == "wave":
        return "tone" if sort == "time" else "periodic_in_position"
    if form == "bump":
        return "local_in_position" if sort == "position" else _general(sort)
    if form == "hinge":
        return "threshold"
    if form == "beyond":
        # What takes away from a command beyond its limit is that which does not pass it.
        against = addition.values[0] < 0.0 and not addition.times
        return "saturation" if sort == "opening" and against else "threshold"
    x = np.linspace(low, high, _POINTS)
    y = addition.shape(x)
    if sort == "time":
        return "step_in_time" if _is_step(x, y) else "trend"
    if sort == "velocity" and _is_late(addition.place, plant, x, y):
        return "lag"
    if form == "table":
        return _of_table(sort, x, y)
    if sort == "velocity" and form in ("x^2", "x |x|"):
        return "power_of_velocity"
    return "grows_with_pressure" if sort == "pressure" else _general(sort)


def _sort_of(of: str, plant: Plant) -> str:
    """Return the sort of a quantity: time, velocity, position, pressure or opening; else ""."""
    if of == TIME_NAME:
        return "time"
    if of in ("spool opening", *plant.inputs) or of == "command":
        return "opening"
    if of == DIRECTION:
        return "velocity"
    unit = plant.regions[of].unit if of in plant.regions else ""
    sorts = {"m/s": "velocity", "rad/s": "velocity", "m": "position", "rad": "position",
             "Pa": "pressure"}  # fmt: skip
    return sorts.get(unit, "")


def _general(sort: str) -> str:
    return f"depends_on_{sort or 'a_quantity'}"


def _of_table(sort: str, x: Array, y: Array) -> str:
    """Return the name of the shape of a table with values y (n,) at evenly spaced places x (n,)."""
    reach = float(np.ptp(y))
    if not reach > BENT * float(np.abs(y).max()):
        return "constant"
    if sort == "position":
        away = np.abs(y - 0.5 * (y[0] + y[-1]))
        near = float(np.mean(away > 0.5 * away.max()))
        if near < LOCAL and abs(y[0] - y[-1]) < 0.5 * away.max():
            return "local_in_position"
    if sort in ("pressure", "position", "") and (_is_hinge(x, y) or _is_hinge(-x[::-1], y[::-1])):
        return "threshold"
    if sort == "pressure":
        # What is added to a level, such as that of friction, may begin below zero and grow.
        falls = min(-float(np.minimum(np.diff(each), 0.0).sum()) for each in (y, np.abs(y)))
        return "grows_with_pressure" if falls < BENT * reach else "depends_on_pressure"
    if sort == "velocity":
        squared = float(np.var(_left(y, x * np.abs(x))))
        if squared < min(BENT * float(np.var(y)), 0.5 * float(np.var(_left(y, x)))):
            return "power_of_velocity"
    if sort == "opening" and (_is_flat_outside(x, y) or _is_clipped(x, y)):
        return "saturation"
    return _general(sort)


def _left(y: Array, *shapes: Array) -> Array:
    """Return what a constant and some shapes (n,) leave of a curve y (n,) by least squares."""
    columns = np.column_stack([*shapes, np.ones_like(y)])
    return np.asarray(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])


def _is_late(place: str, plant: Plant, x: Array, y: Array) -> bool:
    """Return whether an error of a position's reading falls in proportion to the velocity.

    A late reading errs so. `x` (n,) is the velocity, `y` (n,) the disturbance of the place.
    """
    outputs = {f"reading of {each.channel}": each.unit for each in plant.outputs}
    if outputs.get(place) not in ("m", "rad"):
        return False
    slope = float(x @ y) / max(float(x @ x), 1e-300)
    return slope < 0.0 and float(np.square(y - slope * x).sum()) < BENT * float(y @ y)


def _is_hinge(x: Array, y: Array) -> bool:
    """Return whether a curve is flat at first and then rises or falls along a straight line.

    That must fit it much better than one straight line. `x` (n,) must be ascending.
    """
    straight = float(np.sum(_left(y, x) ** 2))
    bends = x[int(0.2 * len(x)) : -int(0.1 * len(x)) : 5]
    best = min(float(np.sum(_left(y, np.maximum(x - at, 0.0)) ** 2)) for at in bends)
    return best < 0.1 * straight and straight > 0.02 * float(np.sum((y - y.mean()) ** 2))


def _is_step(x: Array, y: Array) -> bool:
    """Return whether one step fits a course in time much better than a straight line."""
    straight = float(np.sum(_left(y, x) ** 2))
    steps = (
        float(np.sum((y[:k] - y[:k].mean()) ** 2) + np.sum((y[k:] - y[k:].mean()) ** 2))
        for k in range(20, len(y) - 20, 5)
    )
    return min(steps) < 0.5 * straight


def _is_flat_outside(x: Array, y: Array) -> bool:
    """Return whether a curve changes in its middle half and hardly in its outer quarters."""
    quarter = len(x) // 4
    middle = abs(float(y[3 * quarter] - y[quarter]))
    ends = abs(float(y[quarter] - y[0])) + abs(float(y[-1] - y[3 * quarter]))
    return ends < 0.25 * middle


def _is_clipped(x: Array, y: Array) -> bool:
    """Return whether a curve is flat about zero, and falls along straight lines beyond a limit.

    So does what a clipped quantity lacks, on either side. It must fit much better than one straight
    line. `x` (n,) must be ascending.
    """
    if not x[0] < 0.0 < x[-1]:
        return False
    straight = float(np.sum(_left(y, x) ** 2))
    limits = np.abs(x[-1]) * np.geomspace(0.01, 0.8, 40)
    beyond = [np.sign(x) * np.maximum(np.abs(x) - at, 0.0) for at in limits]
    left, best = min((float(np.sum(_left(y, each) ** 2)), k) for k, each in enumerate(beyond))
    return left < 0.1 * straight and float(beyond[best] @ (y - y.mean())) < 0.0


_LEAKING: Final = {"flow, chamber 1": "pressure 1", "flow, chamber 2": "pressure 2"}
"""Name of a chamber's flow -> name of its pressure."""
_ACROSS: Final = "leak across the piston"


def is_leak(addition: Addition, low: float, high: float) -> bool:
    """Return whether an addition takes oil out of a chamber and grows with a pressure.

    An opening across the piston counts wherever it adds to the model's: what passes it grows with
    the difference of the pressures. A flow into a chamber counts if it depends on that chamber's
    pressure, goes out at some pressure, and on the whole falls as the pressure rises. Nothing else
    counts.

    Args:
        addition: the disturbance.
        low: least value of its quantity in the recordings, SI.
        high: greatest value.
    """
    if addition.form in MEMORIES:
        return addition.place == _ACROSS
    x = np.linspace(low, high, 101)
    if addition.place == _ACROSS:
        return bool(addition.times) or bool(addition.shape(x).max() > 0.0)
    if addition.of != _LEAKING.get(addition.place):
        return False
    out = -addition.shape(x)
    slope = float(np.polyfit(x, out, 1)[0])
    return slope > 0.0 and bool(out.max() > 0.0)
