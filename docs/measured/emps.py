"""The positioning axis EMPS, as `rig gap --plant emps.py:emps` takes it.

    M q'' = g u - Fv q' - Fc sgn(q')

with the voltage u to the motor's amplifier and the position q of the carriage.
"""

import math

from estimator.gap.plant.description import (
    Channel,
    EquationOf,
    Input,
    MayLack,
    PlantDescription,
    RegionOf,
    StateOf,
    reading,
    slope,
)
from estimator.gap.plant.interface import Parameter

FASTEST_S = 0.06e-3  # friction follows the velocity no faster: 8 substeps are stable
DAMPING_S = 5e-3  # of the elastic contact at rest


def rates(state, inputs, par):
    """Return the rates of position (m/s), velocity (m/s^2) and grip (1/s), friction over Fc."""
    v = state.velocity
    forward = math.copysign(1.0, v)
    level = par.coulomb * (1.0 + par.coulomb_asymmetry * forward)
    level += par.stribeck_force * math.exp(-((v / par.stribeck_velocity) ** 2))
    grip_rate = v - abs(v) * state.grip * par.coulomb / level
    grip_rate /= par.presliding + abs(v) * FASTEST_S
    friction = par.coulomb * (state.grip + DAMPING_S * grip_rate)
    friction += par.viscous * (1.0 + par.viscous_asymmetry * forward) * v
    return v, (par.gain * inputs.motor_V - friction - par.offset) / par.mass, grip_rate


def readings(state, inputs, par):
    """Return what is measured: the position (m)."""
    return (state.position,)


emps = PlantDescription(
    name="emps",
    inputs=(Input("motor_V", "V", size=5.0),),
    outputs=(Channel("position_m", "m", noise=0.03e-6, resolution=0.05e-6, shown=("um", 1e6)),),
    states=(
        StateOf("position", "m", start=reading("position_m"), spread=1e-5),
        StateOf("velocity", "m/s", start=slope("position_m"), spread=1e-2),
        StateOf("grip", "", start=0.0, spread=0.5),
    ),
    parameters=(
        Parameter("gain", "N/V", 1.0, 1000.0, about="g, of amplifier, motor and screw"),
        Parameter("mass", "kg", 0.1, 1000.0, about="M, all that moves, at the carriage"),
        Parameter("viscous", "N s/m", 0.0, 5000.0, about="Fv"),
        Parameter("coulomb", "N", 0.1, 1000.0, about="Fc"),
        Parameter("presliding", "m", 1e-6, 1e-3, about="the contact gives way by this"),
        Parameter("offset", "N", -100.0, 100.0, neutral=0.0),
        Parameter("coulomb_asymmetry", "", -0.9, 0.9, neutral=0.0),
        Parameter("viscous_asymmetry", "", -0.9, 0.9, neutral=0.0),
        Parameter("stribeck_force", "N", 0.0, 500.0, neutral=0.0),
        Parameter("stribeck_velocity", "m/s", 1e-3, 0.2, neutral=0.02),
        Parameter("delay", "s", 0.0, 0.02, neutral=0.0, probe=1e-4),
    ),
    rates=rates,
    readings=readings,
    input_delay="delay",
    substeps=8,
    effects=(
        MayLack("offset", "M q'' = ... - offset", "force balance", {"value": "offset"}),
        MayLack(
            "coulomb_asymmetry", "Fc (1 + a) forward, Fc (1 - a) backward", "force balance",
            {"value": "coulomb_asymmetry"}, unseen="while it moves it is an offset of a Fc",
        ),
        MayLack(
            "viscous_asymmetry", "Fv (1 + a) forward, Fv (1 - a) backward", "force balance",
            {"value": "viscous_asymmetry"},
            own=(("force balance", "velocity"), ("viscous", "velocity")),
        ),
        MayLack(
            "stribeck", "Fc + Fs exp(-(q'/vs)^2)", "force balance",
            {"force": "stribeck_force", "velocity": "stribeck_velocity"},
            starts=({"force": 5.0, "velocity": 0.005}, {"force": 5.0, "velocity": 0.02}),
        ),
        MayLack("delay", "u acts later", "motor_V", {"value": "delay"}, ({"value": 1e-3},)),
    ),
    tolerances={"mass": 0.3, "viscous": 0.5, "coulomb": 0.5, "presliding": 0.8},
    equations=(
        EquationOf(
            "force balance", "N", "velocity", per=lambda state, par: -1.0 / par.mass,
            error=2.0, of=("velocity", "position", "motor voltage"),
        ),
    ),
    regions=(
        RegionOf("velocity", "m/s", lambda state, inputs: state.velocity, ("mm/s", 1e3)),
        RegionOf("position", "m", lambda state, inputs: state.position, ("mm", 1e3)),
        RegionOf("motor voltage", "V", lambda state, inputs: inputs.motor_V),
    ),
    not_told_apart={
        frozenset(("offset", "coulomb_asymmetry")):
            "while the axis moves they are the same force; only how it stands tells them apart",
    },
)  # fmt: skip
