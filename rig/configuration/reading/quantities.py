"""Physical quantities as people write them, `13.8 MPa` or `0.5 L/min`, are read as SI floats here.

The arithmetic is decimal up to the last step, so that `9.8 um` becomes exactly the float 9.8e-6.
"""

import math
import re
from collections.abc import Sequence
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple

from .kept_factors import Pair, kept_factors
from .problems import nearest
from .unit_registry import DEFINITIONS, unit_registry

if TYPE_CHECKING:
    import pint

_MOST_SHOWN: Final = 1e4
"""From which on a number has more than four digits before its point."""


class Dimension(NamedTuple):
    """The quantity that an SI unit measures, an example of it, and the units that people use."""

    name: str
    example: str
    units: tuple[str, ...]


DIMENSIONS: Final[dict[str, Dimension]] = {
    "": Dimension("a plain number", "0.35", ("", "%")),
    "m": Dimension("a length", "0.3 m", ("m", "mm", "um", "in")),
    "m^2": Dimension("an area", "6.33e-4 m^2", ("m^2", "cm^2", "mm^2", "in^2")),
    "m^3": Dimension("a volume", "2.14e-5 m^3", ("m^3", "L", "cm^3", "in^3")),
    "m/s": Dimension("a velocity", "0.04 m/s", ("m/s", "mm/s", "in/s")),
    "m^2/m": Dimension("an area gradient", "2.075e-2 m^2/m", ("m^2/m", "mm^2/mm")),
    "kg": Dimension("a mass", "10 kg", ("kg", "g", "t")),
    "kg/m^3": Dimension("a density", "847.15 kg/m^3", ("kg/m^3", "g/cm^3")),
    "s": Dimension("a time", "18 s", ("s", "ms", "min", "us")),
    "rad": Dimension("an angle", "0.1 rad", ("rad", "deg")),
    "rad/s": Dimension("an angular frequency", "628 rad/s", ("rad/s", "Hz")),
    "Hz": Dimension("a frequency", "0.5 Hz", ("Hz", "mHz", "kHz", "rad/s")),
    "V": Dimension("a voltage", "3 V", ("V", "mV")),
    "m/V": Dimension("a valve gain", "2.794e-5 m/V", ("m/V", "mm/V", "um/V")),
    "V s/m": Dimension("a gain from velocity to voltage", "14 V s/m", ("V s/m",)),
    "V/m": Dimension("a position gain", "50 V/m", ("V/m", "V/mm")),
    "Pa": Dimension("a pressure", "13.8 MPa", ("Pa", "kPa", "MPa", "bar", "psi")),
    "N": Dimension("a force", "2.4e3 N", ("N", "kN")),
    "N/m": Dimension("a stiffness", "2e4 N/m", ("N/m", "N/mm", "kN/m")),
    "N s/m": Dimension("a viscous friction", "350 N s/m", ("N s/m", "kN s/m")),
    "m^3/s": Dimension("a flow", "0.5 L/min", ("m^3/s", "L/min", "mL/min", "gpm")),
    "m^3/(s Pa^0.5)": Dimension(
        "a leakage coefficient (square-root law)", "4e-9 m^3/(s Pa^0.5)", ("m^3/(s Pa^0.5)",)
    ),
    "m^3/(s Pa)": Dimension(
        "a leakage coefficient (linear law)", "2e-12 m^3/(s Pa)", ("m^3/(s Pa)",)
    ),
    "Pa/(m^3/s)^2": Dimension("a turbulent resistance", "8e11 Pa/(m^3/s)^2", ("Pa/(m^3/s)^2",)),
}


def dimension(si_unit: str) -> Dimension:
    """Return the dimension of an SI unit; for an unlisted unit, one that is made from its name."""
    plain = Dimension(f"a quantity in {si_unit}", f"1.0 {si_unit}", (si_unit,))
    return DIMENSIONS.get(si_unit, plain)


_USUAL: Final = frozenset(unit for each in DIMENSIONS.values() for unit in each.units)
_NUMBER: Final = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*?)\s*", re.S)
_UNIT: Final = re.compile(r"[A-Za-zµμ°%·²³\s\d.*/^()+-]{0,60}")
_ROOT: Final = re.compile(r"sqrt\s*(\([^()]*\))")
_JUXTAPOSED: Final = re.compile(r"(?<=[\w°%µμ²³)])\s*\(")
"""A parenthesis behind a unit, a number or another parenthesis: it multiplies."""
_ANGLE: Final = re.compile(r"rad|deg|°|turn|rev|rpm|Hz")


class QuantityError(ValueError):
    """The error of a value that is not the wanted quantity: the broken rule, and a remedy.

    `limit` is the rule as a phrase that follows the value, such as "has no unit".
    """

    def __init__(self, limit: str, remedy: str) -> None:
        self.limit = limit
        self.remedy = remedy
        super().__init__(f"{limit}; {remedy}")


class WrongDimensionError(QuantityError):
    """The error of a quantity of another kind than the wanted one, such as volts for metres."""


class Reading(NamedTuple):
    """A quantity that was read: its SI value, and number and unit as they are written."""

    value: float
    number: Decimal
    unit: str


@cache
def unit_factor(unit: str, si_unit: str) -> Decimal:
    """Return how many `si_unit` one `unit` is; 1 Hz counts as 2 pi rad/s.

    Raises:
        QuantityError: the unit is unknown.
        WrongDimensionError: the unit measures something else than `si_unit`.
    """
    if unit == si_unit:
        return Decimal(1)
    pair = (unit, si_unit)
    usual = _usual_factors() if unit in _USUAL and si_unit in DIMENSIONS else {}
    factor = usual[pair] if pair in usual else _factor(unit, si_unit)
    if factor is None:
        wanted = dimension(si_unit)
        raise WrongDimensionError(f"is not {wanted.name}", _expected(wanted))
    return factor


@cache
def _usual_factors() -> dict[Pair, Decimal | None]:
    """Return how many of each SI unit each usual unit is; nothing if that cannot be kept.

    It is None where the unit measures something else.
    """
    pairs = [(unit, si_unit) for si_unit in DIMENSIONS for unit in sorted(_USUAL)]
    return kept_factors(pairs, DEFINITIONS, _factor)


def _factor(unit: str, si_unit: str) -> Decimal | None:
    """Work out by pint how many `si_unit` one `unit` is; None if it measures something else.

    Raises:
        QuantityError: the unit is unknown.
    """
    parsed = _parse_unit(unit, si_unit)
    target = unit_registry().parse_units(si_unit)
    same = parsed.dimensionality == target.dimensionality
    if not same or bool(_ANGLE.search(unit)) != bool(_ANGLE.search(si_unit)):
        return None
    try:
        factor = unit_registry().convert(Decimal(1), parsed, target)
    except (ArithmeticError, ValueError) as error:
        expected = _expected(dimension(si_unit))
        raise QuantityError(f"has an unusable unit {unit!r}", expected) from error
    return Decimal(factor)


def _expected(wanted: Dimension) -> str:
    return f"write {wanted.name}, such as {wanted.example}"


def _parse_unit(unit: str, si_unit: str) -> "pint.Unit":
    if not _UNIT.fullmatch(unit):
        shown = unit if len(unit) <= 60 else f"{unit[:57]}..."
        raise QuantityError(f"has an unusable unit {shown!r}", _likely_unit(unit, si_unit))
    text = _ROOT.sub(r"\1^0.5", unit).replace("·", "*")
    # Without a sign, pint from 0.26 on, which Python from 3.12 on gets, takes the power behind the
    # parenthesis for one of the unit in front too.
    text = _JUXTAPOSED.sub("*(", text)
    registry = unit_registry()
    try:
        return registry.parse_units(text)
    except Exception as error:  # pint passes on whatever its tokenizer and arithmetic raise
        remedy = _likely_unit(unit, si_unit)
        raise QuantityError(f"has an unknown unit {unit!r}", remedy) from error


def _likely_unit(unit: str, si_unit: str) -> str:
    """Return the remedy for a unit that cannot be read: the unit that was probably meant.

    It is looked for among the units of the wanted quantity and then among all others; if none is
    close, the remedy is an example of the wanted quantity.
    """
    known = [name for each in DIMENSIONS.values() for name in each.units]
    near = nearest(unit, dimension(si_unit).units) or nearest(unit, known)
    return f"did you mean {near}?" if near else f"write it like {dimension(si_unit).example}"


def read(raw: object, si_unit: str) -> Reading:
    """Return the quantity, of the kind that `si_unit` measures, that a text or number gives.

    It must have a unit, unless `si_unit` is "" or "rad"; a bare number is in that unit then.

    Raises:
        QuantityError: it is no number or too large, or its unit is missing or wrong.
    """
    wanted = dimension(si_unit)
    is_read = isinstance(raw, int | float | str) and not isinstance(raw, bool)
    match = _NUMBER.fullmatch(str(raw)) if is_read else None
    if match is None:
        raise QuantityError("is not a quantity", f"write {wanted.name}: {wanted.example}")
    number, unit = Decimal(match[1]), match[2]
    if not unit and si_unit not in ("", "rad"):
        remedy = f"write {wanted.name} with its unit, such as {wanted.example}"
        raise QuantityError("has no unit", remedy)
    unit = unit or si_unit
    try:
        value = float(number * unit_factor(unit, si_unit))
    except ArithmeticError as error:
        raise QuantityError("is too large a number", f"write it like {wanted.example}") from error
    if not math.isfinite(value):
        raise QuantityError("is too large a number", f"write it like {wanted.example}")
    return Reading(value, number, unit)


def show(value: float, si_unit: str) -> str:
    """Return an SI value as text with four digits, in a unit that suits its size: `13.8 MPa`.

    The unit is the first usual one in which the number is from 0.1 to below 1000, else the SI unit.
    A flow is always in L/min.
    """
    units = ("L/min",) if si_unit == "m^3/s" else dimension(si_unit).units
    scaled = [(float(Decimal(repr(value)) / unit_factor(unit, si_unit)), unit) for unit in units]
    readable = (pair for pair in scaled if 0.1 <= abs(pair[0]) < 1000.0)
    number, unit = next(readable, scaled[0])
    return f"{number:.4g} {unit}".strip()


def show_alike(values: Sequence[float], si_unit: str) -> list[str]:
    """Return SI values as texts to be compared: in one unit, and different where they differ.

    They have four digits, or as many more as it takes to tell them apart, up to nine. The unit is
    the one that `show` has for the least of them; each has its own if the greatest would have five
    digits before the point in that. Infinity is "without bound", and NaN "not known".

    Args:
        values: the values; minus infinity is shown as it is.
        si_unit: their unit; empty for plain numbers.
    """
    sizes = sorted(abs(value) for value in values if math.isfinite(value) and value)
    unit = show(sizes[0], si_unit).partition(" ")[2] if sizes else si_unit
    if sizes and _in_unit(sizes[-1], unit, si_unit) >= _MOST_SHOWN:
        return [_unbounded(value) or show(value, si_unit) for value in values]
    texts: list[str] = []
    for digits in range(4, 10):
        texts = [
            _unbounded(value) or f"{_in_unit(value, unit, si_unit):.{digits}g} {unit}".strip()
            for value in values
        ]
        if len({*texts}) == len({*values}):
            break
    return texts


def _in_unit(value: float, unit: str, si_unit: str) -> float:
    return float(Decimal(repr(value)) / unit_factor(unit, si_unit)) if unit else value


def _unbounded(value: float) -> str:
    """Return the words for a value that is no finite number; "" for one that is."""
    if math.isnan(value):
        return "not known"
    if math.isinf(value):
        return "without bound" if value > 0.0 else "-inf"
    return ""
