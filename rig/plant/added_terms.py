"""Terms that are added to the plant's equations: at most three that a model has beside its effects.

The gap workflow writes such terms where no effect of the catalogue explains a disagreement
(docs/gap.md). A term is a form in symbols, such as 180 N sin(2 pi x / 42 mm + 0.4), or a table,
which is linear between its knots. It is added to the force balance, to a chamber's flow, to the
leak across the piston, to the openings of the valve's edges or to the spool's reference.

`Parameters` has four fields for each term: kind, size, `at` and `by`. The kind is a number of four
digits: 1 + index in PLACES, index in QUANTITIES, index in FORMS, and 1 if the sign follows the
direction of motion. A kind of 0 means no term. The knots of at most two tables are fields besides;
the first table belongs to the first term and the second to the second, so that tables come before
all other terms. Knots that a table does not need repeat its last one.
"""

from itertools import pairwise
from math import exp, floor, pi, sqrt
from typing import Final, NamedTuple

from rig.lanes import select

from .compiled import inlined, inner
from .parameters import MOST_KNOTS, MOST_TABLES, Parameters, quantities

MOST_TERMS: Final = 3
MOST_OTHERS: Final = 4
"""Greatest numbers of terms that a model has: held by the plant, and beside these (`is_held`)."""

PLACES: Final = {
    "force balance": "N", "flow, chamber 1": "m^3/s", "flow, chamber 2": "m^3/s", "spool": "m",
    "leak across the piston": "m^3/(s Pa^0.5)", "valve edges": "m",
}  # fmt: skip
"""Where a term is added, with its unit: a force against extension, a flow into a chamber, a shift
of the spool's reference, an opening from chamber 1 to chamber 2, or an opening by which all four
edges of the valve are open besides its own."""
MOVING_OIL: Final = (
    "flow, chamber 1", "flow, chamber 2", "leak across the piston", "valve edges",
)  # fmt: skip
"""Places where a term takes oil out of a chamber, or into one, in the accounts of a leak detector
too."""
QUANTITIES: Final = {
    "": "", "velocity": "m/s", "position": "m", "spool opening": "m", "pressure 1": "Pa",
    "pressure 2": "Pa", "pressure difference": "Pa", "command": "V",
}  # fmt: skip
"""Quantities that a term may depend on, with their units; the first one, "", stands for none."""
_NOT_HELD: Final = {
    "command": "V", "reading of position_m": "m", "reading of pressure_1_Pa": "Pa",
    "reading of pressure_2_Pa": "Pa", "reading of spool_m": "m", "friction level": "N",
    "viscous friction": "N s/m", "null of the spool": "m", "spool per volt": "m/V",
    "discharge coefficient": "", "bulk modulus": "Pa", "supply pressure": "Pa",
    "return pressure": "Pa", "payload": "kg", "gain of pressure 1": "",
    "gain of pressure 2": "", "gain of the position": "",
    **{f"parameter {name}": quantity.unit for name, quantity in quantities().items()},
}  # fmt: skip
"""Other places, with their units, where a model file may add a term. The plant cannot hold it."""
TIME: Final = "time"
"""A quantity that a term of a model file may depend on, but not one that the plant holds."""
FORMS: Final = ("1", "x", "|x|", "x^2", "x |x|", "wave", "bump", "hinge", "table")
"""How a term depends on its quantity x. A wave is sin(2 pi x / at + by), a bump is
exp(-((x - at) / by)^2), and a hinge is max(0, x - at). A table is linear between its knots, and
constant beyond the first and the last."""
*_, WAVE, BUMP, HINGE, TABLE = range(len(FORMS))
POWERS: Final = (0, 1, 1, 2, 2, 0, 0, 1, 0)
"""Power of the quantity in each of `FORMS`, from which the unit of a term's size follows."""

_PARTS: Final = ("kind", "size", "at", "by")
_FIELDS: Final = tuple(name for name in Parameters._fields if name.startswith(("term_", "table_")))
"""Parts of a term, and the fields of `Parameters` that hold terms and their tables."""

_TURNING: Final = 5e-3
"""Velocity in m/s over which a flow, an opening or a spool shift changes its sign with the
direction of motion. A force that does so is friction and is added to the bristles' level
(`Added.friction`)."""


class AddedTerm(NamedTuple):
    """One term: where it is added, the quantity it depends on, its form and its size.

    Attributes:
        place: a key of `PLACES`, or of `place_units` where the plant does not hold the term.
        of: a key of `QUANTITIES`, or "time" where the plant does not hold the term.
        form: one of `FORMS`.
        turned: whether the term is multiplied by the sign of the velocity.
        size: factor on the form, SI (`unit_per`); of a table, a plain number, usually 1.
        at: period of a wave, middle of a bump or position of a hinge, in the unit of the quantity;
            else without effect.
        by: phase of a wave in rad, or width of a bump in the unit of the quantity; else without
            effect.
        knots: of a table, 2 to `MOST_KNOTS` pairs of the quantity, strictly ascending, and the
            term's value there, both SI; else empty.
    """

    place: str
    of: str
    form: str
    turned: bool
    size: float
    at: float = 0.0
    by: float = 0.0
    knots: tuple[tuple[float, float], ...] = ()


def place_units() -> dict[str, str]:
    """Return the SI unit of each place that a term of a model may name, held by the plant or not.

    The places are those of `PLACES`, the command, the readings and the parameters of the plant.
    """
    return PLACES | _NOT_HELD


def quantity_unit(of: str) -> str:
    """Return the SI unit of a quantity that a term of a model may depend on; "" for none."""
    return "s" if of == TIME else QUANTITIES[of]


def is_held(term: AddedTerm) -> bool:
    """Return whether the plant can hold a term; it then counts in simulations and filters."""
    return term.place in PLACES and term.of in QUANTITIES


def unit_per(unit: str, of_unit: str, form: str) -> str:
    """Return the SI unit of a term's size, for example "N/(m/s)^2", or of a table's values.

    Args:
        unit: SI unit of the place that the term is added to.
        of_unit: SI unit of the quantity that it depends on.
        form: one of `FORMS`.
    """
    power = POWERS[FORMS.index(form)]
    if power == 0:
        return unit
    return f"{unit or '1'}/({of_unit or '1'})" + ("^2" if power == 2 else "")


def fields_of(terms: "tuple[AddedTerm, ...]") -> dict[str, float]:
    """Return the values of all fields of `Parameters` that hold terms, by field name.

    Tables become the first terms. Fields that are not used are 0. This is the inverse of
    `terms_of`.

    Raises:
        ValueError: a term's place, quantity or form is not known, a table's knots are not as
            `AddedTerm` says, or there are too many terms or tables.
    """
    tables = [term for term in terms if term.form == "table"]
    if len(terms) > MOST_TERMS:
        raise ValueError(f"{len(terms)} terms; a model holds {MOST_TERMS}")
    if len(tables) > MOST_TABLES:
        raise ValueError(f"{len(tables)} tables; of its terms a model holds {MOST_TABLES} tables")
    ordered = [*tables, *(term for term in terms if term.form != "table")]
    found = dict.fromkeys(_FIELDS, 0.0)
    for number, term in enumerate(ordered, 1):
        kind = 1000 * (1 + tuple(PLACES).index(term.place)) + 100 * tuple(QUANTITIES).index(term.of)
        kind += 10 * FORMS.index(term.form) + term.turned
        parts = (float(kind), term.size, term.at, term.by)
        found |= zip((f"term_{number}_{part}" for part in _PARTS), parts, strict=True)
    for number, table in enumerate(tables, 1):
        knots = table.knots
        if not 2 <= len(knots) <= MOST_KNOTS:
            raise ValueError(f"{len(knots)} knots; a table has 2 to {MOST_KNOTS}")
        if any(not after[0] > before[0] for before, after in pairwise(knots)):
            raise ValueError("the knots of a table are not in strictly ascending order")
        for k in range(MOST_KNOTS):
            at, value = knots[min(k, len(knots) - 1)]
            found |= {f"table_{number}_at_{k + 1}": at, f"table_{number}_value_{k + 1}": value}
    return found


def terms_of(par: Parameters) -> tuple[AddedTerm, ...]:
    """Return the terms that a rig's parameters hold, tables first; () if there is none."""
    found = []
    for number in range(1, MOST_TERMS + 1):
        kind, size, at, by = (getattr(par, f"term_{number}_{part}") for part in _PARTS)
        if kind == 0.0:
            continue
        place, of, form, turned = map(int, f"{int(kind):04d}")
        where, what = tuple(PLACES)[place - 1], tuple(QUANTITIES)[of]
        knots = _knots_of(par, number) if form == TABLE else ()
        found.append(AddedTerm(where, what, FORMS[form], bool(turned), size, at, by, knots))
    return tuple(found)


def _knots_of(par: Parameters, number: int) -> tuple[tuple[float, float], ...]:
    """Return the knots of the table with this number, without the repeated ones."""
    knots = [
        (getattr(par, f"table_{number}_at_{k}"), getattr(par, f"table_{number}_value_{k}"))
        for k in range(1, MOST_KNOTS + 1)
    ]
    return (knots[0], *(after for before, after in pairwise(knots) if after[0] > before[0]))


class Added(NamedTuple):
    """What all terms of a model add up to in one state of the rig, SI; compiled code makes it.

    Attributes:
        force: force against extension, N, without friction.
        friction: force against the motion, N, which is added to the friction level.
        flow_1: flow into chamber 1, m^3/s.
        flow_2: flow into chamber 2, m^3/s.
        spool: shift of the spool's reference, m.
        leak: opening from chamber 1 to chamber 2, m^3/(s Pa^0.5).
        edges: opening of all four edges of the valve, besides that of the spool, m.
    """

    force: float
    friction: float
    flow_1: float
    flow_2: float
    spool: float
    leak: float
    edges: float


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
def _shape(form, x, at, by, table):
    """Return the value of a form, an index into `FORMS`, at the value x of its quantity.

    `table` is the value there of the table that belongs to the term.
    """
    size = abs(x)
    period = select(form == WAVE, at, 1.0)
    away = (x - at) / select(form == BUMP, by, 1.0)
    wave = _sine(x / period + by * (0.5 / pi))
    shape = select(form == WAVE, wave, exp(-min(away * away, 700.0)))
    shape = select(form == TABLE, table, shape)
    shape = select(form == HINGE, max(x - at, 0.0), shape)
    shape = select(form == 4.0, x * size, shape)
    shape = select(form == 3.0, x * x, shape)
    shape = select(form == 2.0, size, shape)
    shape = select(form == 1.0, x, shape)
    return select(form == 0.0, 1.0, shape)


@inlined
def _quantity(kind, v, x, spool, p1, p2, command):
    """Return the value of the quantity that a term of this kind depends on; 0 for none."""
    of = _digit(kind, 100.0)
    quantity = select(of == 1.0, v, 0.0)
    quantity = select(of == 2.0, x, quantity)
    quantity = select(of == 3.0, spool, quantity)
    quantity = select(of == 4.0, p1, quantity)
    quantity = select(of == 5.0, p2, quantity)
    quantity = select(of == 6.0, p1 - p2, quantity)
    return select(of == 7.0, command, quantity)


@inlined
def _further(x, knot, piece, after):
    """Return the piece of a table from `knot` to `after` if x is beyond `knot`, else `piece`.

    A knot is a pair (x, y), and a piece is its two ends (x, y, x, y).
    """
    beyond = x > knot[0]
    return (
        select(beyond, knot[0], piece[0]),
        select(beyond, knot[1], piece[1]),
        select(beyond, after[0], piece[2]),
        select(beyond, after[1], piece[3]),
    )


@inner
def _table(x, x1, y1, x2, y2, x3, y3, x4, y4, x5, y5, x6, y6, x7, y7, x8, y8, x9, y9):
    """Return the value at x of a table with the knots (x1, y1) to (x9, y9)."""
    piece = _further(x, (x2, y2), (x1, y1, x2, y2), (x3, y3))
    piece = _further(x, (x3, y3), piece, (x4, y4))
    piece = _further(x, (x4, y4), piece, (x5, y5))
    piece = _further(x, (x5, y5), piece, (x6, y6))
    piece = _further(x, (x6, y6), piece, (x7, y7))
    piece = _further(x, (x7, y7), piece, (x8, y8))
    left, low, right, high = _further(x, (x8, y8), piece, (x9, y9))
    # Where the last knot is repeated, the piece beyond it has no length.
    share = (x - left) / select(right > left, right - left, 1.0)
    return low + (high - low) * min(max(share, 0.0), 1.0)


@inner
def _value(kind, size, at, by, x, table):
    """Return the value of a term where its quantity is x, in the unit of its place.

    The sign of the velocity is not included.
    """
    return size * _shape(_digit(kind, 10.0), x, at, by, table)


@inlined
def _entry(kind):
    """Return a number of two digits, the first and the last of a term's kind: place and turning."""
    return 10.0 * _digit(kind, 1000.0) + _digit(kind, 1.0)


@inlined
def _sum(entry, entries, values):
    """Return the sum of the values of those three terms whose `_entry` is the given one."""
    return (
        select(entries[0] == entry, values[0], 0.0)
        + select(entries[1] == entry, values[1], 0.0)
        + select(entries[2] == entry, values[2], 0.0)
    )


@inner
def added(v, x, spool, p1, p2, command, par):
    """Return what all terms add up to, as `Added`.

    Args:
        v: velocity of the ram, m/s.
        x: position of the ram, m.
        spool: displacement of the spool, m.
        p1: pressure of the oil in chamber 1, Pa.
        p2: pressure of the oil in chamber 2, Pa.
        command: command that acts on the spool, V.
        par: `Parameters`, which hold the terms.
    """
    kind_1, kind_2, kind_3 = par.term_1_kind, par.term_2_kind, par.term_3_kind
    q1 = _quantity(kind_1, v, x, spool, p1, p2, command)
    q2 = _quantity(kind_2, v, x, spool, p1, p2, command)
    q3 = _quantity(kind_3, v, x, spool, p1, p2, command)
    table_1 = _table(
        q1, par.table_1_at_1, par.table_1_value_1, par.table_1_at_2, par.table_1_value_2,
        par.table_1_at_3, par.table_1_value_3, par.table_1_at_4, par.table_1_value_4,
        par.table_1_at_5, par.table_1_value_5, par.table_1_at_6, par.table_1_value_6,
        par.table_1_at_7, par.table_1_value_7, par.table_1_at_8, par.table_1_value_8,
        par.table_1_at_9, par.table_1_value_9,
    )  # fmt: skip
    table_2 = _table(
        q2, par.table_2_at_1, par.table_2_value_1, par.table_2_at_2, par.table_2_value_2,
        par.table_2_at_3, par.table_2_value_3, par.table_2_at_4, par.table_2_value_4,
        par.table_2_at_5, par.table_2_value_5, par.table_2_at_6, par.table_2_value_6,
        par.table_2_at_7, par.table_2_value_7, par.table_2_at_8, par.table_2_value_8,
        par.table_2_at_9, par.table_2_value_9,
    )  # fmt: skip
    values = (
        _value(kind_1, par.term_1_size, par.term_1_at, par.term_1_by, q1, table_1),
        _value(kind_2, par.term_2_size, par.term_2_at, par.term_2_by, q2, table_2),
        _value(kind_3, par.term_3_size, par.term_3_at, par.term_3_by, q3, 0.0 * q3),
    )
    entries = (_entry(kind_1), _entry(kind_2), _entry(kind_3))
    speed = sqrt(v * v + _TURNING * _TURNING)
    return Added(
        _sum(10.0, entries, values),
        _sum(11.0, entries, values),
        _sum(20.0, entries, values) + _sum(21.0, entries, values) * v / speed,
        _sum(30.0, entries, values) + _sum(31.0, entries, values) * v / speed,
        _sum(40.0, entries, values) + _sum(41.0, entries, values) * v / speed,
        _sum(50.0, entries, values) + _sum(51.0, entries, values) * v / speed,
        _sum(60.0, entries, values) + _sum(61.0, entries, values) * v / speed,
    )
