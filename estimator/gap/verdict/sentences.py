"""This module says in one sentence, with units, what a disturbance does and what may make it."""

from collections.abc import Sequence
from math import floor, isfinite, log10, pi
from typing import Final

import numpy as np

from estimator.gap.plant import DIRECTION, MEMORIES, TIME_NAME, Addition, Plant
from estimator.gap.search import NORMAL_95, places_of, varying_of

_NOUNS: Final = {
    "force balance": ("A force against extension", "A force towards extension",
                      "A force, counted against extension,"),
    "flow, chamber 1": ("Oil into chamber 1", "Oil out of chamber 1",
                        "A flow, counted into chamber 1,"),
    "flow, chamber 2": ("Oil into chamber 2", "Oil out of chamber 2",
                        "A flow, counted into chamber 2,"),
    "leak across the piston": ("An opening across the piston",
                               "A lack of opening across the piston",
                               "An opening across the piston"),
    "valve edges": ("A gap at all edges of the valve", "A lap at all edges of the valve",
                    "A gap at all edges of the valve"),
    "friction level": ("Friction beside the model's", "A lack of friction",
                       "Friction beside the model's"),
}  # fmt: skip
"""What a disturbance of a place is called if it is positive, negative, or of both signs."""
_TURN: Final = 0.01
"""Part by which a wave along an angle may miss a whole number of periods a turn."""
_QUANTITIES: Final = {
    "pressure 1": "the pressure in chamber 1",
    "pressure 2": "the pressure in chamber 2",
    "pressure difference": "the difference of the pressures",
    "spool opening": "the opening of the spool",
    DIRECTION: "the direction of motion",
    TIME_NAME: "the time",
}


def sentence(
    addition: Addition,
    name: str,
    errors: Sequence[float],
    plant: Plant,
    low: float,
    high: float,
) -> str:
    """Return what a disturbance does, in one sentence with units and no full stop.

    Args:
        addition: the disturbance.
        name: name of its shape in the lexicon.
        errors: standard errors of its values, in their order; may be empty.
        plant: plant that it belongs to.
        low: least value of its quantity in the recordings, SI.
        high: greatest value.
    """
    if addition.form in MEMORIES:
        words = _Predicate(addition, name, errors, plant, (low, high), 1.0).words()
        return f"{_nouns(addition, plant)[2].split(',')[0]} {words}"
    x = np.linspace(low, high, 201) if addition.of else np.zeros(1)
    y = addition.shape(x)
    small = 0.05 * float(np.abs(y).max())
    positive, negative, either = _nouns(addition, plant)
    noun, sign = either, 1.0
    if addition.form in ("wave", "tone"):
        noun = either.split(",")[0]
    elif y.min() >= -small:
        noun = positive
    elif y.max() <= small:
        noun, sign = negative, -1.0
    return f"{noun} {_Predicate(addition, name, errors, plant, (low, high), sign).words()}"


class _Predicate:
    """Makes the words that say what a disturbance does, to follow the noun that it is called by.

    Args:
        addition: the disturbance.
        name: name of its shape in the lexicon.
        errors: standard errors of its values; may be empty.
        plant: plant that it belongs to.
        reach: least and greatest value of its quantity, SI.
        sign: 1, or -1 if the noun already says that the disturbance is negative.
    """

    def __init__(
        self, addition: Addition, name: str, errors: Sequence[float], plant: Plant,
        reach: tuple[float, float], sign: float,
    ) -> None:  # fmt: skip
        self._addition, self._name = addition, name
        self._errors, self._reach, self._sign = errors, reach, sign
        self._unit, self._factor = unit_of(addition.place, plant)
        self._of_unit, self._of_factor = quantity_unit(addition.of, plant)
        self._of = _QUANTITIES.get(addition.of, f"the {addition.of}")

    def words(self) -> str:
        """Return the predicate, such as "that is always there: 5 N", without a full stop."""
        form = self._addition.form
        if form == "table":
            return self._table()
        if form in ("wave", "tone"):
            return self._wave()
        if form in MEMORIES:
            return self._remembered()
        if form == "bump":
            middle, width = self._addition.at
            near = f"about {self._at(middle)}, within {self._at(width)} to either side"
            return f"that acts where {self._of} is {near}: {self._size()} in the middle"
        if form == "hinge":
            begins = f"that begins where {self._of} passes {self._at(self._addition.at[0])}"
            return f"{begins}, and {self._grows()} by {self._slope()} beyond"
        if form == "beyond":
            begins = f"that begins where {self._of} is beyond {self._at(self._addition.at[0])}"
            grows = f"{self._grows()} with it by {self._slope()}"
            return f"{begins} on either side of zero, and {grows}"
        if form == "constant" or not self._addition.of:
            return f"that is always there: {self._size()}"
        if form == "x":
            return self._proportional()
        return self._power(form)

    def _remembered(self) -> str:
        at = self._addition.at
        per = f"per {self._of_unit or 'unit'}"
        sizes = [
            self._size(1.0 / self._of_factor, knot) for knot in range(len(self._addition.values))
        ]
        if self._addition.form == "lag":
            return (
                f"that lags behind {self._of} with a time constant of {1e3 * at[0]:.3g} ms: "
                f"{sizes[0]} {per} of its distance from {self._of}"
            )
        if self._addition.form == "play":
            return (
                f"that follows {self._of} with a play of {self._at(2.0 * at[0])}: "
                f"{sizes[0]} {per} of its distance from {self._of}"
            )
        return (
            f"that acts like an oscillator of {at[0]:.3g} Hz (damping ratio {at[1]:.2g}) driven by "
            f"{self._of}: {sizes[0]} {per} of its distance from {self._of}, and {sizes[1]} {per} "
            "of its speed divided by its angular frequency"
        )

    def _proportional(self) -> str:
        if self._addition.of == DIRECTION:
            return f"that turns with {self._of}: {self._size()} while extending"
        if self._name == "lag":
            late = f"{-1e3 * self._addition.values[0]:.3g} ms"
            return f"that grows with {self._of}, as if it came {late} late"
        grows = "drifts" if self._addition.of == TIME_NAME else self._grows()
        return f"that {grows} with {self._of}, by {self._slope()}"

    def _power(self, form: str) -> str:
        """Return the words for one of the forms `|x|`, `x^2` and `x |x|`."""
        low, high = self._reach
        far = high if abs(high) >= abs(low) else low
        how = "the magnitude of" if form == "|x|" else "the square of"
        turned = " and turns with its sign" if form == "x |x|" and low < 0.0 < high else ""
        shape = float(self._addition.shape(np.array([far]))[0]) / self._addition.values[0]
        return f"that goes with {how} {self._of}{turned}: {self._size(shape)} at {self._at(far)}"

    def _wave(self) -> str:
        period = self._addition.at[0]
        swings = f"by {self._size().removeprefix('-')} to either side"
        if self._addition.of == TIME_NAME:
            begins = ", and begins each recording at another phase"
            begins = begins if self._addition.form == "tone" else ""
            return f"that swings {1.0 / period:.4g} times a second, {swings}{begins}"
        often = f"once every {self._at(period)}"
        turns = 2.0 * pi / period if self._of_unit == "rad" else 0.0
        if round(turns) > 0 and abs(turns / round(turns) - 1.0) < _TURN:
            count = {1: "once", 2: "twice"}.get(round(turns), f"{round(turns)} times")
            often = f"{count} a turn"
        return f"that swings along {self._of} {often}, {swings}"

    def _table(self) -> str:
        values = self._addition.values
        ends = sorted({int(np.argmin(values)), int(np.argmax(values))})
        word = "while" if self._addition.of == DIRECTION else "at"
        at = [f"{self._size(knot=k)} {word} {self._at(self._addition.at[k])}" for k in ends]
        says = {
            "constant": "that is nearly the same everywhere",
            "local_in_position": f"that acts at one place along {self._of}",
            "grows_with_pressure": f"that grows with {self._of}",
            "power_of_velocity": f"that goes with the square of {self._of}",
            "threshold": f"that begins where {self._of} passes a threshold",
            "trend": "that drifts with the time",
            "step_in_time": "that changes at one moment",
            "lag": f"that grows with {self._of}, as if it came late",
            "play": f"that follows {self._of}",
            "saturation": f"that stops growing with {self._of}",
        }.get(self._name, f"that depends on {self._of}")
        return f"{says}: from {at[0]} to {at[1]}" if len(at) > 1 else f"{says}: {at[0]}"

    def _grows(self) -> str:
        return "grows" if self._sign * self._addition.values[0] > 0.0 else "falls"

    def _slope(self) -> str:
        """Return the size per shown unit of the quantity as text, without its sign."""
        size = self._size(1.0 / self._of_factor).removeprefix("-")
        return f"{size} per {self._of_unit or 'unit'}"

    def _size(self, shape: float = 1.0, knot: int = 0) -> str:
        """Return a value of the disturbance with its interval and unit, as text.

        Of a table it is the value at the knot with index `knot`. Of a form in symbols it is the
        size times `shape`, which is the value of the form at the place in question.
        """
        error = self._errors[knot] if knot < len(self._errors) else float("nan")
        scale = self._factor * shape
        value = self._sign * self._addition.values[knot] * scale
        return shown(value, abs(error * scale), self._unit)

    def _at(self, x: float) -> str:
        """Return a value of the quantity, SI, in the unit in which it is shown."""
        if self._addition.of == DIRECTION:
            return "extending" if x > 0.0 else "retracting"
        return f"{x * self._of_factor:.3g} {self._of_unit}".strip()


def _nouns(addition: Addition, plant: Plant) -> tuple[str, str, str]:
    """Return how a disturbance is called if it is positive, negative, or of both signs."""
    place = addition.place
    if addition.times == DIRECTION and place == "force balance":
        # A force that turns with the motion is friction.
        return _NOUNS["friction level"]
    if place in _NOUNS:
        found = _NOUNS[place]
    elif place.startswith("reading of "):
        channel = place.removeprefix("reading of ").rsplit("_", 1)[0].replace("_", " ")
        found = (f"An error of the reading of {channel}",) * 3
    elif any(each.name == place for each in plant.varying):
        found = (f"A change of the {place}",) * 3
    else:
        found = (f"A disturbance of the {place}",) * 3
    if addition.times:
        turns = _QUANTITIES.get(addition.times, f"the {addition.times}")
        positive, negative, either = (f"{each.rstrip(',')}, turned with {turns}," for each in found)
        return positive, negative, either
    return found


def shown(value: float, error: float, unit: str) -> str:
    """Return a value with half its 95 % interval and its unit, as text.

    Args:
        value: the value.
        error: standard error; if it is not finite or 0, the value alone is shown.
        unit: unit of both.
    """
    half = NORMAL_95 * error
    if not isfinite(half) or half <= 0.0:
        return f"{value:.3g} {unit}".strip()
    decimals = 1 - floor(log10(half) + 1e-9)
    if decimals > 6 or half >= 1e5:
        return f"{value:.3g} ± {half:.2g} {unit}".strip()
    return f"{value:.{max(decimals, 0)}f} ± {half:.{max(decimals, 0)}f} {unit}".strip()


def unit_of(place: str, plant: Plant) -> tuple[str, float]:
    """Return the unit in which a disturbance of a place is shown, and how many are one SI unit.

    For an unknown place they are "" and 1.
    """
    places = (*places_of(plant), *varying_of(plant))
    return next((each.shown for each in places if each.name == place), ("", 1.0))


def si_unit_of(place: str, plant: Plant) -> str:
    """Return the SI unit of a disturbance of a place; "" for an unknown place."""
    places = (*places_of(plant), *varying_of(plant))
    return next((each.unit for each in places if each.name == place), "")


def quantity_unit(of: str, plant: Plant) -> tuple[str, float]:
    """Return the unit in which a quantity is shown, and how many are one SI unit.

    For an unknown quantity they are "" and 1.
    """
    if of in plant.regions:
        return plant.regions[of].shown
    return ("s", 1.0) if of == TIME_NAME else ("", 1.0)
