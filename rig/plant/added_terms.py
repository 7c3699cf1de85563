"""A disturbance in symbols that a model may hold beside its effects: at most three terms.

The gap workflow writes one where no effect of the catalogue explains what is missing
(docs/gap.md): to the force balance, a chamber's flow or the spool's reference are added terms such
as 180 N sin(2 pi x / 42 mm + 0.4). Each has a kind, a size and two places in `Parameters`. The kind
is a number of four digits, in the order of PLACES, QUANTITIES, FORMS, and 1 if it turns with the
direction of motion; 0 is no term.
"""

from math import exp, floor, pi, sqrt
from typing import Final, NamedTuple

from rig.lanes import select

from .compiled import inlined, inner
from .parameters import Parameters

MOST_TERMS: Final = 3

PLACES: Final = {"force balance": "N", "flow, chamber 1": "m^3/s", "flow, chamber 2": "m^3/s",
                 "spool": "m"}  # fmt: skip
"""What a term is added to, with its unit: a force against extension, a flow into a chamber, a shift
of where the spool is asked to be."""
QUANTITIES: Final = {
    "": "", "velocity": "m/s", "position": "m", "spool opening": "m", "pressure 1": "Pa",
    "pressure 2": "Pa", "pressure difference": "Pa", "command": "V",
}  # fmt: skip
"""Quantities that a term may depend on, with their units; the first stands for none."""
FORMS: Final = ("1", "x", "|x|", "x^2", "x |x|", "wave", "bump")
"""How a term depends on its quantity x; sin(2 pi x / at + by) is a wave, exp(-((x - at) / by)^2) a
bump."""
WAVE: Final = FORMS.index("wave")
BUMP: Final = FORMS.index("bump")
POWERS: Final = (0, 1, 1, 2, 2, 0, 0)
"""Power of the quantity in each form, from which the unit of a size follows."""

FORCE: Final = 1.0
FLOW_1: Final = 2.0
FLOW_2: Final = 3.0
SPOOL: Final = 4.0
_TURNING: Final = 5e-3
"""m/s, over which a flow or a shift of the spool that turns with the motion does so. A force that
turns is friction: it belongs to the bristles' level."""


class AddedTerm(NamedTuple):
    """One term of a disturbance that a model holds: where it enters, of what, and how large.

    Attributes:
        place: of `PLACES`.
        of: of `QUANTITIES`.
        form: of `FORMS`.
        turned: whether its sign is that of the velocity.
        size: SI, in `size_unit`.
        at: period of a wave, middle of a bump, SI.
        by: phase of a wave in rad, width of a bump, SI.
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
        """Return the SI unit of its size."""
        return size_unit(self.place, self.of, self.form)


def size_unit(place: str, of: str, form: str) -> str:
    """Return the SI unit of a term's size: "N/(m/s)^2"."""
    power = POWERS[FORMS.index(form)]
    if power == 0:
        return PLACES[place]
    return f"{PLACES[place]}/({QUANTITIES[of]})" + ("^2" if power == 2 else "")


def fields_of(terms: "tuple[AddedTerm, ...]") -> dict[str, float]:
    """Return all fields of `Parameters` that hold terms, of these.

    Raises:
        ValueError: a term's place, quantity or form is not known, or they are too many.
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
    """Return the terms that parameters hold."""
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
    """Return the digit of a kind that counts a unit of 1, 10, 100 or 1000."""
    return floor(kind / unit) - 10.0 * floor(kind / (10.0 * unit))


@inlined
def _sine(turns):
    """Return the sine of a number of turns, to 1e-11; by arithmetic, for lanes have no other."""
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
    """Return a form (`FORMS`) of a quantity."""
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
    """Return a term if it belongs to a place and turns with the motion, or not; else 0."""
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
    """Return what terms add to a place (FORCE, FLOW_1, FLOW_2, SPOOL), in its unit.

    Args:
        place: which.
        v: velocity, m/s.
        x: position, m.
        spool: its displacement, m.
        p1: of the oil in chamber 1, Pa.
        p2: of the oil in chamber 2, Pa.
        command: that acts, V.
        par: `Parameters`.
    """
    total = _terms(place, 0.0, v, x, spool, p1, p2, command, par)
    if place != FORCE:
        turned = _terms(place, 1.0, v, x, spool, p1, p2, command, par)
        total = total + turned * v / sqrt(v * v + _TURNING * _TURNING)
    return total


@inner
def added_friction(v, x, spool, p1, p2, command, par):
    """Return what terms add to the friction level in N: forces that turn with the motion."""
    return _terms(FORCE, 1.0, v, x, spool, p1, p2, command, par)
