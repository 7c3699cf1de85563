"""A driven oscillator, as `rig gap --plant oscillator_plant.py:oscillator` takes it.

    q'' = drive - stiffness q - damping q' - offset

What `oscillators` adds to it is hidden: the model has the known part only.
"""

from typing import Any

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


def rates(state: Any, inputs: Any, par: Any) -> tuple[float, float]:
    """Return the rates of angle (rad/s) and velocity (rad/s^2)."""
    force = inputs.drive - par.stiffness * state.position - par.damping * state.velocity
    return state.velocity, force - par.offset


def readings(state: Any, inputs: Any, par: Any) -> tuple[float]:
    """Return what is measured: the angle (rad)."""
    return (state.position,)


oscillator = PlantDescription(
    name="oscillator",
    inputs=(Input("drive", "rad/s^2", size=20.0),),
    outputs=(Channel("position_rad", "rad", noise=1e-4),),
    states=(
        StateOf("position", "rad", start=reading("position_rad"), spread=1e-3),
        StateOf("velocity", "rad/s", start=slope("position_rad"), spread=0.1),
    ),
    parameters=(
        Parameter("stiffness", "1/s^2", 1.0, 1000.0),
        Parameter("damping", "1/s", 0.0, 100.0),
        Parameter("offset", "rad/s^2", -50.0, 50.0, neutral=0.0, probe=0.01),
    ),
    rates=rates,
    readings=readings,
    effects=(MayLack("offset", "q'' = ... - offset", "force balance", {"value": "offset"}),),
    tolerances={"stiffness": 0.1, "damping": 0.3},
    equations=(
        EquationOf(
            "force balance", "rad/s^2", "velocity", per=lambda state, par: 1.0, error=0.2,
            of=("velocity", "position"),
        ),
    ),
    regions=(
        RegionOf("velocity", "rad/s", lambda state, inputs: state.velocity),
        RegionOf("position", "rad", lambda state, inputs: state.position),
    ),
)  # fmt: skip
