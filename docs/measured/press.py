"""A servo-hydraulic press in position control, as `rig gap --plant press.py:press` takes it.

    w' = (loop (c - q) - w) / lag      the valve, and the flow that it lets pass over the area
    q' = w + what else moves the piston

with the command c and the position q of the piston. The force F on the piston is measured too.
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


def rates(state, inputs, par):
    """Return the rates of position (m/s) and of the valve's velocity (m/s^2)."""
    behind = inputs.command_m - state.position - par.offset
    # Within the overlap the valve lets nothing pass; the edge is rounded over a tenth of it.
    lost = par.overlap * math.tanh(behind / (par.overlap + 1e-6))
    wanted = par.loop * (behind - lost)
    valve_rate = (wanted - state.valve) / par.lag
    return state.valve - par.yielding * inputs.force_N, valve_rate


def readings(state, inputs, par):
    """Return what is measured: the position (m)."""
    return (state.position,)


press = PlantDescription(
    name="press",
    inputs=(
        Input("command_m", "m", size=2e-3),
        Input("force_N", "N", size=500.0),
    ),
    outputs=(
        Channel("position_m", "m", noise=15e-6, resolution=3e-6, shown=("um", 1e6)),
    ),
    states=(
        StateOf("position", "m", start=reading("position_m"), spread=3e-5),
        StateOf("valve", "m/s", start=slope("position_m"), spread=5e-3),
    ),
    parameters=(
        Parameter("loop", "1/s", 1.0, 500.0, about="velocity for a position error"),
        Parameter("lag", "s", 0.5e-3, 0.05, about="of the valve"),
        Parameter("offset", "m", -1e-3, 1e-3, neutral=0.0),
        Parameter("yielding", "m/s/N", -1e-3, 1e-3, neutral=0.0, probe=1e-7),
        Parameter("overlap", "m", 0.0, 5e-4, neutral=0.0, probe=1e-6),
        Parameter("delay", "s", 0.0, 0.02, neutral=0.0, probe=1e-4),
    ),
    rates=rates,
    readings=readings,
    input_delay="delay",
    substeps=2,
    effects=(
        MayLack("offset", "q' = ... loop (c - q - offset)", "valve", {"value": "offset"}),
        MayLack("yielding", "q' = ... - k F", "flow", {"value": "yielding"}),
        MayLack(
            "overlap", "nothing passes while c - q is within -d to d", "valve",
            {"value": "overlap"}, ({"value": 3e-5},),
        ),
        MayLack("delay", "c and F act later", "command_m", {"value": "delay"}, ({"value": 1e-3},)),
    ),
    tolerances={"loop": 0.5, "lag": 0.5},
    equations=(
        EquationOf(
            "flow", "m/s", "position", per=lambda state, par: 1.0, error=1e-3,
            of=("velocity", "force", "position error", "position"), shown=("mm/s", 1e3),
        ),
        EquationOf(
            "valve", "m/s", "valve", per=lambda state, par: 1.0 / par.lag, error=1e-3,
            of=("position error", "velocity", "force", "position"), shown=("mm/s", 1e3),
        ),
    ),
    regions=(
        RegionOf("velocity", "m/s", lambda state, inputs: state.valve, ("mm/s", 1e3)),
        RegionOf("force", "N", lambda state, inputs: inputs.force_N),
        RegionOf(
            "position error", "m", lambda state, inputs: inputs.command_m - state.position,
            ("mm", 1e3),
        ),
        RegionOf("position", "m", lambda state, inputs: state.position, ("mm", 1e3)),
    ),
)  # fmt: skip
