"""This module makes the gap workflow's plant of `rig.plant`, its transducers and its effects."""

from collections.abc import Mapping
from math import exp
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.gap.plant import (
    DRIVE,
    EMPTY_SLOTS,
    MEASURE,
    READ,
    REMEMBER,
    SLOT_PARAMETERS,
    STEP,
    Array,
    Equation,
    Output,
    Parameter,
    Plant,
    Region,
    State,
    Varying,
    smoothed,
)
from rig.jit import njit
from rig.plant import (
    DATA_SHEET,
    LITRE_PER_MINUTE,
    NO_FAULT,
    PATH_SIZE,
    SUBSTEPS,
    TICK,
    TRANSDUCERS_SIZE,
    Model,
    Parameters,
    SensorParameters,
    chamber_volumes,
    command_path,
    drive,
    follow,
    inlined,
    lagged,
    quantities,
    reading_means,
    seen_position,
    signed_root,
    signed_roots,
    total_mass,
    transducers,
    valve_conductance,
)

from .effects import EFFECTS, NOT_TOLD_APART, nuisances
from .lanes import IN_LANES, SEEN_1, SEEN_2, parameters_of
from .layout import ServoLayout

_FAULT: Final = tuple(NO_FAULT)

# The memory holds, in this order: the command, the command's path before the step and after it, the
# encoder's memory, how far the encoder's reading is behind the ram, the ram's position when it was
# last remembered, and the sum of the filter's corrections of that position.
COMMAND: Final = 0
PATH: Final = 1
NEXT: Final = PATH + PATH_SIZE
SEEN: Final = NEXT + PATH_SIZE
BEHIND: Final = SEEN + TRANSDUCERS_SIZE
REMEMBERED: Final = BEHIND + 1
CORRECTED: Final = REMEMBERED + 1
MEMORY: Final = CORRECTED + 1


@njit(DRIVE, cache=True, error_model="numpy")
def _drive(inputs, memory, parameters):
    memory[COMMAND] = inputs[0]


@inlined
def _lagging(seen, before, pressure, par):
    """Return the pressure in Pa that a lagging transducer shows at the end of a tick.

    `seen` is what it showed at the beginning. `before` and `pressure` are the true pressures at the
    beginning and at the end, all in Pa.
    """
    lag = par.pressure_lag
    if lag == 0.0:
        return pressure
    return lagged(seen, before, max(pressure, 0.0), lag / TICK, exp(-TICK / lag))


@njit(STEP, cache=True, error_model="numpy")
def _step(state, memory, parameters):
    path = memory[NEXT : NEXT + PATH_SIZE]
    for i in range(PATH_SIZE):
        path[i] = memory[PATH + i]
    par = parameters_of(parameters)
    before_1, before_2 = max(state[2], 0.0), max(state[3], 0.0)
    drive(state, path, memory[COMMAND], par, _FAULT, SUBSTEPS)
    state[SEEN_1] = _lagging(state[SEEN_1], before_1, state[2], par)
    state[SEEN_2] = _lagging(state[SEEN_2], before_2, state[3], par)


@njit(REMEMBER, cache=True, error_model="numpy")
def _remember(before, state, memory, parameters):
    """Write to the memory how far the encoder's reading is behind the ram, in m.

    The command's path after the step also becomes the path before the next one.

    A late reading shows where the ram was. The filter's correction must therefore move the
    remembered positions as much as the present one. If it did not, the filter would correct the
    same error again at each sample until the delay is over, and with a delay of many samples it
    would be unstable.
    """
    par = parameters_of(parameters)
    for i in range(PATH_SIZE):
        memory[PATH + i] = memory[NEXT + i]
    seen = memory[SEEN : SEEN + TRANSDUCERS_SIZE]
    position = state[4]
    if par.position_delay != 0.0:
        memory[CORRECTED] += before[4] - memory[REMEMBERED]
        memory[REMEMBERED] = position
        state[4] = position - memory[CORRECTED]
    follow(seen, state, par)
    memory[BEHIND] = state[4] - seen_position(seen, state[4], par)
    state[4] = position


@njit(READ, cache=True, error_model="numpy")
def _read(state, memory, parameters, readings):
    par = parameters_of(parameters)
    means = reading_means(
        state[4] - memory[BEHIND], state[SEEN_1], state[SEEN_2], state[0], state[7], par
    )
    readings[0], readings[1], readings[2] = means.position, means.pressure_1, means.pressure_2
    readings[3] = means.spool


def _begin(state: Array, inputs: Array, values: Mapping[str, float], time_s: float) -> Array:
    """Return the memory (length,) of a rig that was long in `state` under its first command."""
    par = Parameters(**{name: values[name] for name in Parameters._fields})
    memory = np.zeros(MEMORY)
    memory[PATH:NEXT] = command_path(par, spool=state[0], command=inputs[0, 0], time_s=time_s)
    memory[SEEN:BEHIND] = transducers(par, state[:SEEN_1])
    memory[REMEMBERED] = state[4]
    return memory


def _start(readings: Array, inputs: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the state at the first sample and its standard deviations, (states,) each.

    The state is as the readings show it, at rest, with the bristles bent by the load.
    """
    mean = np.nanmean(readings, axis=0)
    p1 = max((mean[1] - values["pressure_1_bias"]) / values["pressure_1_gain"], 0.0)
    p2 = max((mean[2] - values["pressure_2_bias"]) / values["pressure_2_gain"], 0.0)
    spool = mean[3] if np.isfinite(mean[3]) else values["valve_gain"] * inputs[0, 0]
    load = values["piston_area"] * (p1 - p2) - values["constant_force"]
    bend = np.clip(load, -values["stiction"], values["stiction"]) / values["bristle_stiffness"]
    state = np.array(
        [spool, 0.0, p1, p2, readings[0, 0] / values["position_gain"], 0.0, bend,
         values["supply_pressure"], values["return_pressure"], p1, p2]
    )  # fmt: skip
    spread = np.array(
        [1e-6, 1e-3, 3e4, 3e4, 1e-5, 1e-2, values["stiction"] / values["bristle_stiffness"] / 4.0,
         1.0, 1.0, 3e4, 3e4]
    )  # fmt: skip
    return state, spread


def _shares(values: Mapping[str, float]) -> Array:
    """Return the part of its gains that the filter uses (outputs, states); less for late positions.

    A late position shows where the ram was. A position error of that time is still there now, so
    that the position is corrected in full. Errors of velocity and pressures swing with the ram on
    its oil, and are over in a time of 1 / w with w^2 = 4 b A^2 / (V m) (Merritt 1967, ch. 6) and
    the volume V of both chambers. So their gains are multiplied by e^(-delay w).
    """
    par = Parameters(**{name: values[name] for name in Parameters._fields})
    volume = sum(chamber_volumes(0.5 * (par.stroke_min + par.stroke_max), par))
    spring = 4.0 * par.bulk_modulus * par.piston_area**2 / volume
    shares = np.ones((4, SEEN_2 + 1))
    shares[0] = exp(-par.position_delay * (spring / total_mass(par)) ** 0.5)
    shares[0, 4] = 1.0
    return shares


_ON_STOP: Final = 2e-4
"""m. A ram that is nearer to a stop meets it within one sample at 0.2 m/s."""
_EMPTY: Final = 1.5e5
"""Pa. A chamber may be empty if the mean of some readings of its pressure is lower."""


def _violent(readings: Array, values: Mapping[str, float]) -> NDArray[np.bool_]:
    """Return for each sample, bool (n,), whether the ram is at a stop or a chamber may be empty.

    The ram is at a stop if it is nearer than `_ON_STOP`; `readings` (n, 4) are in SI units.
    """
    position = readings[:, 0] / values["position_gain"]
    low = max(values["stroke_min"], values["stop_low"])
    high = min(values["stroke_max"], values["stop_high"])
    found = (position < low + _ON_STOP) | (position > high - _ON_STOP)
    for chamber in (1, 2):
        bias = values[f"pressure_{chamber}_bias"]
        found |= smoothed(readings[:, chamber]) - bias < _EMPTY
    return np.asarray(found)


_MOVING: Final = 1e-3
"""m/s. A slower ram counts as being at rest."""


def _direction(velocity: Array) -> Array:
    """Return the direction of motion (n,): 1 for extending, -1 for retracting, 0 at rest."""
    return np.where(np.abs(velocity) < _MOVING, 0.0, np.sign(velocity))


_MPA: Final = ("MPa", 1e-6)
_LITRES: Final = ("L/min", 1.0 / LITRE_PER_MINUTE)

REGIONS: Final = {
    region.name: region
    for region in (
        Region("velocity", "m/s", lambda x, u: x[:, 5], ("mm/s", 1e3), "v"),
        Region("position", "m", lambda x, u: x[:, 4], ("mm", 1e3), "x", True),
        Region("spool opening", "m", lambda x, u: x[:, 0], ("um", 1e6), "x_sp"),
        Region("pressure 1", "Pa", lambda x, u: x[:, 2], _MPA, "p1"),
        Region("pressure 2", "Pa", lambda x, u: x[:, 3], _MPA, "p2"),
        Region("pressure difference", "Pa", lambda x, u: x[:, 2] - x[:, 3], _MPA, "(p1 - p2)"),
        Region("direction", "", lambda x, u: _direction(x[:, 5]), ("", 1.0), "sgn(v)"),
        Region("command", "V", lambda x, u: u[:, 0], ("V", 1.0), "u"),
    )
}


def _chamber_rate(states: Array, values: Mapping[str, float], chamber: int) -> Array:
    par = Parameters(**{name: values[name] for name in Parameters._fields})
    volumes = chamber_volumes(states[:, 4], par)
    return np.asarray(par.bulk_modulus * TICK / volumes[chamber])


def _leak_rate(states: Array, values: Mapping[str, float], chamber: int) -> Array:
    """Return a chamber's pressure change in one sample by an opening to the other (eqs. 5.1, 5.2).

    The change (n,) is in Pa per unit of opening; `chamber` is 0 or 1.
    """
    flow = signed_roots(states[:, 2] - states[:, 3])
    return (flow if chamber else -flow) * _chamber_rate(states, values, chamber)


def _edges_rate(states: Array, values: Mapping[str, float], chamber: int) -> Array:
    """Return a chamber's pressure change in one sample by each of its edges open by 1 m (eq. 2.1).

    The supply's edge lets oil in and the return's edge lets it out (n,); `chamber` is 0 or 1.
    """
    par = Parameters(**{name: values[name] for name in Parameters._fields})
    pressure = states[:, 2 + chamber]
    drops = signed_roots(states[:, 7] - pressure) - signed_roots(pressure - states[:, 8])
    return np.asarray(valve_conductance(par) * drops * _chamber_rate(states, values, chamber))


EQUATIONS: Final = (
    Equation(
        "force balance", "N", 5,
        lambda x, v: np.full(len(x), -TICK / (v["moving_mass"] + v["payload_mass"])), ("N", 1.0),
        ("velocity", "position", "pressure difference", "pressure 1"),
    ),
    Equation(
        "flow, chamber 1", "m^3/s", 2, lambda x, v: _chamber_rate(x, v, 0), _LITRES,
        ("spool opening", "pressure 1", "velocity", "position"),
    ),
    Equation(
        "flow, chamber 2", "m^3/s", 3, lambda x, v: _chamber_rate(x, v, 1), _LITRES,
        ("spool opening", "pressure 2", "velocity", "position"),
    ),
    # The disturbance is an opening and not a flow, because a leak at one place of the stroke turns
    # its direction with the pressures.
    Equation(
        "leak across the piston", "m^3/(s Pa^0.5)", 2, lambda x, v: _leak_rate(x, v, 0),
        ("L/min/MPa^0.5", 1e3 / LITRE_PER_MINUTE), ("position", "pressure difference"),
        ((3, lambda x, v: _leak_rate(x, v, 1)),),
    ),
    Equation(
        "valve edges", "m", 2, lambda x, v: _edges_rate(x, v, 0), ("um", 1e6), ("spool opening",),
        ((3, lambda x, v: _edges_rate(x, v, 1)),),
    ),
    Equation(
        "spool", "m", 1, lambda x, v: np.full(len(x), v["valve_natural_frequency"] ** 2 * TICK),
        ("um", 1e6), ("command", "spool opening"),
    ),
)  # fmt: skip


VARYING: Final = (
    Varying(
        "friction level", ("coulomb", "stiction"), "N", 10.0,
        ("velocity", "position", "pressure 1", "pressure 2"), ("N", 1.0),
    ),
    Varying("viscous friction", ("viscous",), "N s/m", 10.0, ("position",), ("N s/m", 1.0)),
    Varying("null of the spool", ("spool_null_bias",), "m", 3e-7, (), ("um", 1e6)),
    Varying("spool per volt", ("valve_gain",), "m/V", 3e-7, ("command",), ("um/V", 1e6)),
    Varying(
        "discharge coefficient", ("discharge_coefficient",), "", 0.003, ("spool opening",),
        ("", 1.0),
    ),
    Varying(
        "bulk modulus", ("bulk_modulus",), "Pa", 1e7, ("pressure 1", "pressure 2"),
        ("MPa", 1e-6),
    ),
    Varying(
        "supply pressure", ("supply_pressure",), "Pa", 5e4, ("velocity", "spool opening"), _MPA
    ),
    Varying(
        "return pressure", ("return_pressure",), "Pa", 5e4, ("velocity", "spool opening"), _MPA
    ),
    Varying("payload", ("payload_mass",), "kg", 0.5, (), ("kg", 1.0)),
    Varying("gain of pressure 1", ("pressure_1_gain",), "", 2e-3, (), ("", 1.0)),
    Varying("gain of pressure 2", ("pressure_2_gain",), "", 2e-3, (), ("", 1.0)),
    Varying("gain of the position", ("position_gain",), "", 1e-3, (), ("", 1.0)),
)  # fmt: skip


@njit(MEASURE, cache=True, error_model="numpy")
def _measures(state, inputs, parameters, measured):
    """Write the quantities of `REGIONS`, then the rates of `EQUATIONS`, two for each."""
    par = parameters_of(parameters)
    p1, p2, position, velocity = state[2], state[3], state[4], state[5]
    measured[0], measured[1], measured[2] = velocity, position, state[0]
    measured[3], measured[4], measured[5] = p1, p2, p1 - p2
    measured[6] = 0.0 if abs(velocity) < _MOVING else (1.0 if velocity > 0.0 else -1.0)
    measured[7] = inputs[0]
    volume_1, volume_2 = chamber_volumes(position, par)
    rate_1, rate_2 = par.bulk_modulus * TICK / volume_1, par.bulk_modulus * TICK / volume_2
    leak, conductance = signed_root(p1 - p2), valve_conductance(par)
    supply, back = state[7], state[8]
    measured[8], measured[9] = -TICK / total_mass(par), 0.0
    measured[10], measured[11] = rate_1, 0.0
    measured[12], measured[13] = rate_2, 0.0
    measured[14], measured[15] = -leak * rate_1, leak * rate_2
    measured[16] = conductance * (signed_root(supply - p1) - signed_root(p1 - back)) * rate_1
    measured[17] = conductance * (signed_root(supply - p2) - signed_root(p2 - back)) * rate_2
    measured[18], measured[19] = par.valve_natural_frequency**2 * TICK, 0.0


def _states(par: Parameters) -> tuple[State, ...]:
    """Return the states, with the model errors that the filter assumes (docs/gap.md)."""
    middle = par.line_volume_1 + 0.5 * par.piston_area * (par.stroke_max - par.stroke_min)
    flow_error = 0.07 * LITRE_PER_MINUTE * par.bulk_modulus / middle * TICK
    return (
        State("spool", "m", 1e-7, 1e-9),
        State("spool velocity", "m/s", 1e-4, 3e-4),
        State("pressure 1", "Pa", 1e3, flow_error),
        State("pressure 2", "Pa", 1e3, flow_error),
        State("position", "m", 1e-6, 1e-9),
        State("velocity", "m/s", 1e-5, 20.0 * TICK / par.moving_mass),
        State("bristle deflection", "m", 1e-7, 0.0),
        State("supply pressure", "Pa", 1e3, 0.0),
        State("return pressure", "Pa", 1e3, 0.0),
        State("pressure 1 behind its lag", "Pa", 1e3, 0.0),
        State("pressure 2 behind its lag", "Pa", 1e3, 0.0),
    )


def _outputs(sensors: SensorParameters) -> tuple[Output, ...]:
    return (
        Output("position_m", "m", 1e-7, sensors.position_resolution, shown=("um", 1e6),
               of=("position", "velocity", "direction")),
        Output("pressure_1_Pa", "Pa", sensors.pressure_noise, 0.0, sensors.pressure_min,
               sensors.pressure_max, ("kPa", 1e-3), ("pressure 1", "velocity")),
        Output("pressure_2_Pa", "Pa", sensors.pressure_noise, 0.0, sensors.pressure_min,
               sensors.pressure_max, ("kPa", 1e-3), ("pressure 2", "velocity")),
        Output("spool_m", "m", sensors.spool_noise, 0.0, -sensors.spool_range,
               sensors.spool_range, ("um", 1e6), ("spool opening",)),
    )  # fmt: skip


def servo_actuator(model: Model, sensors: SensorParameters = DATA_SHEET) -> Plant:
    """Return the servo-actuator with this model as a plant of the gap workflow.

    `sensors` is the data sheet of the transducers. The plant has no motions and no control loop of
    its own, and writes no model file: whoever needs these replaces `motions`, `loop` and `write`.
    """
    known, own = quantities(), Parameters._fields
    outputs = _outputs(sensors)
    return Plant(
        name=model.name,
        states=_states(model.parameters),
        inputs=("command_V",),
        input_units=("V",),
        outputs=outputs,
        parameters=tuple(
            Parameter(name, known[name].unit, known[name].lower, known[name].upper)
            if name in known
            else Parameter(name, "", -np.inf, np.inf, 0.0)
            for name in own
        )
        + SLOT_PARAMETERS,
        nominal=model.parameters._asdict() | EMPTY_SLOTS,
        step=_step,
        read=_read,
        start=_start,
        effects=EFFECTS,
        nuisances=nuisances(model.parameters),
        equations=EQUATIONS,
        regions=REGIONS,
        steering=((0, 0, 200.0),),
        drive=_drive,
        remember=_remember,
        begin=_begin,
        violent=_violent,
        shares=_shares,
        not_told_apart=NOT_TOLD_APART,
        in_lanes=IN_LANES,
        measures=_measures,
        varying=VARYING,
        layout=ServoLayout(
            EQUATIONS, REGIONS, [channel.channel for channel in outputs], VARYING, own
        ),
    )  # fmt: skip
