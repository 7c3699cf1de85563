"""Terms in symbols: a disturbance of at most three terms that a model may have beside its effects.

The gap workflow writes such terms where no effect of the catalogue explains a disagreement
(docs/gap.md). A term such as 180 N sin(2 pi x / 42 mm + 0.4) is added to the force balance, to a
chamber's flow or to the spool's reference. `Parameters` has four fields for each term: kind, size,
`at` and `by`. The kind is a number of four digits: 1 + index in PLACES, index in QUANTITIES, index
in FORMS, and 1 if the sign follows the direction of motion. A kind of 0 means no term.
"""

from math import exp, floor, pi, sqrt
from typing import Final, NamedTuple

from rig.lanes import select

from .compiled import inlined, inner
from .parameters import Parameters

MOST_TERMS: Final = 3

PLACES: Final = {"force balance": "N", "flow, chamber 1": "m^3/s", "flow, chamber 2": "m^3/s",
                 "spool": "m"}  # fmt: skip
"""Where a term is added, with its unit: a force against extension, a flow into a chamber, or a
shift of the spool's reference."""
QUANTITIES: Final = {
    "": "", "velocity": "m/s", "position": "m", "spool opening": "m", "pressure 1": "Pa",
    "pressure 2": "Pa", "pressure difference": "Pa", "command": "V",
}  # fmt: skip
"""Quantities that a term may depend on, with their units; the first one, "", stands for none."""
FORMS: Final = ("1", "x", "|x|", "x^2", "x |x|", "wave", "bump")
"""How a term depends on its quantity x. A wave is sin(2 pi x / at + by), and a bump is
exp(-((x - at) / by)^2)."""
WAVE: Final = FORMS.index("wave")
BUMP: Final = FORMS.index("bump")
POWERS: Final = (0, 1, 1, 2, 2, 0, 0)
"""Power of the quantity in each of `FORMS`, from which the unit of a term's size follows."""

FORCE: Final = 1.0
FLOW_1: Final = 2.0
FLOW_2: Final = 3.0
SPOOL: Final = 4.0
_TURNING: Final = 5e-3
"""Velocity in m/s over which a flow or a spool shift changes its sign with the direction of motion.
A force that does so is friction and is added to the bristles' level (`added_friction`)."""


class AddedTerm(NamedTuple):
    """One term in symbols: where it is added, the quantity it depends on, its form and its size.

    Attributes:
        place: a key of `PLACES`.
        of: a key of `QUANTITIES`.
        form: one of `FORMS`.
        turned: whether the term is multiplied by the sign of the velocity.
        size: factor on the form, SI, in `size_unit`.
        at: period of a wave or middle of a bump, in the unit of the quantity; else without effect.
        by: phase of a wave in rad, or width of a bump in the unit of the quantity; else without
            effect.
    """

    place: str
    of: str
    form: str
    turned: bool
    size: float
    at: float = 0.0
    by: float = 0.0

    @property
    def size_unit(self) -> str:
        """Return the SI unit of the term's size."""
        return size_unit(self.place, self.of, self.form)


def size_unit(place: str, of: str, form: str) -> str:
    """Return the SI unit of a term's size, for example "N/(m/s)^2"."""
    power = POWERS[FORMS.index(form)]
    if power == 0:
        return PLACES[place]
    return f"{PLACES[place]}/({QUANTITIES[of]})" + ("^2" if power == 2 else "")


def fields_of(terms: "tuple[AddedTerm, ...]") -> dict[str, float]:
    """Return the values of all fields of `Parameters` that hold terms, by field name.

    Fields of terms that are not used are 0. This is the inverse of `terms_of`.

    Raises:
        ValueError: a term's place, quantity or form is not known, or there are too many terms.
    """
    if len(terms) > MOST_TERMS:
        raise ValueError(f"{len(terms)} terms; a model holds {MOST_TERMS}")
    found: dict[str, float] = {}
    for number in range(1, MOST_TERMS + 1):
        kind = size = at = by = 0.0
        if number <= len(terms):
            term = terms[number - 1]
            digits = (
                1 + tuple(PLACES).index(term.place), tuple(QUANTITIES).index(term.of),
                FORMS.index(term.form), int(term.turned),
            )  # fmt: skip
            kind = float("".join(map(str, digits)))
            size, at, by = term.size, term.at, term.by
        found |= {
            f"term_{number}_kind": kind, f"term_{number}_size": size,
            f"term_{number}_at": at, f"term_{number}_by": by,
        }  # fmt: skip
    return found


def terms_of(par: Parameters) -> tuple[AddedTerm, ...]:
    """Return the terms in symbols that a rig's parameters hold; () if there is none."""
    found = []
    for number in range(1, MOST_TERMS + 1):
        kind, size, at, by = (
            getattr(par, f"term_{number}_{part}") for part in ("kind", "size", "at", "by")
        )
        if kind == 0.0:
            continue
        place, of, form, turned = map(int, f"{int(kind):04d}")
        found.append(
            AddedTerm(tuple(PLACES)[place - 1], tuple(QUANTITIES)[of], FORMS[form], bool(turned),
                      size, at, by)
        )  # fmt: skip
    return tuple(found)


@inlined
def _digit(kind, unit):
    """Return the decimal digit of a kind at the place of `unit`, which is 1, 10, 100 or 1000."""
    return floor(kind / unit) - 10.0 * floor(kind / (10.0 * unit))


@inlined
def _sine(turns):
    """Return the sine, accurate to 1e-11, of an angle in turns.

    It is computed by arithmetic alone, as there is no other sine on lanes.
    """
    r = turns - floor(turns + 0.5)
    r = select(r > 0.25, 0.5 - r, select(r < -0.25, -0.5 - r, r))
    angle = 2.0 * pi * r
    square = angle * angle
    total = 1.0 - square * (1 / 210)
    for factor in (1 / 156, 1 / 110, 1 / 72, 1 / 42, 1 / 20, 1 / 6):
        total = 1.0 - square * factor * total
    return angle * total


@inlined
def _shape(form, x, at, by):
    """Return the value of a form, an index into `FORMS`, at the value x of its quantity."""
    size = abs(x)
    period = select(form == WAVE, at, 1.0)
    away = (x - at) / select(form == BUMP, by, 1.0)
    wave = _sine(x / period + by * (0.5 / pi))
    shape = select(form == WAVE, wave, exp(-min(away * away, 700.0)))
    shape = select(form == 4.0, x * size, shape)
    shape = select(form == 3.0, x * x, shape)
    shape = select(form == 2.0, size, shape)
    shape = select(form == 1.0, x, shape)
    return select(form == 0.0, 1.0, shape)


@inlined
def _term(kind, size, at, by, place, turned, v, x, spool, p1, p2, command):
    """Return the value of one term if its place and its last digit are the given ones, else 0.

    The sign of the velocity is not included; the caller multiplies with it if `turned` is 1.
    """
    of = _digit(kind, 100.0)
    quantity = select(of == 1.0, v, 0.0)
    quantity = select(of == 2.0, x, quantity)
    quantity = select(of == 3.0, spool, quantity)
    quantity = select(of == 4.0, p1, quantity)
    quantity = select(of == 5.0, p2, quantity)
    quantity = select(of == 6.0, p1 - p2, quantity)
    quantity = select(of == 7.0, command, quantity)
    value = size * _shape(_digit(kind, 10.0), quantity, at, by)
    here = (_digit(kind, 1000.0) == place) & (_digit(kind, 1.0) == turned)
    return select(here, value, 0.0)


@inlined
def _terms(place, turned, v, x, spool, p1, p2, command, par):
    return (
        _term(par.term_1_kind, par.term_1_size, par.term_1_at, par.term_1_by, place, turned,
              v, x, spool, p1, p2, command)
        + _term(par.term_2_kind, par.term_2_size, par.term_2_at, par.term_2_by, place, turned,
                v, x, spool, p1, p2, command)
        + _term(par.term_3_kind, par.term_3_size, par.term_3_at, par.term_3_by, place, turned,
                v, x, spool, p1, p2, command)
    )  # fmt: skip


@inner
def added(place, v, x, spool, p1, p2, command, par):
    """Return the sum of all terms that are added at a place, in the unit of the place.

    Forces that change sign with the direction of motion are left out; see `added_friction`.

    Args:
        place: FORCE, FLOW_1, FLOW_2 or SPOOL.
        v: velocity of the ram, m/s.
        x: position of the ram, m.
        spool: displacement of the spool, m.
        p1: pressure of the oil in chamber 1, Pa.
        p2: pressure of the oil in chamber 2, Pa.
        command: command that acts on the spool, V.
        par: `Parameters`, which hold the terms.
    """
    total = _terms(place, 0.0, v, x, spool, p1, p2, command, par)
    if place != FORCE:
        turned = _terms(place, 1.0, v, x, spool, p1, p2, command, par)
        total = total + turned * v / sqrt(v * v + _TURNING * _TURNING)
    return total


@inner
def added_friction(v, x, spool, p1, p2, command, par):
    """Return the sum in N of the force terms that change sign with the direction of motion.

    It is added to the friction level. The arguments are as in `added`.
    """
    return _terms(FORCE, 1.0, v, x, spool, p1, p2, command, par)
