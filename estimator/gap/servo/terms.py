"""This module turns a disturbance in symbols into parameters of the rig's model, and back.

The model's parameters for it are those of `rig.plant.added_terms`.
"""

from collections.abc import Mapping, Sequence
from math import atan2, cos, hypot, sin
from typing import Final

from estimator.gap.plant import DIRECTION, TIME_NAME, Array, Held, Knob, Term
from rig.plant import MOST_TERMS, PLACES, QUANTITIES, AddedTerm, Parameters, fields_of, terms_of

_SHARE: Final = 0.03
"""Probe of a knob, a small but visible change: this part of a size or a width, or this many radians
of a phase."""
_FINE: Final = 1e-3
"""Probe of a period, as a part of it. Over a stroke of ten periods it shifts the last one by a
hundredth of a period."""
_REACH: Final = 10.0
"""Greatest size, in multiples of its first estimate; also the greatest change of a phase, in
radians."""
_WIDER: Final = 3.0
_SHIFTED: Final = 2.0
"""Number of its own widths by which the middle of a bump may move."""
_STRETCHED: Final = 1.3


def why_not(place: str, term: Term) -> str:
    """Return the reason, in words, why the model cannot represent a term; empty if it can.

    `place` is the name of an equation, or "reading of" and a channel. How many terms a model holds
    is not looked at.
    """
    if place.startswith("reading of "):
        return f"an error of the {place} is none of the plant's: a simulation does not have it"
    if place not in PLACES:
        return f"terms of a model do not enter the {place}"
    if TIME_NAME in (term.times, term.region):
        return "it grows with the time since the recording began, which a simulation does not know"
    if term.region not in QUANTITIES:
        return f"a simulation does not know the {term.region}"
    return ""


def hold_terms(
    place: str, terms: Sequence[Term], coefficients: Array, values: Mapping[str, float]
) -> Held:
    """Return the parameter values and knobs that represent those terms that the model can hold.

    A model holds at most three. The others are given back as refused, with the reason (`why_not`).

    Args:
        place: name of an equation, or "reading of" and a channel.
        terms: terms of the disturbance.
        coefficients: float64 (columns of all terms,), SI.
        values: values of all parameters by name, without the disturbance.
    """
    added: list[AddedTerm] = []
    refused: list[tuple[int, str]] = []
    first = 0
    for index, term in enumerate(terms):
        own = [float(c) for c in coefficients[first : first + term.columns]]
        first += term.columns
        reason = why_not(place, term)
        if not reason and len(added) == MOST_TERMS:
            reason = f"a model holds {MOST_TERMS}"
        if reason:
            refused.append((index, reason))
        else:
            added.append(_added(place, term, own))
    fields = fields_of(tuple(added))
    knobs = [knob for number, term in enumerate(added, 1) for knob in _knobs(number, term)]
    return Held({**values, **fields} if added else {}, tuple(knobs), tuple(refused))


def _added(place: str, term: Term, own: Sequence[float]) -> AddedTerm:
    size, at, by = own[0], 0.0, 0.0
    if term.form == "wave":
        size, at, by = hypot(*own), term.at[0], atan2(own[1], own[0])
    elif term.form == "bump":
        at, by = term.at
    turned = term.times == DIRECTION
    return AddedTerm(place, term.region, term.form, turned, size, at, by)


def _knobs(number: int, term: AddedTerm) -> list[Knob]:
    name = f"term_{number}"
    reach = _REACH * abs(term.size)
    knobs = [Knob(f"{name}_size", f"{name}_size", _SHARE * abs(term.size), -reach, reach)]
    at, by = term.at, term.by
    if term.form == "wave":
        knobs += [
            Knob(f"{name}_pitch", f"{name}_at", _FINE * at, at / _STRETCHED, at * _STRETCHED),
            Knob(f"{name}_phase", f"{name}_by", _SHARE, by - _REACH, by + _REACH),
        ]
    elif term.form == "bump":
        knobs += [
            Knob(f"{name}_middle", f"{name}_at", _SHARE * by, at - _SHIFTED * by,
                 at + _SHIFTED * by),
            Knob(f"{name}_width", f"{name}_by", _SHARE * by, by / _WIDER, by * _WIDER),
        ]  # fmt: skip
    return knobs


def held_terms(values: Mapping[str, float]) -> tuple[str, list[tuple[Term, list[float]]]]:
    """Return the added disturbance that a model holds: its equation, and its terms in symbols.

    `values` are those of all parameters by name. Each term comes with its coefficients, SI: one, or
    for a wave two, of its sine and its cosine. Without any term the name of the equation is empty,
    and so is the list. All terms are taken to enter one equation, that of the last.
    """
    par = Parameters(**{name: values[name] for name in Parameters._fields})
    found: list[tuple[Term, list[float]]] = []
    place = ""
    for term in terms_of(par):
        place = term.place
        times = DIRECTION if term.turned else ""
        if term.form == "wave":
            # size sin(a + phase) is written as a sine and a cosine.
            own = [term.size * cos(term.by), term.size * sin(term.by)]
            found.append((Term(term.of, "wave", times, (term.at,)), own))
        elif term.form == "bump":
            found.append((Term(term.of, "bump", times, (term.at, term.by)), [term.size]))
        else:
            found.append((Term(term.of, term.form, times), [term.size]))
    return place, found
