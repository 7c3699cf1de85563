"""This module says how a model of the servo-actuator holds additions.

The rig's own equations hold as many as its parameters have room for (`rig.plant.added_terms`).
There they act at every moment, in simulations and filters too. Readings, parameters that change and
what depends on the time are held in slots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from estimator.gap.plant import (
    DIRECTION,
    MEMORIES,
    TIME_NAME,
    Addition,
    Layout,
    as_addition,
    as_term,
)
from rig.plant import MOST_TABLES, MOST_TERMS, AddedTerm, Parameters, fields_of, is_held, terms_of

FRICTION: Final = "friction level"
_FORCE: Final = "force balance"
_PARTS: Final = ("size", "at", "by")
_IN_SLOTS: Final = (*MEMORIES, "beyond")
"""Forms that the rig's own terms do not have."""


class ServoLayout(Layout):
    """Translates additions to the rig's terms and to slots, and back."""

    def _placed(self, additions: Sequence[Addition]) -> tuple[list[int], list[int]]:
        """Return the indices of the additions that are terms, tables first, and of all others.

        An addition is a term if the rig's equations can hold it and have room left. The others are
        held in slots.
        """
        tables: list[int] = []
        symbols: list[int] = []
        others: list[int] = []
        for index, each in enumerate(additions):
            room = len(tables) + len(symbols) < MOST_TERMS
            kind = tables if each.form == "table" else symbols
            if kind is tables:
                room = room and len(tables) < MOST_TABLES
            room = room and each.form not in _IN_SLOTS and is_held(term_of(each))
            (kind if room else others).append(index)
        return [*tables, *symbols], others

    def values(self, additions: Sequence[Addition]) -> dict[str, float]:
        """Return the values of the fields of all terms and slots, by parameter name.

        Raises:
            ValueError: there are more additions than there is room for, or one cannot be held.
        """
        terms, others = self._placed(additions)
        return {
            **fields_of(tuple(term_of(additions[k]) for k in terms)),
            **super().values([additions[k] for k in others]),
        }

    def additions(self, values: Mapping[str, float]) -> list[Addition]:
        """Return the additions that the values of all parameters hold: terms, then slots."""
        parameters = Parameters(**{field: values[field] for field in Parameters._fields})
        terms = [addition_of(term) for term in terms_of(parameters)]
        return [*terms, *super().additions(values)]

    def names(self, additions: Sequence[Addition], index: int) -> tuple[list[str], list[str]]:
        """Return the names of the parameters that hold an addition: its `values`, and its `at`.

        These are two lists. `additions` are those given to the method `values`; `index` is that of
        one of them.
        """
        terms, others = self._placed(additions)
        each = additions[index]
        if index not in terms:
            return super().names([additions[k] for k in others], others.index(index))
        number = 1 + terms.index(index)
        if each.form == "table":
            knots = range(1, len(each.at) + 1)
            return (
                [f"table_{number}_value_{k}" for k in knots],
                [f"table_{number}_at_{k}" for k in knots],
            )
        at = [f"term_{number}_{part}" for part in _PARTS[1 : 1 + len(each.at)]]
        return [f"term_{number}_size"], at


def term_of(addition: Addition) -> AddedTerm:
    """Return an addition as a term of a model file.

    One to the friction level becomes a force that is multiplied by the direction of motion, which
    the rig adds to the level of its bristles. It stays as it is if it is multiplied by the
    direction already, or depends on the time.
    """
    if addition.place == FRICTION and addition.times != DIRECTION and addition.of != TIME_NAME:
        addition = replace(addition, place=_FORCE, times=DIRECTION)
    return as_term(addition)


def addition_of(term: AddedTerm) -> Addition:
    """Return a term of a model file as an addition; the inverse of `term_of`.

    A force that turns with the direction of motion becomes an addition to the friction level.
    """
    addition = as_addition(term)
    if addition.place == _FORCE and term.turned:
        return replace(addition, place=FRICTION, times="")
    return addition
