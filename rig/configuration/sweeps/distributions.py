"""Quantities may be drawn anew for each case of a sweep, such as `{uniform: [-15 %, +15 %]}`."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.configuration.reading import (
    LONGEST_VALUE,
    Adjustable,
    Field,
    Physical,
    QuantityError,
    Relative,
    WrongDimensionError,
    read,
)

Array = NDArray[np.float64]
Kind = Literal["fixed", "uniform", "log_uniform", "normal", "choice"]

KINDS: Final[tuple[Kind, ...]] = ("fixed", "uniform", "log_uniform", "normal", "choice")
_EXAMPLE: Final = "write a quantity, or one of {uniform: [from, to]}, {log_uniform: [from, to]}, "
_REMEDY: Final = _EXAMPLE + "{normal: [mean, deviation]} and {choice: [one, another]}"
# Probabilities are clipped by this much at both ends, where the inverse of the law is infinite.
_TAIL: Final = 2.0**-53


@dataclass(frozen=True)
class Distribution:
    """The distribution from which a quantity's values are drawn.

    Attributes:
        kind: `fixed` (one value), `uniform` and `log_uniform` (both ends), `normal` (mean and
            standard deviation) or `choice` (values that are equally likely).
        values: the values that the kind needs, SI.
        low, high: limits, SI, at which a normal distribution is cut off.
    """

    kind: Kind
    values: tuple[float, ...]
    low: float = -math.inf
    high: float = math.inf

    def at(self, uniform: Array) -> Array:
        """Return the distribution's quantiles (n,), SI, at the probabilities `uniform` (n,).

        The probabilities are in [0, 1); if they are uniform random numbers, the result is a sample.
        """
        first, second = self.values[0], self.values[-1]
        if self.kind == "uniform":
            return np.clip(first + (second - first) * uniform, first, second)
        if self.kind == "log_uniform":
            return np.clip(first * np.exp(uniform * math.log(second / first)), first, second)
        if self.kind == "normal":
            return self._normal(uniform)
        if self.kind == "choice":
            return np.array(self.values)[(uniform * len(self.values)).astype(np.intp)]
        return np.full(uniform.shape, first)

    def _normal(self, uniform: Array) -> Array:
        law = NormalDist(*self.values)
        lowest, highest = law.cdf(self.low), law.cdf(self.high)
        parts = np.clip(lowest + (highest - lowest) * uniform, _TAIL, 1.0 - _TAIL)
        return np.clip([law.inv_cdf(float(part)) for part in parts], self.low, self.high)

    @property
    def support(self) -> tuple[float, float]:
        """The smallest and the largest value that may be drawn, SI; infinite for no limit."""
        if self.kind == "normal":
            return self.low, self.high
        return min(self.values), max(self.values)

    @property
    def is_drawn(self) -> bool:
        """Whether the values can differ from case to case, as `support` is more than one value."""
        low, high = self.support
        return low != high


class Drawn(NamedTuple):
    """A distribution as a file gives it; its values are SI numbers, `Relative` or `Level`."""

    kind: Kind
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Random(Field):
    """The annotation of a quantity that a file may give as a distribution.

    Attributes:
        inner: the field that parses each value. A standard deviation is read in its unit too
            (metres or volts for a level), but without its limits.
    """

    inner: Field

    def parse(self, raw: object) -> Drawn:
        """Return the distribution that a value of YAML gives; a plain quantity gives a `fixed` one.

        Raises:
            QuantityError: the value is neither a quantity nor a distribution, its values are beyond
                the limits or mix shares with quantities, ends are in the wrong order, or a standard
                deviation is not above 0.
        """
        if not isinstance(raw, dict):
            return Drawn("fixed", (self.inner.parse(raw),))
        if len(raw) != 1 or next(iter(raw)) not in KINDS:
            shown = ", ".join(str(key) for key in raw)[:LONGEST_VALUE] or "an empty mapping"
            raise QuantityError(f"is no distribution ({shown})", _REMEDY)
        kind, given = next(iter(raw.items()))
        if kind == "fixed":
            return Drawn("fixed", (self.inner.parse(given),))
        if not isinstance(given, list) or not given:
            raise QuantityError(f"lacks the list of {kind}", _REMEDY)
        if kind == "normal":
            return self._normal(given)
        values = tuple(self.inner.parse(each) for each in given)
        if kind != "choice":
            _check_ends(kind, values)
        return Drawn(kind, values)

    def json_schema(self) -> dict[str, Any]:
        """Return the quantity, or a mapping with one distribution of it."""
        one = self.inner.json_schema()
        pair = {"type": "array", "minItems": 2, "maxItems": 2}
        laws = {
            "fixed": one, "uniform": {**pair, "items": one}, "log_uniform": {**pair, "items": one},
            "normal": pair, "choice": {"type": "array", "minItems": 1, "items": one},
        }  # fmt: skip
        law = {"type": "object", "properties": laws, "additionalProperties": False,
               "minProperties": 1, "maxProperties": 1}  # fmt: skip
        return {"anyOf": [one, law], "description": one.get("description", "")}

    def _normal(self, given: list[Any]) -> Drawn:
        if len(given) != 2:
            raise QuantityError("is no normal distribution", "write {normal: [mean, deviation]}")
        mean, deviation = self.inner.parse(given[0]), self._deviation(given[1])
        if isinstance(mean, Relative) is not isinstance(deviation, Relative):
            raise QuantityError(
                "mixes a share and a quantity", "give mean and deviation both in %, or neither"
            )
        return Drawn("normal", (mean, deviation))

    def _deviation(self, raw: object) -> Any:
        inner, relative = self.inner, False
        if isinstance(inner, Adjustable):
            relative = isinstance(raw, str) and raw.strip().endswith("%")
            inner = Physical("") if relative else inner.physical
        try:
            size = read(raw, inner.unit if isinstance(inner, Physical) else "m").value
        except WrongDimensionError:
            if isinstance(inner, Physical):
                raise
            size = read(raw, "V").value
        if not 0.0 < size < math.inf:
            raise QuantityError("deviates by no amount above 0", "write {normal: [mean, 3 %]}")
        return Relative(size) if relative else size


def _number(value: Any) -> float:
    if isinstance(value, Relative):
        return value.fraction
    return float(value.value) if hasattr(value, "value") else float(value)


def _check_ends(kind: str, values: tuple[Any, ...]) -> None:
    if len(values) != 2:
        raise QuantityError(f"gives {kind} {len(values)} values", f"write {{{kind}: [from, to]}}")
    low, high = (_number(value) for value in values)
    if isinstance(values[0], Relative) is not isinstance(values[1], Relative):
        raise QuantityError("mixes a share and a quantity", "give both ends in %, or neither")
    _check_order("uniform" if isinstance(values[0], Relative) else kind, low, high)


def _check_order(kind: str, low: float, high: float) -> None:
    if low > high:
        raise QuantityError("ends before it begins", "write the lower value first")
    if kind == "log_uniform" and low <= 0.0:
        raise QuantityError("starts at zero or below", "a log-uniform quantity is above 0")


def resolved(drawn: Drawn, limits: Physical, base: float = 0.0) -> Distribution:
    """Return the distribution that a file gives, with absolute values in SI.

    Args:
        drawn: the distribution as the file gives it.
        limits: range in which the values must lie. Of a normal distribution only the mean must lie
            in it, and the distribution is cut off at its ends.
        base: the value from which `Relative` values deviate.

    Raises:
        QuantityError: a value is beyond the limits, a value is `Relative` and `base` is 0, the ends
            are in the wrong order, or a log-uniform distribution begins at 0 or below.
    """
    if base == 0.0 and any(isinstance(value, Relative) for value in drawn.values):
        raise QuantityError("is a share of zero", "give the values themselves")
    is_normal = drawn.kind == "normal"
    values = []
    for index, value in enumerate(drawn.values):
        number = _number(value)
        if isinstance(value, Relative):
            number = abs(base) * number if is_normal and index == 1 else base * (1.0 + number)
        values.append(number)
    low, high, unit = limits.lower, limits.upper, limits.unit
    for value in values[:1] if is_normal else values:
        if not low <= value <= high:
            remedy = f"give {low:.6g} to {high:.6g} {unit}"
            if low <= base <= high:
                remedy = f"deviate less from {base:.6g} {unit}"
            raise QuantityError(
                f"gives {value:.6g} {unit}, outside {low:.6g} to {high:.6g} {unit}", remedy
            )
    if drawn.kind in ("uniform", "log_uniform"):
        _check_order(drawn.kind, *values)
    if is_normal:
        return Distribution("normal", tuple(values), low, high)
    return Distribution(drawn.kind, tuple(values))
