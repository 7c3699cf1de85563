"""Additions are disturbances that a model holds beside its equations, in any plant.

An addition changes an equation, a reading or a parameter by a function of one quantity: a table of
knots, or a form in symbols. The functions that run a plant (`estimator.gap.prediction`) apply them
sample by sample, so that no plant has to know of them. A plant only says how large its quantities
are and how much a unit of disturbance changes its states (`Plant.measures`).

The values of the additions follow the plant's own parameters in the array that compiled functions
take: `SLOTS` slots with the parts of `PARTS`. An empty slot is all 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot, pi
from typing import Final, NamedTuple

import numpy as np
from numba import float64, int64, types
from numpy.typing import NDArray

from rig.plant import MOST_KNOTS, MOST_OTHERS, AddedTerm

from .interface import Array, Equation, Parameter, Region, Varying

DIRECTION: Final = "direction"
TIME_NAME: Final = "time"
"""Names of two quantities: the sign of the motion, and the time since the recording began."""
SLOTS: Final = MOST_OTHERS
"""Greatest number of additions that slots hold."""
KNOTS: Final = MOST_KNOTS
"""Greatest number of knots of a table."""
NOWHERE, IN_EQUATION, IN_READING, IN_PARAMETER = range(4)
"""What a slot enters."""
CONSTANT_OF: Final = -1.0
TIME_OF: Final = -2.0
"""What an addition depends on is the index of a quantity, or one of these: nothing, or the time."""
FORMS: Final = (
    "constant", "x", "|x|", "x^2", "x |x|", "wave", "bump", "hinge", "table", "tone", "lag",
    "resonance", "beyond", "play",
)  # fmt: skip
"""How an addition depends on its quantity x. A wave is sin(2 pi x / at + by), a bump
exp(-((x - at) / by)^2), and a hinge max(0, x - at). What is beyond a limit on either side is
sgn(x) max(0, |x| - at), as of an amplifier at both of its ends. A tone is a wave in time whose
phase differs from recording to recording. A lag, a resonance and a play remember x (`memories`)."""
TABLE: Final = FORMS.index("table")
TONE: Final = FORMS.index("tone")
LAG: Final = FORMS.index("lag")
RESONANCE: Final = FORMS.index("resonance")
BEYOND: Final = FORMS.index("beyond")
PLAY: Final = FORMS.index("play")
MEMORIES: Final = ("lag", "resonance", "play")
"""Forms that depend on the course of their quantity, and not on its present value alone."""
NOT_IN_FILES: Final = ("tone", *MEMORIES)
"""Forms that model files cannot hold: simulator and filters have neither phase nor memory."""
PARTS: Final = (
    "enters", "place", "of", "times", "form",
    *(f"x{k}" for k in range(KNOTS)), *(f"y{k}" for k in range(KNOTS)),
)  # fmt: skip
"""Names of the numbers in a slot: what it enters and the index of that, what it depends on and is
multiplied by, its form, and its knots. A form in symbols has `at` in x0, `by` in x1 and its size in
y0; a resonance has a second size in y1. A tone has its period in x0 and the phases of the
recordings from x1 on."""
PHASES: Final = KNOTS - 1
"""Greatest number of recordings that a tone has a phase for."""
WIDTH: Final = len(PARTS)
X_AT: Final = PARTS.index("x0")
"""Index of x0 in a slot's numbers."""
_Y: Final = PARTS.index("y0")


def slot_field(slot: int, part: str) -> str:
    """Return the name of the parameter that holds one of the `PARTS` of a slot.

    Slots are counted from 0 here, and from 1 in the names.
    """
    return f"added_{slot + 1}_{part}"


SLOT_PARAMETERS: Final = tuple(
    Parameter(slot_field(slot, part), "", -np.inf, np.inf, 0.0)
    for slot in range(SLOTS)
    for part in PARTS
)
"""Parameters that a plant has beyond its own, so that models of it can hold additions."""
EMPTY_SLOTS: Final = {parameter.name: 0.0 for parameter in SLOT_PARAMETERS}


@dataclass(frozen=True)
class Addition:
    """One disturbance that a model holds beside its equations.

    Attributes:
        place: name of an equation, or "reading of" and a channel, or of one of `Plant.varying`.
        of: name of the quantity that it depends on: a region, "time", or "" for none.
        times: name of the region that it is multiplied by, such as "direction"; "" for none.
        form: one of `FORMS`.
        at: positions of a table's knots, ascending, SI; (at, by) of a form that has them; of a tone
            its period, s, and its phase in each of `PHASES` recordings, rad: 0 where it is not
            known, and the tone is left out; of a lag its time constant, s; of a resonance its
            frequency, Hz, and its damping ratio; of a play half its width, SI.
        values: values at these knots, SI; the two sizes of a resonance; else the size alone.
    """

    place: str
    of: str
    times: str
    form: str
    at: tuple[float, ...]
    values: tuple[float, ...]

    def shape(self, x: Array, recording: int = 0) -> Array:
        """Return the addition (n,) at values of its quantity (n,), without the factor `times`.

        A tone is that of the recording with this number.

        Raises:
            ValueError: the addition remembers its quantity, so that values do not tell it.
        """
        if self.form in MEMORIES:
            raise ValueError(f"a {self.form} depends on the course of {self.of}, not on its values")
        if self.form == "table":
            return np.interp(x, self.at, self.values)
        if self.form == "tone":
            phase = self.at[1 + recording]
            known = self.values[0] if phase != 0.0 else 0.0
            return np.asarray(known * np.sin(2.0 * pi * x / self.at[0] + phase))
        at, by = (*self.at, 0.0, 0.0)[:2]
        shapes = {
            "constant": lambda: np.ones_like(x),
            "x": lambda: x,
            "|x|": lambda: np.abs(x),
            "x^2": lambda: x * x,
            "x |x|": lambda: x * np.abs(x),
            "wave": lambda: np.sin(2.0 * pi * x / at + by),
            "bump": lambda: np.exp(-(((x - at) / by) ** 2)),
            "hinge": lambda: np.maximum(x - at, 0.0),
            "beyond": lambda: np.sign(x) * np.maximum(np.abs(x) - at, 0.0),
        }
        return np.asarray(self.values[0] * shapes[self.form]())


_COUNTS: Final = {
    "wave": 2, "bump": 2, "hinge": 1, "tone": 1 + PHASES, "lag": 1, "resonance": 2, "beyond": 1,
    "play": 1,
}  # fmt: skip
"""Number of elements of `Addition.at` of the forms in symbols that have any."""
_SIZES: Final = {"resonance": 2}
"""Number of elements of `Addition.values` of the forms in symbols that have several."""


def as_term(addition: Addition) -> AddedTerm:
    """Return an addition as a term of a model file.

    A tone is a wave as in the first recording. What remembers, or is beyond a limit, becomes
    a term in proportion to its quantity. That has the right units, and serves for nothing else: a
    file holds what is beyond a limit as a table (`in_files`).
    """
    turned = addition.times == DIRECTION
    instead = {"constant": "1", "tone": "wave", **dict.fromkeys((*MEMORIES, "beyond"), "x")}
    form = instead.get(addition.form, addition.form)
    if form == "table":
        knots = tuple(zip(addition.at, addition.values, strict=True))
        return AddedTerm(addition.place, addition.of, form, turned, 1.0, knots=knots)
    at, by = (*addition.at, 0.0, 0.0)[:2]
    return AddedTerm(addition.place, addition.of, form, turned, addition.values[0], at, by)


_FAR: Final = 1e3
"""A table in the place of what is beyond a limit ends at so many times that limit."""


def in_files(addition: Addition) -> Addition:
    """Return an addition in a form that model files hold: what is beyond a limit is a table there.

    Others are returned as they are.
    """
    if addition.form != "beyond":
        return addition
    (at,), far = addition.at, _FAR * addition.at[0]
    knots = (-far, -at, at, far)
    values = tuple(float(value) for value in addition.shape(np.array(knots)))
    return replace(addition, form="table", at=knots, values=values)


def as_addition(term: AddedTerm) -> Addition:
    """Return a term of a model file as an addition; the inverse of `as_term`."""
    times = DIRECTION if term.turned else ""
    if term.form == "table":
        at, values = zip(*term.knots, strict=True)
        scaled = tuple(term.size * value for value in values)
        return Addition(term.place, term.of, times, "table", at, scaled)
    form = "constant" if term.form == "1" else term.form
    at = (term.at, term.by)[: _COUNTS.get(form, 0)]
    return Addition(term.place, term.of, times, form, at, (term.size,))


def wave(place: str, of: str, pitch: float, sine: float, cosine: float) -> Addition:
    """Return a wave along `of` as an addition, made of the sizes of its sine and its cosine.

    It is `sine` * sin(2 pi x / `pitch`) + `cosine` * cos(2 pi x / `pitch`); all are in SI units.
    """
    return Addition(
        place, of, "", "wave", (pitch, atan2(cosine, sine)), (hypot(sine, cosine),)
    )  # fmt: skip


KICKS, SHOWS, VARIES, REMEMBERS = 1, 2, 4, 8
"""Bits of `Extension.active`: a slot enters an equation, a reading or a parameter, or remembers."""


class Extension(NamedTuple):
    """What compiled functions must know of a plant's additions.

    Attributes:
        kicked: int64 (equations, 2), states that each equation changes; -1 for none.
        changed: int64 (varying, 2), parameters that each of `Plant.varying` changes; -1 for none.
        own: number of the plant's own parameters; the slots follow them.
        active: sum of `KICKS`, `SHOWS` and `VARIES`, as far as slots enter equations, readings and
            parameters, and of `REMEMBERS` if one remembers its quantity; 0 if no slot is used.
        measured: number of quantities that `Plant.measures` writes, with the rates.
        quantities: number of the quantities alone; the rates follow, two for each equation.
        time_s: time of the first sample since the recording began, s.
        period: sampling period, s.
        recording: number of the recording, from 0.
    """

    kicked: NDArray[np.int64]
    changed: NDArray[np.int64]
    own: int
    active: int
    measured: int
    quantities: int
    time_s: float
    period: float
    recording: int


EXTENSION: Final = types.BaseTuple.from_types(
    (int64[:, ::1], int64[:, ::1], int64, int64, int64, int64, float64, float64, int64), Extension
)


def kicked_states(equations: Sequence[Equation]) -> NDArray[np.int64]:
    """Return for each equation the two states that it changes, int64 (equations, 2); -1 for none.

    There is one row of -1 if there are no equations.
    """
    rows = [(each.state, each.also[0][0] if each.also else -1) for each in equations]
    return np.array(rows or [(-1, -1)], dtype=np.int64)


class Layout:
    """Translates additions of a plant to values of its slots, and back.

    Args:
        equations: equations of the plant, in the order of their rates in `Plant.measures`.
        regions: regions of the plant by name, in the order of its quantities.
        channels: names of the measured channels.
        varying: parameters that may change with a quantity.
        own: names of the plant's own parameters.

    Attributes:
        changed: int64 (varying, 2), indices of the parameters that each of `varying` changes; -1
            for none.
        own: number of the plant's own parameters; those of the slots follow them.
    """

    def __init__(
        self,
        equations: Sequence[Equation],
        regions: Mapping[str, Region],
        channels: Sequence[str],
        varying: Sequence[Varying],
        own: Sequence[str],
    ) -> None:
        self.own = len(own)
        self._codes = {name: float(k) for k, name in enumerate(regions)}
        self._codes |= {"": CONSTANT_OF, TIME_NAME: TIME_OF}
        rows = [[own.index(name) for name in each.parameters] for each in varying]
        self.changed = np.array([[*row, -1][:2] for row in rows] or [[-1, -1]], dtype=np.int64)
        self._places = {
            **{each.name: (IN_EQUATION, k) for k, each in enumerate(equations)},
            **{f"reading of {name}": (IN_READING, k) for k, name in enumerate(channels)},
            **{each.name: (IN_PARAMETER, k) for k, each in enumerate(varying)},
        }

    def why_not(self, addition: Addition) -> str:
        """Return the reason, in words, why a slot cannot hold an addition; empty if it can."""
        if addition.place not in self._places:
            return f"a model holds no addition to the {addition.place}"
        for name in (addition.of, addition.times):
            if name not in self._codes:
                return f"the plant has no quantity {name}"
        return ""

    def values(self, additions: Sequence[Addition]) -> dict[str, float]:
        """Return the values of all slots, by parameter name, with these additions in the first.

        The other slots are empty.

        Raises:
            ValueError: there are more additions than slots, or `why_not` refuses one.
        """
        if len(additions) > SLOTS:
            raise ValueError(f"{len(additions)} additions; a model holds {SLOTS}")
        found = dict(EMPTY_SLOTS)
        for slot, each in enumerate(additions):
            refused = self.why_not(each)
            if refused:
                raise ValueError(refused)
            numbers = [
                *map(float, self._places[each.place]), self._codes[each.of],
                self._codes[each.times], float(FORMS.index(each.form)),
            ]  # fmt: skip
            for knots in (each.at, each.values):
                # A table ends in copies of its last knot.
                last = knots[-1] if each.form == "table" else 0.0
                numbers += [*knots, *[last] * (KNOTS - len(knots))]
            for part, number in zip(PARTS, numbers, strict=True):
                found[slot_field(slot, part)] = number
        return found

    def additions(self, values: Mapping[str, float]) -> list[Addition]:
        """Return the additions that the values of all parameters hold; the inverse of `values`."""
        found = []
        places = {code: name for name, code in self._places.items()}
        quantities = {code: name for name, code in self._codes.items()}
        for slot in range(SLOTS):
            if values.get(slot_field(slot, "enters"), 0.0) == NOWHERE:
                continue
            numbers = tuple(values[slot_field(slot, part)] for part in PARTS)
            (enters, place, of, times, form), at = numbers[:X_AT], numbers[X_AT:_Y]
            name = FORMS[int(form)]
            places_count, count = _COUNTS.get(name, 0), 1
            if name == "table":
                places_count = count = 1 + int(np.count_nonzero(np.diff(at) > 0.0))
            found.append(
                Addition(
                    places[int(enters), int(place)], quantities[of], quantities[times], name,
                    at[:places_count], numbers[_Y:][: _SIZES.get(name, count)],
                )
            )  # fmt: skip
        return found

    def names(self, additions: Sequence[Addition], index: int) -> tuple[list[str], list[str]]:
        """Return the names of the parameters that hold an addition: its `values`, and its `at`.

        These are two lists. `additions` are those given to the method `values`; `index` is that of
        one of them.
        """
        each = additions[index]
        return (
            [slot_field(index, f"y{k}") for k in range(len(each.values))],
            [slot_field(index, f"x{k}") for k in range(len(each.at))],
        )


def activity(values: Mapping[str, float]) -> int:
    """Return which kinds of places the used slots enter (`Extension.active`); 0 if none is used."""
    kinds = {IN_EQUATION: KICKS, IN_READING: SHOWS, IN_PARAMETER: VARIES}
    found = 0
    for slot in range(SLOTS):
        enters = int(values.get(slot_field(slot, "enters"), 0.0))
        if enters != NOWHERE:
            found |= kinds[enters]
            if values[slot_field(slot, "form")] in (LAG, RESONANCE, PLAY):
                found |= REMEMBERS
    return found
