"""This module says how each effect of the catalogue is fitted: its probes, bounds and starts.

It also reads effects off curves that were discovered. Such an effect is known by where it enters,
against what, and in which regime. The catalogue's formula may explain nothing of it: straight edges
shift the flow at large openings too, a spool that is worn round does so near its null alone.
"""

from typing import Final

import numpy as np

from estimator.gap.plant import Array, Effect, Knob, Likeness, Nuisance, Proposal
from rig.plant import CATALOGUE, NOMINAL, Parameters

from .proposals import (
    propose_end_stop,
    propose_position_delay,
    propose_rate_limit,
    propose_ripple,
    propose_spring,
)

_VALVE: Final = "spool"
_FLOWS: Final = "flows of both chambers"
_FORCE: Final = "force balance"


Places = tuple[tuple[str, str], ...]
"""Names of places that a disturbance may enter, each with the quantity that it depends on."""


_MOST: Final = 0.5
"""Least part of a curve's squares that must be of an effect's kind: half."""
_NEAR: Final = 1.0 / 3.0
"""Part of a curve's range about 0 in which a peak counts as being at the valve's null."""


def _underlap(at: Array, values: Array) -> float | None:
    """Return the underlap, m, that a curve of the valve's edges shows; None if it shows none.

    `at` (k,) is the opening of the spool and `values` (k,) the gap at the edges, both in m. The
    underlap is the greatest value. The greatest magnitude must be a positive value near null, and
    more than twice the value at either end.
    """
    top = int(np.argmax(np.abs(values)))
    near = abs(at[top]) < _NEAR * np.max(np.abs(at))
    fades = max(values[0], values[-1]) < _MOST * values[top]
    return float(values[top]) if values[top] > 0.0 and near and fades else None


def _uneven_friction(at: Array, values: Array) -> float | None:
    """Return the asymmetry of friction, N, that a force shows; None if it shows none.

    `at` (k,) is the velocity, m/s, and `values` (k,) the force against extension, N. A force that
    is the same in both directions adds to the friction of extension and takes from that of
    retraction. So the asymmetry is the mean of what is the same at equal speeds of both directions,
    which must have more than half of the squares.
    """
    reach = min(-at[0], at[-1])
    speeds = np.linspace(0.0, reach, len(at))[1:] if reach > 0.0 else np.empty(0)
    forth, back = np.interp(speeds, at, values), np.interp(-speeds, at, values)
    even, odd = 0.5 * (forth + back), 0.5 * (forth - back)
    if not even @ even > _MOST * (even @ even + odd @ odd):
        return None
    return float(np.mean(even))


def _scale(at: Array, values: Array) -> float | None:
    """Return the gain of a transducer whose error is in proportion to what it measures, else None.

    `at` (k,) is the quantity and `values` (k,) the error of its reading, both in the same SI unit.
    The gain is 1 plus the median ratio of error to quantity. The squares of what this proportion
    leaves must sum to less than half of the errors' squares.
    """
    used = at != 0.0
    slope = float(np.median(values[used] / at[used]))
    lacks = values - slope * at
    return 1.0 + slope if lacks @ lacks < _MOST * (values @ values) else None


def _effect(
    name: str, where: str, probes: float | dict[str, float], *starts: float,
    logarithmic: bool = False, upper: float | None = None, propose: Proposal | None = None,
    own: Places = (), like: Likeness | None = None,
) -> Effect:  # fmt: skip
    """Return an effect with the catalogue's plausible bounds.

    Args:
        name: name of the effect in the catalogue.
        where: equation or channel that it enters.
        probes: probe of each knob, SI, by the knob's key, or that of the only knob "value".
        starts: values of the knob "value", SI, from which fits start; it needs some if the cost has
            no slope at its neutral value.
        logarithmic: whether fits step in the logarithm of the first knob.
        upper: upper bound of the knobs, SI, in place of the catalogue's; None for the catalogue's.
        propose: as in `Effect`.
        own: as in `Effect`.
        like: the curve that is this effect; None if none is known.
    """
    known = {knob.name: knob for knob in CATALOGUE[name].parameters}
    knobs: list[Knob] = []
    for key, probe in (probes if isinstance(probes, dict) else {"value": probes}).items():
        of = known[key]
        knobs.append(
            Knob(
                key, of.field, probe, of.lower, of.upper if upper is None else upper,
                (of.followed_by,) if of.followed_by else (), logarithmic and not knobs,
            )
        )  # fmt: skip
    return Effect(
        name, CATALOGUE[name].equation, where, tuple(knobs),
        tuple({"value": at} for at in starts), _UNSEEN.get(name, ""), propose, own,
        (like,) if like else (),
    )  # fmt: skip


_SHUT: Final = "what a closed valve does, where the spool stays near its null too seldom"
_UNSEEN: Final = {
    "valve_deadband": f"{_SHUT}; a spool that crosses null quickly shows little of its edges",
    "valve_underlap_leakage": f"{_SHUT}; an internal leak is much the same at small openings",
    "valve_rate_limit": "a limit faster than any motion that was recorded",
    "command_delay": "whether the command comes late or the valve follows slowly, without "
    "frequencies near the valve's own",
    "entrained_air": "air at a pressure that hardly changes: there it is a softer oil",
    "supply_droop": "a droop at one flow only: there it is a lower supply pressure",
    "supply_ripple": "frequencies above half the sampling rate, and what the pump does at "
    "openings so small that its pressure does not reach a chamber",
    "return_back_pressure": "a rise at one flow only, and without small return pressures",
    "friction_asymmetry": "its place: while the ram moves one way only it is a constant force",
    "constant_force": "its cause: a weight, a load held or a wrong zero of a pressure difference",
    "stiction_level": "break-away without a stop or a reversal of the ram",
    "stribeck_velocity": "slow sliding that the motion passes through within some samples",
    "presliding_compliance": "motion below one count of the encoder",
    "spring_load": "where it begins, if the ram was never beyond or never before that place",
    "end_stop": "an end that the ram did not meet",
    "payload_mass": "a mass that was hardly accelerated",
    "pressure_1_bias": "whether zero or span is wrong, at a pressure that hardly changes",
    "pressure_2_bias": "whether zero or span is wrong, at a pressure that hardly changes",
    "pressure_1_gain": "whether span or zero is wrong, at a pressure that hardly changes",
    "pressure_2_gain": "whether span or zero is wrong, at a pressure that hardly changes",
    "position_gain": "a wrong zero: a shift of the whole stroke changes volumes alone",
    "position_backlash": "a play that no reversal crosses",
}

_FRICTION: Final = (
    ("friction level", "velocity"), ("force balance", "velocity"), ("friction level", ""),
    ("viscous friction", "position"), ("force balance", "direction"), ("force balance", ""),
)  # fmt: skip
_EDGES: Final = tuple(
    (place, "spool opening")
    for place in (
        "valve edges", "flow, chamber 1", "flow, chamber 2", "leak across the piston",
        "discharge coefficient", "reading of spool_m",
    )
)  # fmt: skip
_PATH: Final = (
    ("spool", "command"), ("spool", "spool opening"), ("spool per volt", "command"), ("spool", ""),
)  # fmt: skip
_OIL: Final = tuple(
    (place, f"pressure {i}")
    for i in (1, 2)
    for place in ("bulk modulus", f"flow, chamber {i}")
)  # fmt: skip
_SUPPLY: Final = tuple(
    (place, of)
    for place in ("supply pressure", "return pressure", "discharge coefficient")
    for of in ("", "velocity", "spool opening")
)
_LEAKS: Final = (
    ("leak across the piston", ""), ("leak across the piston", "pressure difference"),
    ("flow, chamber 1", "pressure 1"), ("flow, chamber 2", "pressure 2"),
)  # fmt: skip
_RAM: Final = (("force balance", "position"), ("force balance", ""))
_SEEN_AT: Final = tuple(
    ("reading of position_m", of) for of in ("", "position", "velocity", "direction")
)


def _seen(chamber: int, *of: str) -> Places:
    """Return the place of a chamber's pressure reading, paired with each of some quantities.

    The chamber is 1 or 2.
    """
    return tuple((f"reading of pressure_{chamber}_Pa", each) for each in of)


_N: Final = NOMINAL
EFFECTS: Final = {
    effect.name: effect
    for effect in (
        _effect("spool_null_bias", _FLOWS, 3e-7, own=(("null of the spool", ""), *_EDGES)),
        _effect("valve_deadband", _FLOWS, 3e-7, 1e-6, 5e-6, 2e-5, own=_EDGES),
        _effect(
            "valve_underlap_leakage", _FLOWS, 3e-7, 1e-6, 5e-6, 2e-5, own=_EDGES,
            like=Likeness("valve edges", "spool opening", _underlap),
        ),
        _effect("valve_flow_asymmetry", _FLOWS, 0.003, own=_EDGES),
        _effect("valve_hysteresis", _VALVE, 1e-7, 5e-7, 2e-6, 8e-6, own=_PATH),
        _effect("valve_bandwidth", _VALVE, 10.0, logarithmic=True, own=_PATH),
        _effect(
            "valve_rate_limit", _VALVE, 3e-4, logarithmic=True, upper=1.0,
            propose=propose_rate_limit, own=_PATH,
        ),
        _effect("command_delay", _VALVE, 2e-4, 1e-3, 5e-3, 1.5e-2, own=_PATH),
        _effect("entrained_air", _FLOWS, 1e-3, own=_OIL),
        # These starts lie beyond the tolerance of the nuisance, where the effect is far from
        # linear.
        _effect(
            "bulk_modulus", _FLOWS, 0.01 * _N.bulk_modulus,
            0.6 * _N.bulk_modulus, 0.8 * _N.bulk_modulus, 1.4 * _N.bulk_modulus,
            logarithmic=True, own=_OIL,
        ),
        _effect("supply_pressure", _FLOWS, 0.005 * _N.supply_pressure, own=_SUPPLY),
        _effect("supply_droop", _FLOWS, 3e11, own=_SUPPLY),
        _effect(
            "supply_ripple", _FLOWS, {"amplitude": 2e4, "frequency": 2e-3, "phase": 0.05},
            propose=propose_ripple, own=_SUPPLY,
        ),
        _effect("return_back_pressure", _FLOWS, 3e11, own=_SUPPLY),
        _effect(
            "friction_asymmetry", _FORCE, 10.0, own=_FRICTION,
            like=Likeness("force balance", "velocity", _uneven_friction),
        ),
        _effect("stiction_level", _FORCE, 30.0, own=_FRICTION),
        _effect("coulomb_level", _FORCE, 10.0, own=_FRICTION),
        _effect("stribeck_velocity", _FORCE, 1e-3, logarithmic=True, own=_FRICTION),
        _effect("viscous_friction", _FORCE, 10.0, own=_FRICTION),
        _effect("presliding_compliance", _FORCE, 1e6, logarithmic=True, own=_FRICTION),
        _effect("internal_leakage", _FLOWS, 3e-10, 5e-10, 4e-9, own=_LEAKS),
        _effect("external_leakage_1", _FLOWS, 3e-10, 3e-10, 3e-9, own=_LEAKS),
        _effect("external_leakage_2", _FLOWS, 3e-10, 3e-10, 3e-9, own=_LEAKS),
        _effect(
            "spring_load", _FORCE, {"stiffness": 300.0, "contact": 2e-3},
            propose=propose_spring, own=_RAM,
        ),
        _effect("constant_force", _FORCE, 10.0, own=_RAM),
        _effect("payload_mass", _FORCE, 0.5),
        _effect(
            "end_stop", _FORCE, {"stiffness": 1e6, "low": 5e-5, "high": 5e-5},
            logarithmic=True, propose=propose_end_stop, own=_RAM,
        ),
        *(
            _effect(
                f"pressure_{i}_bias", f"pressure_{i}_Pa", 1e4, own=_seen(i, f"pressure {i}", "")
            )
            for i in (1, 2)
        ),
        *(
            _effect(
                f"pressure_{i}_gain", f"pressure_{i}_Pa", 2e-3, own=_seen(i, f"pressure {i}", ""),
                like=Likeness(f"reading of pressure_{i}_Pa", f"pressure {i}", _scale),
            )
            for i in (1, 2)
        ),
        _effect(
            "pressure_lag", "pressure_1_Pa and pressure_2_Pa", 2e-4, 1e-3, 5e-3, 2e-2,
            own=(*_seen(1, "pressure 1", "velocity"), *_seen(2, "pressure 2", "velocity")),
        ),
        _effect(
            "position_gain", "position_m", 1e-3, own=_SEEN_AT,
            like=Likeness("reading of position_m", "position", _scale),
        ),
        _effect(
            "position_delay", "position_m", 2e-4, 1e-3,
            propose=propose_position_delay, own=_SEEN_AT,
        ),
        _effect("position_backlash", "position_m", 2e-5, 5e-5, 2e-4, 8e-4, own=_SEEN_AT),
    )
}  # fmt: skip

_SPAN: Final = "at pressures that hardly change, a wrong zero and a wrong span read alike"
_SOFT: Final = "at pressures that hardly change, bubbles only make the oil softer"
_LINES: Final = (
    "both take away from the drop over the valve with the square of its flow; what tells them "
    "apart is the level of the chamber pressures"
)
NOT_TOLD_APART: Final[dict[frozenset[str], str]] = {
    frozenset(pair): why
    for *pair, why in (
        ("constant_force", "friction_asymmetry",
         "while the ram moves one way or the other they are the same force; only standstill and "
         "break-away tell them apart"),
        ("command_delay", "valve_bandwidth",
         "below the valve's own frequency a slower valve is a later one"),
        ("command_delay", "position_delay", "in open loop only their sum is seen in the position"),
        ("pressure_1_bias", "pressure_1_gain", _SPAN),
        ("pressure_2_bias", "pressure_2_gain", _SPAN),
        ("constant_force", "pressure_1_bias",
         "in the force balance, a force and a wrong zero of one pressure are the same"),
        ("constant_force", "pressure_2_bias",
         "in the force balance, a force and a wrong zero of one pressure are the same"),
        ("entrained_air", "bulk_modulus", _SOFT),
        ("supply_droop", "return_back_pressure", _LINES),
        ("supply_droop", "supply_pressure",
         "at one flow, a droop is a lower pressure of the supply"),
        ("stiction_level", "coulomb_level",
         "fast sliding alone tells the two levels apart; break-away shows their sum"),
        ("stiction_level", "stribeck_velocity",
         "both shape friction between standstill and sliding"),
        ("internal_leakage", "valve_underlap_leakage",
         "near null, oil that passes the piston and oil that passes the valve's edges are alike"),
        ("valve_hysteresis", "command_delay",
         "in a motion of one speed, a play is a time that the command is late"),
        ("position_backlash", "position_delay",
         "in a motion of one speed, a play is a time that the reading is late"),
    )
}  # fmt: skip


def nuisances(par: Parameters) -> tuple[Nuisance, ...]:
    """Return the parameters that are refitted first, with their tolerances (docs/gap.md).

    The tolerances are about the nominal values of the rig; `par`, the model's parameters, only
    gives the size of two probes.
    """
    return (
        Nuisance(
            "bulk_modulus", 0.01 * par.bulk_modulus, 0.15, NOMINAL.bulk_modulus, "bulk_modulus"
        ),
        Nuisance("discharge_coefficient", 0.003, 0.05, NOMINAL.discharge_coefficient),
        Nuisance("viscous", 10.0, 0.30, NOMINAL.viscous, "viscous_friction"),
        Nuisance(
            "supply_pressure", 0.005 * par.supply_pressure, 0.05, NOMINAL.supply_pressure,
            "supply_pressure",
        ),
    )  # fmt: skip
