"""The key `discovered` of a model file gives terms that are added to the plant's equations.

Such a term is a disturbance that a search found, or that a user gives, for example:

discovered:
  - {to: force balance, of: position, form: wave, size: 180 N, pitch: 42 mm, phase: 0.4 rad}
  - {to: force balance, of: velocity, form: x |x|, size: 9.1e3 N/(m/s)^2}
  - {to: force balance, of: position, form: bump, against_motion: true, size: 600 N,
     middle: 0.3 m, width: 20 mm}
  - {to: force balance, of: pressure 1, form: hinge, size: 2e-5 N/(Pa), at: 5 MPa}
  - {to: force balance, of: velocity, form: table, at: [-0.2 m/s, 0 m/s, 0.2 m/s],
     values: [-30 N, 0 N, 45 N]}

Older files have the key `unknown_term` in its place. A term that the plant cannot hold, such as one
that is added to a parameter or depends on the time, is kept with the model and written back, though
the simulator and the filters ignore it. There may be four such terms.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, Final, Literal, NamedTuple

from pydantic import create_model

from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    quantity_in,
    read_mapping,
    suggestion,
)
from rig.plant import (
    FORMS,
    MOST_KNOTS,
    MOST_OTHERS,
    MOST_TABLES,
    MOST_TERMS,
    MOVING_OIL,
    PLACES,
    QUANTITIES,
    AddedTerm,
    Model,
    fields_of,
    is_held,
    place_units,
    quantity_unit,
    terms_of,
    unit_per,
)

KEY: Final = "discovered"
OLD_KEY: Final = "unknown_term"
_CONSTANT: Final = "constant"
_LEAST: Final = 1e-9
"""Smallest allowed value of a pitch or a width, SI."""
_FORMS: Final = {_CONSTANT if form == "1" else form: form for form in FORMS}
_EXAMPLE: Final = "write `- {to: force balance, form: constant, size: 100 N}`"
_TABLE_EXAMPLE: Final = (
    "write `at: [-0.2 m/s, 0 m/s, 0.2 m/s]` and as many values, `values: [-30 N, 0 N, 45 N]`"
)


class _Term(Schema):
    """Keys of a term; a schema made by `_schema` adds the key `of`."""

    to: str
    form: Literal[tuple(_FORMS)]  # type: ignore[valid-type]
    against_motion: bool = False
    size: Any = None
    pitch: Any = None
    phase: Any = None
    middle: Any = None
    width: Any = None
    at: Any = None
    values: Any = None


@cache
def _schema(of: tuple[str, ...]) -> type[_Term]:
    """Return the schema of a term that may depend on the quantities `of`."""
    choice: Any = Literal[of]
    return create_model("_TermOf", __base__=_Term, of=(choice | None, None))


class Vocabulary(NamedTuple):
    """What the terms of a plant may name.

    Attributes:
        places: name of each place that a term may be added to -> SI unit.
        quantities: name of each quantity that a term may depend on -> SI unit.
        told: the places that a message on an unknown place offers instead.
        turns: whether the plant has a direction of motion, which `against_motion` needs.
    """

    places: Mapping[str, str]
    quantities: Mapping[str, str]
    told: Sequence[str]
    turns: bool = True

    def of_unit(self, of: str) -> str:
        """Return the SI unit of a quantity; "" for none."""
        return self.quantities[of] if of else ""

    def size_unit(self, term: AddedTerm) -> str:
        """Return the SI unit of a term's size, or of a table's values."""
        return unit_per(self.places[term.place], self.of_unit(term.of), term.form)


_OF_RIG: Final = Vocabulary(
    place_units(), {of: quantity_unit(of) for of in (*tuple(QUANTITIES)[1:], "time")}, list(PLACES)
)
_OF_FORMS: Final = ("size", "pitch", "phase", "middle", "width", "at", "values")


class Terms(NamedTuple):
    """The terms of a model file.

    Attributes:
        fields: field -> value of `Parameters` for the terms that the plant holds.
        others: the terms that it cannot hold.
    """

    fields: dict[str, float]
    others: tuple[AddedTerm, ...]


def _numbers(form: str, unit: str) -> dict[str, Physical]:
    """Return the keys that locate a form along its quantity, each with its unit and limits.

    Their order is that of `at` and `by` of `AddedTerm`; `unit` is the SI unit of the quantity. For
    a form that is not located so, such as a table, the result is empty.
    """
    if form == "wave":
        return {"pitch": Physical(unit, _LEAST), "phase": Physical("rad")}
    if form == "bump":
        return {"middle": Physical(unit), "width": Physical(unit, _LEAST)}
    if form == "hinge":
        return {"at": Physical(unit)}
    return {}


def read_terms(section: Located) -> Terms | None:
    """Return the terms of a model file; record the problems.

    A term with a mistake is left out; fields of unused terms are neutral. None if the section is
    neither "none" nor a list of terms, or has more of them than the plant holds.
    """
    if section.value == "none":
        return Terms(fields_of(()), ())
    if not isinstance(section.value, list):
        section.refuse(f"is not a list of at most {MOST_TERMS} terms", _EXAMPLE)
        return None
    read = [(entry, read_term(entry, _OF_RIG)) for entry in section.elements()]
    found = [(entry, term) for entry, term in read if term is not None]
    held = [(entry, term) for entry, term in found if is_held(term)]
    tables = [(entry, term) for entry, term in held if term.form == "table"]
    others = [(entry, term) for entry, term in found if not is_held(term)]
    for kept, most, what in (
        (held, MOST_TERMS, "terms"),
        (tables, MOST_TABLES, "tables"),
        (others, MOST_OTHERS, "terms that are not of the plant's equations"),
    ):
        for entry, _ in kept[most:]:
            limit = f"is one of {len(kept)} {what}; a model holds at most {most} {what}"
            entry.refuse(limit, f"keep the {most} that explain most", "")
    if len(held) > MOST_TERMS or len(tables) > MOST_TABLES:
        return None
    return Terms(fields_of(tuple(term for _, term in held)), tuple(term for _, term in others))


def read_term(entry: Located, known: Vocabulary) -> AddedTerm | None:
    """Return the term that an entry describes; None if it has a mistake, which is recorded."""
    problems = entry.sources.problems.found
    before = len(problems)
    term: Any = read_mapping(_schema(tuple(known.quantities)), entry)
    if term is None:
        return None
    form, of = _FORMS[term.form], term.of or ""
    if term.to not in known.places:
        remedy = suggestion(term.to, known.told, "places")
        entry.refuse("is not a choice here", remedy, term.to, "to")
    if form == "1" and of:
        entry.refuse(f"does not go with form {term.form}", "leave it out", of, "of")
    elif form != "1" and entry.get("of") is None:
        limit = f"lacks the key of, the quantity that form {term.form} depends on"
        entry.refuse(limit, f"name one of {', '.join(known.quantities)}", "")
    if term.against_motion and not known.turns:
        limit = "needs a region with the name direction, which the plant does not have"
        entry.refuse(limit, "leave it out", "true", "against_motion")
    if len(problems) > before:
        return None
    along = known.of_unit(of)
    value = Physical(unit_per(known.places[term.to], along, form))
    wanted = {} if form == "table" else {"size": value, **_numbers(form, along)}
    keys = {*wanted, *(("at", "values") if form == "table" else ())}
    for key in _OF_FORMS:
        if entry.get(key) is not None and key not in keys:
            entry.refuse(f"is not of form {term.form}", "leave it out", "", key)
    given = [
        _quantity(item, kind)
        for key, kind in wanted.items()
        if (item := _given(entry, key, f"add `{key}: ... {kind.unit}`")) is not None
    ]
    numbers = [number for number in given if number is not None]
    knots: tuple[tuple[float, float], ...] = ()
    if form == "table":
        numbers, knots = [1.0], _knots(entry, Physical(along), value)
    if len(problems) > before:
        return None
    size, at, by = [*numbers, 0.0, 0.0][:3]
    return AddedTerm(term.to, of, form, term.against_motion, size, at, by, knots)


def _given(entry: Located, key: str, remedy: str) -> Located | None:
    """Return the value of a key; if it is missing, record a problem and return None."""
    item = entry.get(key)
    if item is None:
        entry.refuse(f"lacks the key {key}", remedy, "")
    return item


def _quantity(item: Located, kind: Physical) -> float | None:
    return quantity_in(item, lambda: kind.parse(item.plain()))


def _knots(entry: Located, along: Physical, size: Physical) -> tuple[tuple[float, float], ...]:
    """Return the knots of a table, pairs (quantity, value) in SI; record its problems.

    The keys `at` and `values` give them. If any problem was recorded, the result must not be used.
    """
    problems = entry.sources.problems.found
    before = len(problems)
    at, values = _quantities(entry, "at", along), _quantities(entry, "values", size)
    if len(problems) > before:
        return ()
    if len(at) != len(values):
        limit = f"has {len(values)} entries, but `at` has {len(at)}"
        entry.refuse(limit, "give one value for each position", "", "values")
    for index, (left, right) in enumerate(pairwise(at), 1):
        if not right > left:
            position = entry.find("at", index)
            position.refuse("is not above the one before it", "write them in ascending order")
    return tuple(zip(at, values, strict=False))


def _quantities(entry: Located, key: str, kind: Physical) -> list[float]:
    """Return the quantities in the list under a key of a table, SI; record its problems.

    Elements with a mistake are left out.
    """
    item = _given(entry, key, _TABLE_EXAMPLE)
    if item is None:
        return []
    count = len(item.value) if isinstance(item.value, list) else 0
    if not 2 <= count <= MOST_KNOTS:
        item.refuse(f"is not a list of 2 to {MOST_KNOTS} quantities", _TABLE_EXAMPLE)
    parsed = [_quantity(each, kind) for each in item.elements()]
    return [value for value in parsed if value is not None]


def written_terms(model: Model) -> Iterator[str]:
    """Yield the lines of a model file that give its terms; none if the model has none."""
    return lines_of((*terms_of(model.parameters), *model.discovered), _OF_RIG)


def lines_of(terms: Sequence[AddedTerm], known: Vocabulary) -> Iterator[str]:
    """Yield the lines of a model file that give these terms, from the key `discovered` on.

    There are no lines if there are no terms. `known` gives the units.
    """
    if not terms:
        return
    yield f"{KEY}:"
    for term in terms:
        yield f"  - to: {term.place}"
        if term.of:
            yield f"    of: {term.of}"
        yield f"    form: {_CONSTANT if term.form == '1' else repr(term.form)}"
        if term.turned:
            yield "    against_motion: true"
        along, unit = known.of_unit(term.of), known.size_unit(term)
        if term.form == "table":
            at = ", ".join(_text(x, along) for x, _ in term.knots)
            yield f"    at: [{at}]"
            values = ", ".join(_text(term.size * y, unit) for _, y in term.knots)
            yield f"    values: [{values}]"
            continue
        yield f"    size: {_text(term.size, unit)}"
        numbers = zip(_numbers(term.form, along).items(), (term.at, term.by), strict=False)
        for (key, kind), value in numbers:
            yield f"    {key}: {_text(value, kind.unit)}"


def _text(value: float, unit: str) -> str:
    return f"{float(value)!r} {unit}".rstrip()


def term_lines(model: Model) -> Iterator[str]:
    """Yield a line about each term of a model, for a person who checks its file."""
    for term in (*terms_of(model.parameters), *model.discovered):
        form = _CONSTANT if term.form == "1" else term.form
        of = f" of {term.of}" if term.of else ""
        times = " times the direction of motion" if term.turned else ""
        yield f"  added to {term.place}: {form}{of}{times}{_remark(term)}"


def _remark(term: AddedTerm) -> str:
    """Return a remark on a term for people, with a semicolon before it; "" if there is none.

    It says that the term has no effect, or that it hides a leak.
    """
    if not is_held(term):
        return "; simulator and filters ignore it"
    if term.place in MOVING_OIL:
        return "; the detector is blind to a leak that looks like it"
    return ""
