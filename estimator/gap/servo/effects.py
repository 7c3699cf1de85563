"""This module says how each effect of the catalogue is fitted: its probes, bounds and starts."""

from typing import Final

from estimator.gap.plant import Effect, Knob, Nuisance, Proposal
from rig.plant import CATALOGUE, NOMINAL, Parameters

from .likeness import LIKE
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


def _knob(
    name: str, key: str, probe: float, logarithmic: bool = False, upper: float | None = None
) -> Knob:
    """Return an effect's knob with the catalogue's plausible bounds.

    `upper` replaces the upper bound. `probe` is in SI units.
    """
    of = next(knob for knob in CATALOGUE[name].parameters if knob.name == key)
    return Knob(
        key, of.field, probe, of.lower, of.upper if upper is None else upper,
        (of.followed_by,) if of.followed_by else (), logarithmic,
    )  # fmt: skip


def _effect(
    name: str, where: str, *knobs: Knob, starts: tuple[dict[str, float], ...] = (),
    propose: Proposal | None = None,
) -> Effect:  # fmt: skip
    return Effect(
        name, CATALOGUE[name].equation, where, knobs, starts, _UNSEEN.get(name, ""), propose,
        _OWN.get(name, ()), LIKE.get(name, ()),
    )  # fmt: skip


def _one(
    name: str, where: str, probe: float, *starts: float, logarithmic: bool = False
) -> Effect:  # fmt: skip
    """Return an effect whose only knob is "value".

    It needs `starts` if the cost has no slope at the neutral value.
    """
    knob = _knob(name, "value", probe, logarithmic)
    return _effect(name, where, knob, starts=tuple({"value": start} for start in starts))


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
_LINES_OWN: Final = tuple(
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
_OWN: Final[dict[str, tuple[tuple[str, str], ...]]] = {
    "spool_null_bias": (("null of the spool", ""), *_EDGES),
    "valve_deadband": _EDGES,
    "valve_underlap_leakage": _EDGES,
    "valve_flow_asymmetry": _EDGES,
    "valve_hysteresis": _PATH,
    "valve_bandwidth": _PATH,
    "valve_rate_limit": _PATH,
    "command_delay": _PATH,
    "entrained_air": _OIL,
    "bulk_modulus": _OIL,
    "supply_pressure": _LINES_OWN,
    "supply_droop": _LINES_OWN,
    "supply_ripple": _LINES_OWN,
    "return_back_pressure": _LINES_OWN,
    "friction_asymmetry": _FRICTION,
    "stiction_level": _FRICTION,
    "coulomb_level": _FRICTION,
    "stribeck_velocity": _FRICTION,
    "viscous_friction": _FRICTION,
    "presliding_compliance": _FRICTION,
    "internal_leakage": _LEAKS,
    "external_leakage_1": _LEAKS,
    "external_leakage_2": _LEAKS,
    "spring_load": _RAM,
    "constant_force": _RAM,
    "end_stop": _RAM,
    **{
        f"pressure_{i}_{what}": (
            (f"reading of pressure_{i}_Pa", f"pressure {i}"), (f"reading of pressure_{i}_Pa", ""),
        )
        for i in (1, 2)
        for what in ("bias", "gain")
    },
    "pressure_lag": tuple(
        (f"reading of pressure_{i}_Pa", of) for i in (1, 2) for of in (f"pressure {i}", "velocity")
    ),
    "position_gain": _SEEN_AT,
    "position_delay": _SEEN_AT,
    "position_backlash": _SEEN_AT,
}  # fmt: skip
"""Places and quantities in which an effect's formula is a curve (`Effect.own`)."""

_N: Final = NOMINAL
EFFECTS: Final = {
    effect.name: effect
    for effect in (
        _one("spool_null_bias", _FLOWS, 3e-7),
        _one("valve_deadband", _FLOWS, 3e-7, 1e-6, 5e-6, 2e-5),
        _one("valve_underlap_leakage", _FLOWS, 3e-7, 1e-6, 5e-6, 2e-5),
        _one("valve_flow_asymmetry", _FLOWS, 0.003),
        _one("valve_hysteresis", _VALVE, 1e-7, 5e-7, 2e-6, 8e-6),
        _one("valve_bandwidth", _VALVE, 10.0, logarithmic=True),
        _effect(
            "valve_rate_limit", _VALVE, _knob("valve_rate_limit", "value", 3e-4, True, 1.0),
            propose=propose_rate_limit,
        ),
        _one("command_delay", _VALVE, 2e-4, 1e-3, 5e-3, 1.5e-2),
        _one("entrained_air", _FLOWS, 1e-3),
        # These starts lie beyond the tolerance of the nuisance, where the effect is far from
        # linear.
        _one(
            "bulk_modulus", _FLOWS, 0.01 * _N.bulk_modulus,
            0.6 * _N.bulk_modulus, 0.8 * _N.bulk_modulus, 1.4 * _N.bulk_modulus,
            logarithmic=True,
        ),
        _one("supply_pressure", _FLOWS, 0.005 * _N.supply_pressure),
        _one("supply_droop", _FLOWS, 3e11),
        _effect(
            "supply_ripple", _FLOWS,
            _knob("supply_ripple", "amplitude", 2e4),
            _knob("supply_ripple", "frequency", 2e-3),
            _knob("supply_ripple", "phase", 0.05),
            propose=propose_ripple,
        ),
        _one("return_back_pressure", _FLOWS, 3e11),
        _one("friction_asymmetry", _FORCE, 10.0),
        _one("stiction_level", _FORCE, 30.0),
        _one("coulomb_level", _FORCE, 10.0),
        _one("stribeck_velocity", _FORCE, 1e-3, logarithmic=True),
        _one("viscous_friction", _FORCE, 10.0),
        _one("presliding_compliance", _FORCE, 1e6, logarithmic=True),
        _one("internal_leakage", _FLOWS, 3e-10, 5e-10, 4e-9),
        _one("external_leakage_1", _FLOWS, 3e-10, 3e-10, 3e-9),
        _one("external_leakage_2", _FLOWS, 3e-10, 3e-10, 3e-9),
        _effect(
            "spring_load", _FORCE,
            _knob("spring_load", "stiffness", 300.0), _knob("spring_load", "contact", 2e-3),
            propose=propose_spring,
        ),
        _one("constant_force", _FORCE, 10.0),
        _one("payload_mass", _FORCE, 0.5),
        _effect(
            "end_stop", _FORCE,
            _knob("end_stop", "stiffness", 1e6, True),
            _knob("end_stop", "low", 5e-5), _knob("end_stop", "high", 5e-5),
            propose=propose_end_stop,
        ),
        _one("pressure_1_bias", "pressure_1_Pa", 1e4),
        _one("pressure_2_bias", "pressure_2_Pa", 1e4),
        _one("pressure_1_gain", "pressure_1_Pa", 2e-3),
        _one("pressure_2_gain", "pressure_2_Pa", 2e-3),
        _one("pressure_lag", "pressure_1_Pa and pressure_2_Pa", 2e-4, 1e-3, 5e-3, 2e-2),
        _one("position_gain", "position_m", 1e-3),
        _effect(
            "position_delay", "position_m", _knob("position_delay", "value", 2e-4),
            starts=({"value": 1e-3},), propose=propose_position_delay,
        ),
        _one("position_backlash", "position_m", 2e-5, 5e-5, 2e-4, 8e-4),
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
