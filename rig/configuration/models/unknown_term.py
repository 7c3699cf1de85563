"""The key `unknown_term` of a model file gives terms that are added to the plant's equations.

Such a term is a disturbance that a search found, or that a user gives, for example:

unknown_term:
  - {to: force balance, of: position, form: wave, size: 180 N, pitch: 42 mm, phase: 0.4 rad}
  - {to: force balance, of: velocity, form: x |x|, size: 9.1e3 N/(m/s)^2}
  - {to: force balance, of: position, form: bump, against_motion: true, size: 600 N,
     middle: 0.3 m, width: 20 mm}
"""

from collections.abc import Iterator
from typing import Any, Final, Literal

from rig.configuration.reading import (
    Located,
    Physical,
    Problems,
    Schema,
    Sources,
    quantity_in,
    read_mapping,
    shown,
)
from rig.plant import (
    FORMS,
    MOST_TERMS,
    PLACES,
    QUANTITIES,
    AddedTerm,
    Model,
    fields_of,
    size_unit,
    terms_of,
)

KEY: Final = "unknown_term"
_CONSTANT: Final = "constant"
_LEAST: Final = 1e-9
"""Smallest allowed value of a pitch or a width, SI."""
_FORMS: Final = {_CONSTANT if form == "1" else form: form for form in FORMS}
_EXAMPLE: Final = "write `- {to: force balance, form: constant, size: 100 N}`"


class _Term(Schema):
    """Keys of a term."""

    to: Literal[tuple(PLACES)]  # type: ignore[valid-type]
    of: Literal[tuple(QUANTITIES)[1:]] | None = None  # type: ignore[valid-type]
    form: Literal[tuple(_FORMS)]  # type: ignore[valid-type]
    against_motion: bool = False
    size: Any
    pitch: Any = None
    phase: Any = None
    middle: Any = None
    width: Any = None


_OF_FORMS: Final = ("pitch", "phase", "middle", "width")


def _places(form: str, of: str) -> dict[str, Physical]:
    """Return the two keys, with units and limits, that locate a wave or a bump; {} for other forms.

    Their order is that in which `Parameters` holds them. `of` is the quantity along which the form
    varies.
    """
    if form == "wave":
        return {"pitch": Physical(QUANTITIES[of], _LEAST), "phase": Physical("rad")}
    if form == "bump":
        return {"middle": Physical(QUANTITIES[of]), "width": Physical(QUANTITIES[of], _LEAST)}
    return {}


def read_terms(section: Located, sources: Sources) -> dict[str, float]:
    """Return field -> value of `Parameters` for the terms of a model file; record the problems.

    A term with a mistake is left out; fields of unused terms are neutral. {} if the section is
    neither "none" nor a list of at most `MOST_TERMS` terms.
    """
    if section.value == "none":
        return fields_of(())
    if not isinstance(section.value, list) or len(section.value) > MOST_TERMS:
        limit = f"is not a list of at most {MOST_TERMS} terms"
        sources.problems.add(section.place, KEY, shown(section), limit, _EXAMPLE)
        return {}
    found = [_term(entry, sources.problems) for entry in section.elements()]
    return fields_of(tuple(term for term in found if term is not None))


def _term(entry: Located, problems: Problems) -> AddedTerm | None:
    term = read_mapping(_Term, entry, problems)
    if term is None:
        return None
    form, of = _FORMS[term.form], term.of or ""
    if (form == "1") != (of == ""):
        limit = f"does not go with form {term.form}" if of else f"is what form {form} is of"
        remedy = "leave it out" if of else f"name one of {', '.join(tuple(QUANTITIES)[1:])}"
        problems.add(entry.find(("of",)).place, "of", of, limit, remedy)
        return None
    wanted = {"size": Physical(size_unit(term.to, of, form)), **_places(form, of)}
    for key in _OF_FORMS:
        if entry.get(key) is not None and key not in wanted:
            place = entry.find((key,)).place
            problems.add(place, key, "", f"is not of form {term.form}", "leave it out")
    numbers = [_number(entry, key, kind, problems) for key, kind in wanted.items()]
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return None
    return AddedTerm(term.to, of, form, term.against_motion, *known)


def _number(entry: Located, key: str, kind: Physical, problems: Problems) -> float | None:
    item = entry.get(key)
    if item is None:
        if key != "size":  # the schema reports a missing size itself
            problems.add(entry.place, entry.name, "", f"lacks the key {key}", f"add `{key}: ...`")
        return None
    return quantity_in(item, lambda: kind.parse(item.plain()), problems)


def written_terms(model: Model) -> Iterator[str]:
    """Yield the lines of a model file that give its terms; none if the model has none."""
    terms = terms_of(model.parameters)
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
        yield f"    size: {float(term.size)!r} {term.size_unit}"
        numbers = (term.at, term.by)
        for (key, kind), value in zip(_places(term.form, term.of).items(), numbers, strict=False):
            yield f"    {key}: {float(value)!r} {kind.unit}".rstrip()
