"""How the effects of the catalogue are fitted: knobs, visible changes, where to start from."""

from typing import Final

from rig.plant import NOMINAL, Parameters, quantities

from .plant import Effect, Knob, Nuisance

_VALVE: Final = "spool"
_FLOWS: Final = "flows of both chambers"
_FORCE: Final = "force balance"
_QUANTITIES: Final = quantities()

# Name, where it enters, what a probe changes and where a fit starts if the neutral value is no
# start: (key, parameter, probe, bounds or None for those of the parameter, followers), starts.
_Row = tuple[
    str,
    str,
    tuple[tuple[str, str, float, tuple[float, float] | None, tuple[str, ...]], ...],
    tuple[dict[str, float], ...],
]


def _one(
    name: str,
    where: str,
    probe: float,
    bounds: tuple[float, float] | None = None,
    *,
    parameter: str | None = None,
    follows: tuple[str, ...] = (),
    starts: tuple[float, ...] = (),
) -> Effect:
    field = parameter or name
    limits = bounds or (_QUANTITIES[field].lower, _QUANTITIES[field].upper)
    knob = Knob("value", field, probe, *limits, follows)
    return Effect(name, name, where, (knob,), tuple({"value": start} for start in starts))


_N: Final = NOMINAL
EFFECTS: Final = {
    effect.name: effect
    for effect in (
        _one("spool_null_bias", _FLOWS, 3e-7),
        _one("valve_deadband", _FLOWS, 3e-7, starts=(1e-6, 5e-6, 15e-6)),
        _one("valve_underlap_leakage", _FLOWS, 3e-7, starts=(1e-6, 5e-6, 15e-6)),
        _one("valve_flow_asymmetry", _FLOWS, 0.003),
        _one("valve_hysteresis", _VALVE, 1e-7, starts=(5e-7, 2e-6, 6e-6)),
        _one("valve_bandwidth", _VALVE, 20.0, (100.0, 3000.0), parameter="valve_natural_frequency"),
        _one("valve_rate_limit", _VALVE, 0.001, (2e-3, 1.0), starts=(0.01, 0.03, 0.06)),
        _one("command_delay", _VALVE, 2e-4, (0.0, 0.019), starts=(1e-3,)),
        _one("entrained_air", _FLOWS, 1e-3),
        _one("bulk_modulus", _FLOWS, 0.01 * _N.bulk_modulus),
        _one("supply_pressure", _FLOWS, 0.005 * _N.supply_pressure),
        _one("supply_droop", _FLOWS, 3e11),
        _one("return_back_pressure", _FLOWS, 3e11),
        _one("friction_asymmetry", _FORCE, 10.0),
        _one("stiction_level", _FORCE, 30.0, parameter="stiction"),
        _one("coulomb_level", _FORCE, 10.0, parameter="coulomb", follows=("stiction",)),
        _one("stribeck_velocity", _FORCE, 1e-3),
        _one("viscous_friction", _FORCE, 10.0, parameter="viscous"),
        _one("presliding_compliance", _FORCE, 1e6, (4e5, 2e7), parameter="bristle_stiffness"),
        _one("internal_leakage", _FLOWS, 3e-10),
        _one("external_leakage_1", _FLOWS, 3e-10),
        _one("external_leakage_2", _FLOWS, 3e-10),
        Effect(
            "spring_load",
            "",
            _FORCE,
            (
                Knob("stiffness", "spring_stiffness", 300.0, 0.0, 5e6),
                Knob("contact", "spring_contact", 2e-3, -0.1, 0.6),
            ),
            tuple(
                {"stiffness": k, "contact": x}
                for k in (3e3, 2e4)
                for x in (0.05, 0.15, 0.25, 0.35, 0.45)
            ),
        ),
        _one("constant_force", _FORCE, 10.0),
        _one("payload_mass", _FORCE, 0.5),
        Effect("end_stop", "", _FORCE, (Knob("stiffness", "stop_stiffness", 3e6, 1e6, 1e9),), ()),
        _one("pressure_1_bias", "pressure_1_Pa", 1e4),
        _one("pressure_2_bias", "pressure_2_Pa", 1e4),
        _one("pressure_1_gain", "pressure_1_Pa", 2e-3),
        _one("pressure_2_gain", "pressure_2_Pa", 2e-3),
        _one("pressure_lag", "pressure_1_Pa and pressure_2_Pa", 2e-4, starts=(1e-3, 5e-3)),
        _one("position_gain", "position_m", 1e-3),
        _one("position_delay", "position_m", 2e-4, (0.0, 0.019), starts=(1e-3,)),
        _one("position_backlash", "position_m", 2e-5, starts=(5e-5, 2e-4)),
    )
}
NOT_TOLD_APART: Final[dict[frozenset[str], str]] = {}


def nuisances(par: Parameters) -> tuple[Nuisance, ...]:
    """Return what is refitted first, about the nominal model's values (docs/gap.md)."""
    return (
        Nuisance(
            "bulk_modulus", 0.01 * par.bulk_modulus, 0.15, NOMINAL.bulk_modulus, "bulk_modulus"
        ),
        Nuisance("discharge_coefficient", 0.003, 0.05, NOMINAL.discharge_coefficient),
        Nuisance("viscous", 10.0, 0.30, NOMINAL.viscous, "viscous_friction"),
        Nuisance(
            "supply_pressure",
            0.005 * par.supply_pressure,
            0.05,
            NOMINAL.supply_pressure,
            "supply_pressure",
        ),
    )
