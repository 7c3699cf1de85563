"""An O-ring cylinder that is pulled against its pressure, as `--plant seal.py:seal` takes it.

    F = A p + Fc sgn(q') + Fv q'

with the position q of the rod and the pressure p, which are given, and the force F at the rod.
"""

from estimator.gap.plant.description import (
    Channel,
    EquationOf,
    Input,
    MayLack,
    PlantDescription,
    RegionOf,
    StateOf,
    VaryingOf,
    reading,
)
from estimator.gap.plant.interface import Parameter

FOLLOW_S = 10e-3  # the velocity is taken over one sample
CHAIN_S = 5e-3  # rod, sensor and drive pass the force on within this


def rates(state, inputs, par):
    """Return the rates of rod (m/s), grip (1/s), friction over its level, and force (N/s)."""
    v = (inputs.position_m - state.rod) / FOLLOW_S
    grip_rate = (v - abs(v) * state.grip) / (par.presliding + abs(v) * 10e-3)
    level = par.coulomb + par.pressing * (inputs.pressure_Pa - 4e5)
    force = par.area * inputs.pressure_Pa + level * state.grip + par.viscous * v + par.offset
    return v, grip_rate, (force - state.force) / CHAIN_S


def readings(state, inputs, par):
    """Return what is measured: the force (N)."""
    return (state.force,)


def velocity(state, inputs):
    """Return the velocity of the rod (m/s)."""
    return (inputs.position_m - state.rod) / FOLLOW_S


def described(*, pressing: bool) -> PlantDescription:
    """Return the plant; with `pressing`, a friction that grows with pressure may be lacking."""
    effects = [MayLack("offset", "F = ... + offset", "force balance", {"value": "offset"})]
    if pressing:
        effects.append(
            MayLack(
                "pressing", "Fc + k (p - 4 bar)", "force balance", {"value": "pressing"},
            )
        )  # fmt: skip
    return PlantDescription(
        name="seal",
        inputs=(Input("position_m", "m", size=0.04), Input("pressure_Pa", "Pa", size=7e5)),
        outputs=(Channel("force_N", "N", noise=0.03, resolution=0.015),),
        states=(
            StateOf("rod", "m", start=0.0, spread=1e-2),
            StateOf("grip", "", start=0.0, spread=0.7),
            StateOf("force", "N", start=reading("force_N"), spread=0.5),
        ),
        parameters=(
            Parameter("area", "m^2", 1e-5, 1e-2, about="A"),
            Parameter("coulomb", "N", 0.01, 100.0, about="Fc, at 4 bar"),
            Parameter("viscous", "N s/m", 0.0, 2000.0, about="Fv"),
            Parameter("presliding", "m", 1e-6, 5e-3, about="the rings roll by this"),
            Parameter("offset", "N", -50.0, 50.0, neutral=0.0),
            Parameter("pressing", "N/Pa", -1e-3, 1e-3, neutral=0.0, probe=1e-8),
        ),
        rates=rates,
        readings=readings,
        substeps=4,
        effects=tuple(effects),
        tolerances={"area": 0.05, "coulomb": 0.5, "viscous": 0.9, "presliding": 0.8},
        equations=(
            EquationOf(
                "force balance", "N", "force", per=lambda state, par: 1.0 / CHAIN_S,
                error=0.3, of=("pressure", "velocity", "position"),
            ),
        ),
        regions=(
            RegionOf("pressure", "Pa", lambda state, inputs: inputs.pressure_Pa, ("bar", 1e-5)),
            RegionOf("velocity", "m/s", velocity, ("mm/s", 1e3)),
            RegionOf("position", "m", lambda state, inputs: inputs.position_m, ("mm", 1e3)),
        ),
        steering={},
        # Rings age, warm and stick: of all parameters it is friction that may change.
        varying=(
            VaryingOf("friction level", ("coulomb",), ("pressure", "velocity", "position")),
        ),
    )  # fmt: skip


seal = described(pressing=False)
seal_pressing = described(pressing=True)
