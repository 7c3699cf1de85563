"""Annotations of schemas' fields, which parse a quantity, check limits and suggest a remedy."""

import math
import unicodedata
from dataclasses import dataclass
from decimal import Decimal
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from .document import Located
from .quantities import QuantityError, Reading, dimension, read, unit_factor
from .unit_patterns import any_quantity_pattern, quantity_pattern


class Relative(NamedTuple):
    """A deviation from the base model's value as a fraction: -0.04 for `-4 %`."""

    fraction: float


class Field:
    """An annotation of a schema's field, by whose `parse` pydantic reads the field's value."""

    def parse(self, raw: object) -> Any:
        """Return the field's value, parsed from a value of YAML.

        Raises:
            QuantityError: the value is wrong.
        """
        raise NotImplementedError

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema by which pydantic reads the field, which calls `parse`."""
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Return the field's JSON schema, by which an editor checks it."""
        return self.json_schema()

    def json_schema(self) -> dict[str, Any]:
        """Return what an editor may know of the field's value, as a JSON schema."""
        return {}

    def _validate(self, raw: object) -> Any:
        try:
            return self.parse(raw)
        except QuantityError as error:
            context = {"limit": error.limit, "remedy": error.remedy}
            raise PydanticCustomError("quantity", "not a quantity", context) from error


@dataclass(frozen=True)
class Physical(Field):
    """An annotation that makes a float a quantity: its SI unit, limits and usual value, all SI."""

    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    typical: float | None = None

    def parse(self, raw: object) -> float:
        """Return the SI value of a text with a unit, or of a bare number if the unit is "" or rad.

        Raises:
            QuantityError: it is not this quantity, or it is below `lower` or above `upper`. The
                error names the limit in the unit that the file uses, and the value that was
                probably meant, if there is one within the limits.
        """
        reading = read(raw, self.unit)
        if self.lower <= reading.value <= self.upper:
            return reading.value
        above = reading.value > self.upper
        limit = Decimal(repr(self.upper if above else self.lower))
        shown = _show(limit / unit_factor(reading.unit, self.unit), reading.unit)
        fitting, end = self._fitting(reading), f"at {'most' if above else 'least'} {shown}"
        remedy = f"did you mean {fitting}?" if fitting else end
        raise QuantityError(f"is {'above' if above else 'below'} {shown}", remedy)

    def json_schema(self) -> dict[str, Any]:
        """Return a text with a unit, or also a number if the quantity needs none."""
        kind = dimension(self.unit)
        ends = (("at least", self.lower), ("at most", self.upper))
        limits = [f"{word} {end:g} {self.unit}".strip() for word, end in ends if math.isfinite(end)]
        about = ", ".join([f"{kind.name}, such as {kind.example}", *limits])
        text = {"type": "string", "pattern": quantity_pattern(self.unit, signed=self.lower < 0.0)}
        if self.unit not in ("", "rad"):
            return {**text, "description": about}
        words = (("minimum", self.lower), ("maximum", self.upper))
        number: dict[str, Any] = {"type": "number"}
        number |= {word: end for word, end in words if math.isfinite(end)}
        return {"anyOf": [number, text], "description": about}

    def _fitting(self, reading: Reading) -> str | None:
        """Return, as text, the value that was probably meant, with another decimal point or unit.

        It is within the limits. Of several candidates, the one nearest the usual value is returned,
        or the first if no usual value is known. None if no candidate is within the limits.
        """
        slips = [(reading.number.scaleb(shift), reading.unit) for shift in (-1, 1, -2, 2)]
        slips += [(reading.number, unit) for unit in dimension(self.unit).units]
        slips += [(reading.number.scaleb(shift), reading.unit) for shift in (-3, 3, -6, 6)]
        fitting = [
            (value, _show(number, unit))
            for number, unit in slips
            if self.lower <= (value := float(number * unit_factor(unit, self.unit))) <= self.upper
            and value != 0.0
        ]
        if not fitting:
            return None
        usual = self.typical
        if usual is None or usual == 0.0:
            return fitting[0][1]
        # By rounding, 13.8 MPa and 138 bar tie; then the first, the smaller correction, wins.
        return min(fitting, key=lambda fit: round(abs(math.log10(abs(fit[0] / usual))), 6))[1]


@dataclass(frozen=True)
class Is(Field):
    """An annotation of a key that has one value alone, by which its mapping is told from others."""

    value: str

    def parse(self, raw: object) -> Any:
        """Return the value as it is, since who chose this class by it has checked it."""
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return the one value."""
        return {"const": self.value}


@dataclass(frozen=True)
class Written(Field):
    """An annotation of a quantity of one kind that another schema reads, with its limits."""

    unit: str

    def parse(self, raw: object) -> Any:
        """Return the value as it is written."""
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return what an editor may know of a quantity with this unit."""
        return Physical(self.unit, 0.0).json_schema()


@dataclass(frozen=True)
class AnyQuantity(Field):
    """An annotation of a quantity whose unit follows from another key; it is read by that later."""

    def parse(self, raw: object) -> Any:
        """Return the value as it is written."""
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return a number, or a text with any unit."""
        text = {"type": "string", "pattern": any_quantity_pattern()}
        return {"anyOf": [{"type": "number"}, text], "description": "a quantity, with its unit"}


@dataclass(frozen=True)
class Adjustable(Field):
    """An annotation of a quantity that a file may also give as a deviation from a base model's.

    The deviation is a percentage with a sign, such as `-4 %`.
    """

    physical: Physical

    def parse(self, raw: object) -> float | Relative:
        """Return the SI value, or the deviation that a signed percentage means.

        Raises:
            QuantityError: it is not this quantity, outside its limits, or a percentage without a
                sign. Of a quantity that has no unit, a percentage without a sign is the value
                itself.
        """
        if isinstance(raw, str) and raw.strip().endswith("%"):
            if raw.strip()[0] in "+-":
                return Relative(read(raw, "").value)
            if self.physical.unit:
                raise QuantityError(
                    "is a share of nothing", "write a deviation with its sign, such as +10 %"
                )
        return self.physical.parse(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the quantity, or a text with a percentage."""
        known = self.physical.json_schema()
        share = {"type": "string", "pattern": quantity_pattern("")}
        return {"anyOf": [known, share], "description": known["description"]}


@dataclass(frozen=True)
class Interval(Field):
    """An annotation of a range: a pair of quantities, the lower one first.

    With `single`, a file may also give one quantity, which counts for both ends.
    """

    physical: Physical
    single: bool = False

    def parse(self, raw: object) -> tuple[float, float]:
        """Return the SI values of both ends, which may be equal.

        With `single`, anything but a list is read as the one quantity that counts for both.

        Raises:
            QuantityError: it is no pair (nor, with `single`, a quantity), an end is not this
                quantity or outside its limits, or the lower end is above the upper one.
        """
        if self.single and not isinstance(raw, list):
            value = self.physical.parse(raw)
            return value, value
        example = dimension(self.physical.unit).example
        if not isinstance(raw, list) or len(raw) != 2:
            raise QuantityError("is not a range", f"write [from, to], each like {example}")
        lower, upper = (self.physical.parse(end) for end in raw)
        if lower > upper:
            raise QuantityError("ends before it begins", "write the lower value first")
        return lower, upper

    def json_schema(self) -> dict[str, Any]:
        """Return a pair of quantities, or also one of them."""
        one = self.physical.json_schema()
        pair = {"type": "array", "items": one, "minItems": 2, "maxItems": 2}
        return {"anyOf": [one, pair]} if self.single else pair


def _checked_name(text: str) -> str:
    remedy = "write a name of letters, digits and signs that a terminal can show"
    hidden = next((c for c in text if not c.isprintable() and unicodedata.category(c) != "Zs"), "")
    if hidden:
        shown = hidden.encode("unicode_escape").decode()
        limit = f"has the character {shown}, which cannot be shown"
        raise PydanticCustomError("quantity", "no name", {"limit": limit, "remedy": remedy})
    if not text.strip():
        raise PydanticCustomError("quantity", "no name", {"limit": "is empty", "remedy": remedy})
    return text


def check_name(item: Located, text: str) -> bool:
    """Return whether a key may be a name, by the rule of `Name`; if not, record why.

    Args:
        item: the entry that has the key, or the mapping that the entry is in.
        text: the key.
    """
    try:
        _checked_name(text)
    except PydanticCustomError as error:
        found = error.context or {}
        shown = text.encode("unicode_escape").decode()
        item.refuse(str(found["limit"]), str(found["remedy"]), shown, name="name")
        return False
    return True


Name = Annotated[str, AfterValidator(_checked_name)]
"""The annotation of a name, which terminals, reports and logs show as it is written: a text that is
not empty and has no control character, such as ESC, BEL, NUL or a newline. Spaces are allowed."""


def _show(number: Decimal, unit: str) -> str:
    text = f"{float(number):.6g}"
    return f"{text} {unit}".strip()
