"""The columns of a block of the oil account, and compiled code that adds one sample to them.

The code takes one rig or several in lanes (`rig.lanes`). It therefore chooses by `select`.

A row of sums holds, in this order: the end time, the part of its time that is bridged, the number
of samples, the sum of the measured supply pressure, the number of samples with one, the flow drawn
from the supply at these samples and its signed square; then pairs of values for chambers 1 and 2,
of the missing flow, of each nuisance and of each fault; then the faults' sizes, the doubts for
chambers 1 and 2, the least and greatest position, the sum of what the spool's readings depart from
its estimates, and the number of samples with a spool reading.
"""

from math import erfc, exp, pi, sqrt
from typing import Final

from estimator.filters import settled_return, settled_supply
from rig.jit import njit
from rig.lanes import anywhere, select
from rig.plant import (
    FAULTS,
    NO_FAULT,
    added,
    added_inflows,
    aeration_compliance,
    chamber_volumes,
    inlined,
    inner,
    is_real_valve,
    lapped,
    leak_flows,
    port_flows,
    signed_root,
    valve_conductance,
    valve_drops,
)

from .nuisances import EDGE_REACHES, NUISANCE_COUNT, nuisance_index

FAULT_COUNT: Final = len(FAULTS)
INTERNAL_LEAKAGE: Final = FAULTS.index("internal_leakage")
SUPPLY_LEAKAGE: Final = FAULTS.index("supply_leakage")
"""Index in `FAULTS` of the first fault that is not a leak of a chamber."""

END: Final = 0
BRIDGED: Final = 1
SAMPLES: Final = 2
SUPPLY: Final = 3
MISSING: Final = 7
NUISANCE: Final = MISSING + 2
FAULT: Final = NUISANCE + 2 * NUISANCE_COUNT
SIZE: Final = FAULT + 2 * FAULT_COUNT
DOUBT: Final = SIZE + FAULT_COUNT
LEAST: Final = DOUBT + 2
DEPARTURE: Final = LEAST + 2
WIDTH: Final = DEPARTURE + 2


def _column(nuisance: str) -> int:
    return NUISANCE + 2 * nuisance_index(nuisance)


_NULL_BIAS: Final = _column("spool_null_bias")
_EDGE_1: Final = _column("edge_1um")
_EDGE_2: Final = _column("edge_2um")
_EDGE_4: Final = _column("edge_4um")
_RADIUS: Final = _column("edge_radius")
_LANDS: Final = _column("land_leakage")
_DISCHARGE: Final = _column("discharge_coefficient")
_SUPPLY_1: Final = _column("edge_supply_1")
_RETURN_1: Final = _column("edge_return_1")
_RETURN_2: Final = _column("edge_return_2")
_SUPPLY_2: Final = _column("edge_supply_2")
_PRESSURE: Final = _column("supply_pressure")
_BIAS_1: Final = _column("pressure_1_bias")
_BIAS_2: Final = _column("pressure_2_bias")
_BACK: Final = _column("return_pressure")
_BACKED_UP: Final = _column("return_back_pressure")
_DROOP: Final = _column("supply_droop")
_DELAY: Final = _column("spool_delay")
_BULK: Final = _column("bulk_modulus")
_AIR: Final = _column("entrained_air")
_SEAL_1: Final = _column("seal_leakage_1")
_SEAL_2: Final = _column("seal_leakage_2")
_SEAL: Final = _column("seal_leakage_internal")
_LEAK_1, _LEAK_2, _LEAK_12, _SUPPLY_LEAK, _BLOCKAGE = range(FAULT, SIZE, 2)
_REACH_1, _REACH_2, _REACH_4 = EDGE_REACHES

_LEAST_DROP: Final = 1e5
"""Least pressure drop in Pa for the slope of the orifice law, which is infinite at zero drop."""
_DROP_ERROR: Final = 2e5
"""Error in Pa that a pressure drop may have, by the priors of the pressures. At drops that are no
larger, the orifice law is not linear in the error."""
_RADIUS_SCALE: Final = 1e-6
"""Edge radius in m at which the flow past a rounded edge is linearised."""
_ROOT_OF_TWO: Final = sqrt(2.0)
_PEAK: Final = sqrt(2.0 / pi)
"""Mean absolute value of a standard normal number."""
_FAR: Final = 4.0
"""Number of standard deviations from an edge beyond which noise of the spool does not open it."""
_BLUR_REACH: Final = 3e-6
"""Distance in m from null within which the flow past real edges is not linear (the tolerance of
the nuisances `edge_...`)."""
_BLUR: Final = 3e-7
"""Error of the opening in m that is left there after the nuisances: a tenth of that tolerance."""


@inlined
def _rectified(distance, deviation):
    """Return what noise e adds to the mean of an absolute value: E|d + e| - |d|, in m.

    It is twice what the noise adds to the mean opening of an edge that opens from d = 0 on.

    Args:
        distance: d, m.
        deviation: standard deviation of the normal noise e, m.
    """
    away = abs(distance)
    near = away < _FAR * deviation
    added_by_noise = 0.0 * away
    if anywhere(near):
        # Where the distance is not small, what is computed here is not used.
        scaled = select(near, away, 0.0) / select(near, deviation, 1.0)
        density = _PEAK * exp(-0.5 * scaled * scaled)
        rectified = deviation * (density - scaled * erfc(scaled / _ROOT_OF_TWO))
        added_by_noise = select(near, rectified, 0.0)
    return added_by_noise


@inlined
def _doubt(conductance, drop):
    """Return the nonlinear error in m^3/s that `_DROP_ERROR` of a drop in Pa makes in a flow.

    A root differs from its tangent by drop^0.5 (error / drop)^2 / 8, and by error^0.5 at zero drop;
    the result passes smoothly from one to the other. `conductance` is the flow per root of drop.
    """
    ratio = abs(drop) / _DROP_ERROR
    return abs(conductance) * sqrt(_DROP_ERROR) / (1.0 + 8.0 * ratio * sqrt(ratio))


@inlined
def _real_gains(opening, g1, g2, p1, p2, supply, back, par):
    """Return the flows per opening (m^2/s) of a valve with laps or unlike ports.

    The two values are for the flow into chamber 1 and the flow out of chamber 2. `g1` and `g2` are
    those of plain edges. Pressures are in Pa; the opening, null bias included, is in m.
    """
    shut = abs(opening) < par.valve_deadband
    ajar = abs(lapped(opening, par)) < par.valve_underlap_leakage
    if anywhere(ajar):
        conductance = valve_conductance(par)
        both_1 = conductance * (signed_root(supply - p1) + signed_root(p1 - back))
        both_2 = conductance * (signed_root(p2 - back) + signed_root(supply - p2))
        g1, g2 = select(ajar, both_1, g1), select(ajar, both_2, g2)
    g1, g2 = select(shut, 0.0, g1), select(shut, 0.0, g2)
    return g1, (1.0 - par.valve_flow_asymmetry) * g2


@njit(cache=True, error_model="numpy")
def add_sample(spool, spool_rate, steady, deviation, null, p1, p2, par, row):
    """Add the valve's flows of one sample, and all signatures that follow from them, to `row`.

    A signature is the missing flow of a rig that exceeds the model by one unit of a weakness. The
    null bias only decides which edges are open; the flow that it adds is left to its nuisance, so
    that a leak cannot hide in it. Where it is too uncertain to decide this, the difference between
    the edges goes into the doubts.

    Args:
        spool: displacement of the spool in the middle of the sample, m.
        spool_rate: velocity of the spool, m/s.
        steady: displacement of the spool averaged over its noise, m.
        deviation: standard deviation of the noise in `spool`, m.
        null: null bias of the spool and its standard deviation, m.
        p1: pressure of chamber 1, Pa.
        p2: pressure of chamber 2, Pa.
        par: the `Parameters` that are assumed.
        row: (WIDTH,) sums, updated; flows in m^3/s.
    """
    conductance = valve_conductance(par)
    null_bias, null_spread = null
    opening = spool + par.spool_null_bias
    true_opening = spool + null_bias
    supply = settled_supply(true_opening, p1, p2, par)
    back = settled_return(true_opening, p1, p2, par)
    extending = true_opening >= 0.0
    drop_1, drop_2 = valve_drops(true_opening, p1, p2, supply, back)
    # Flow per opening into chamber 1 and out of chamber 2.
    g1, g2 = conductance * signed_root(drop_1), conductance * signed_root(drop_2)
    q1, q2 = g1 * opening, g2 * opening
    if is_real_valve(par):
        g1, g2 = _real_gains(true_opening, g1, g2, p1, p2, supply, back, par)
        q1, q2 = port_flows(true_opening, p1, p2, supply, back, par)
        # As with plain edges, what the null bias adds is left to the nuisance.
        q1 -= g1 * (true_opening - opening)
        q2 -= g2 * (true_opening - opening)
    slope_1 = 0.5 * q1 / max(drop_1, _LEAST_DROP)
    slope_2 = 0.5 * q2 / max(drop_2, _LEAST_DROP)
    # Noise of the spool's estimate about null seems to open one edge, then the other; take it off.
    lap = par.valve_deadband - par.valve_underlap_leakage
    forth = 0.5 * conductance * _rectified(steady + null_bias - lap, deviation)
    reverse = 0.5 * conductance * _rectified(steady + null_bias + lap, deviation)
    fed_1, fed_2 = signed_root(supply - p1), signed_root(supply - p2)
    drained_1, drained_2 = signed_root(p1 - back), signed_root(p2 - back)
    q1 -= forth * fed_1 - reverse * drained_1
    q2 -= (1.0 - par.valve_flow_asymmetry) * (forth * drained_2 - reverse * fed_2)
    leak_1, leak_2, leak_12 = leak_flows(p1, p2, back, par, NO_FAULT)
    row[MISSING] += q1 - leak_1 - leak_12
    row[MISSING + 1] += -q2 - leak_2 + leak_12

    row[_NULL_BIAS] -= g1
    row[_NULL_BIAS + 1] += g2
    away = abs(true_opening)
    into, out_of = select(extending, g1, -g1), select(extending, g2, -g2)
    row[_EDGE_1] += into * min(away / _REACH_1, 1.0)
    row[_EDGE_1 + 1] -= out_of * min(away / _REACH_1, 1.0)
    row[_EDGE_2] += into * min(away / _REACH_2, 1.0)
    row[_EDGE_2 + 1] -= out_of * min(away / _REACH_2, 1.0)
    row[_EDGE_4] += into * min(away / _REACH_4, 1.0)
    row[_EDGE_4 + 1] -= out_of * min(away / _REACH_4, 1.0)
    # A rounded edge still passes oil where it should be shut, from the supply and to the return.
    scaled = away / _RADIUS_SCALE
    ajar = 0.5 * conductance * (sqrt(1.0 + scaled * scaled) - scaled)
    through_1, through_2 = fed_1 - drained_1, fed_2 - drained_2
    row[_RADIUS] -= ajar * through_1
    row[_RADIUS + 1] -= ajar * through_2
    row[_LANDS] -= supply + back - 2.0 * p1
    row[_LANDS + 1] -= supply + back - 2.0 * p2
    row[_DISCHARGE] -= q1
    row[_DISCHARGE + 1] += q2
    forward_1, forward_2 = select(extending, q1, 0.0), select(extending, q2, 0.0)
    slope_in_1, slope_out_2 = select(extending, slope_1, 0.0), select(extending, slope_2, 0.0)
    slope_out_1, slope_in_2 = select(extending, 0.0, slope_1), select(extending, 0.0, slope_2)
    row[_SUPPLY_1] -= forward_1
    row[_RETURN_2 + 1] += forward_2
    row[_RETURN_1] -= select(extending, 0.0, q1)
    row[_SUPPLY_2 + 1] += select(extending, 0.0, q2)
    row[_PRESSURE] -= slope_in_1
    row[_PRESSURE + 1] += slope_in_2
    row[_BIAS_1] += select(extending, -slope_1, slope_1)
    row[_BIAS_2 + 1] += select(extending, -slope_2, slope_2)
    row[_BACK] += slope_out_1
    row[_BACK + 1] -= slope_out_2
    row[_BACKED_UP] += slope_out_1 * q1 * q1
    row[_BACKED_UP + 1] -= slope_out_2 * q2 * q2
    row[_DROOP] += slope_in_1 * q1 * q1
    row[_DROOP + 1] -= slope_in_2 * q2 * q2
    row[_DELAY] -= g1 * spool_rate
    row[_DELAY + 1] += g2 * spool_rate

    e1, e2, e12 = drained_1, drained_2, signed_root(p1 - p2)
    row[_SEAL_1] += e1
    row[_SEAL_2 + 1] += e2
    row[_SEAL] += e12
    row[_SEAL + 1] -= e12
    row[_LEAK_1] += e1
    row[_LEAK_2 + 1] += e2
    row[_LEAK_12] += e12
    row[_LEAK_12 + 1] -= e12
    row[SIZE] += abs(e1)
    row[SIZE + 1] += abs(e2)
    row[SIZE + 2] += abs(e12)
    # Where noise decides whether an edge is open, the flow says nothing about the lines.
    certain = away > _FAR * deviation
    fed = select(certain, select(extending, slope_1, slope_2), 0.0)
    fall_1, fall_2 = slope_1 * q1 * q1, slope_2 * q2 * q2
    returned = select(certain, select(extending, fall_2, fall_1), 0.0)
    row[_SUPPLY_LEAK] += select(extending, fed, 0.0)
    row[_SUPPLY_LEAK + 1] -= select(extending, 0.0, fed)
    row[_BLOCKAGE] += select(extending, 0.0, returned)
    row[_BLOCKAGE + 1] -= select(extending, returned, 0.0)
    row[SIZE + 3] += abs(fed)
    row[SIZE + 4] += abs(returned)

    row[DOUBT] += _doubt(conductance * opening, drop_1)
    row[DOUBT + 1] += _doubt(conductance * opening, drop_2)
    blurred = away / _BLUR_REACH
    blur = _BLUR / (1.0 + blurred * blurred)
    row[DOUBT] += blur * abs(g1)
    row[DOUBT + 1] += blur * abs(g2)
    untold = conductance * (null_spread - away)
    if anywhere(untold > 0.0):
        row[DOUBT] += max(untold, 0.0) * abs(through_1)
        row[DOUBT + 1] += max(untold, 0.0) * abs(through_2)


@inlined
def add_supply(opening, p1, p2, supply, par, row):
    """Add a measured supply pressure, and the flow that the valve draws at it, to `row`.

    Args:
        opening: opening of the valve, null bias included, m.
        p1: pressure of chamber 1, Pa.
        p2: pressure of chamber 2, Pa.
        supply: measured supply pressure, Pa.
        par: the `Parameters` that are assumed.
        row: (WIDTH,) sums, updated; flow in m^3/s.
    """
    drop = supply - select(opening >= 0.0, p1, p2)
    drawn = valve_conductance(par) * abs(lapped(opening, par)) * signed_root(drop)
    row[SUPPLY] += supply
    row[SUPPLY + 1] += 1.0
    row[SUPPLY + 2] += drawn
    row[SUPPLY + 3] += drawn * abs(drawn)


@njit(cache=True, error_model="numpy")
def add_motion(position, moved, p1, p2, rise_1, rise_2, par, row):
    """Take the flows that moved the ram and compressed the oil in one sample off the missing flow.

    The signatures of bulk modulus and entrained air are added to `row` as well.

    Args:
        position: position of the ram in the middle of the sample, m.
        moved: velocity of the ram, m/s.
        p1: pressure of chamber 1 in the middle of the sample, Pa.
        p2: pressure of chamber 2 in the middle of the sample, Pa.
        rise_1: rate of the pressure of chamber 1, Pa/s.
        rise_2: rate of the pressure of chamber 2, Pa/s.
        par: the `Parameters` that are assumed.
        row: (WIDTH,) sums, updated; flows in m^3/s.
    """
    v1, v2 = chamber_volumes(position, par)
    stored_1, stored_2 = v1 * rise_1, v2 * rise_2
    soft_1, soft_2 = aeration_compliance(p1, par), aeration_compliance(p2, par)
    squeezed_1, squeezed_2 = stored_1 / par.bulk_modulus, stored_2 / par.bulk_modulus
    swept = par.piston_area * moved
    # The model's air adds linearly to the oil's compliance; a difference is left to the nuisance.
    row[MISSING] -= swept + squeezed_1 + par.entrained_air * soft_1 * stored_1
    row[MISSING + 1] += swept - squeezed_2 - par.entrained_air * soft_2 * stored_2
    # A stiffer oil stores less: more of it is missing.
    row[_BULK] -= squeezed_1
    row[_BULK + 1] -= squeezed_2
    row[_AIR] += soft_1 * stored_1
    row[_AIR + 1] += soft_2 * stored_2


@inner
def add_terms(spool, opening, position, moved, p1, p2, par, row):
    """Add the flows of the model's added terms (`rig.plant.added_terms`) to the missing flow.

    The command is taken to be the one that the spool has reached.

    Args:
        spool: displacement of the spool in the middle of the sample, m.
        opening: opening of the valve, null bias included, m.
        position: position of the ram, m.
        moved: velocity of the ram, m/s.
        p1: pressure of chamber 1, Pa.
        p2: pressure of chamber 2, Pa.
        par: the `Parameters` that are assumed.
        row: (WIDTH,) sums, updated; flows in m^3/s.
    """
    command = spool / par.valve_gain
    sums = added(moved, position, spool, p1, p2, command, par)
    supply = settled_supply(opening, p1, p2, par)
    back = settled_return(opening, p1, p2, par)
    inflow_1, inflow_2 = added_inflows(sums, sums.leak, p1, p2, supply, back, par)
    row[MISSING] += inflow_1
    row[MISSING + 1] += inflow_2
