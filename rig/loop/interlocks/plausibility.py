"""Checks whether a sample can come from a healthy rig, compiled; docs/safety.md derives them.

Two of the checks keep accounts that grow only while samples contradict the physics (CUSUM, Page
1954): one compares the travel with the valve's flow, the other the work with the motion.
"""

from math import isnan, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io import FAST_INPUTS
from rig.plant import chamber_volumes, inlined, valve_flows

from .ladder import NO_CHANNEL, Cause

POSITION: Final = FAST_INPUTS.index("position_m")
PRESSURE_1: Final = FAST_INPUTS.index("pressure_1_Pa")
PRESSURE_2: Final = FAST_INPUTS.index("pressure_2_Pa")
_SPOOL: Final = FAST_INPUTS.index("spool_m")
_SUPPLY: Final = FAST_INPUTS.index("supply_pressure_Pa")
_LOAD: Final = FAST_INPUTS.index("load_N")
_NONE: Final = int(Cause.NONE)

_RELATIVE: Final = 1.0
_HOMED: Final = 2.0
_SUBSTEPS: Final = 4
"""Steps in a tick by which the nominal valve's second-order lag advances: some 0.16 rad each."""
_SETTLED_TICKS: Final = 200
"""Number of ticks after which any valve has reached its command."""
_SMOOTHING: Final = 5e-3
"""Time constant in s by which pressures are smoothed before their rate is taken; a change of
pressure is not lost by that, but counts later."""
_DRY: Final = 5e5
"""Pressure in Pa below which no account is kept of a chamber: its oil is soft or has a cavity."""
_UNHOMED_COMPRESSION: Final = 1.2
"""Part of the compressed volume that is unknown while the position in the stroke is unknown."""
_HOMED_COMPRESSION: Final = 0.3
"""The same part once the ram is homed: bulk modulus 15 %, and air."""


class Evidence(NamedTuple):
    """The memory of the checks from tick to tick, as a float64 array in this order."""

    started: float = 0.0
    """0 before the first sample; then 1 if the position counts from switch-on, 2 if it is homed."""
    spool_m: float = 0.0
    """Spool position of the nominal valve under the commands that were sent."""
    spool_velocity: float = 0.0
    """Speed of that spool, m/s."""
    position_m: float = 0.0
    """Position at the last fresh sample."""
    pressure_1_Pa: float = 0.0  # noqa: N815
    """Pressure of chamber 1, smoothed."""
    pressure_2_Pa: float = 0.0  # noqa: N815
    """Pressure of chamber 2, smoothed."""
    gap_ticks: float = 0.0
    """Ticks since the last fresh sample."""
    high_m: float = 0.0
    """Account of travel above the greatest that the flow allows; extending is positive."""
    low_m: float = 0.0
    """Account of travel below the least that the flow allows."""
    account_ticks: float = 0.0
    """Ticks since either of these accounts left zero."""
    still_ticks: float = 0.0
    """Ticks since the encoder last changed."""
    work_J: float = 0.0  # noqa: N815
    """Account of the energy that the ram gave back beyond what it had received."""
    above_1_ticks: float = 0.0
    """Ticks for which the pressure of chamber 1 has been above the supply without a break."""
    above_2_ticks: float = 0.0
    """The same of chamber 2."""
    spool_ticks: float = 0.0
    """Ticks for which the spool has been away from the nominal valve's without a break."""
    command_V: float = 0.0  # noqa: N815
    """Command at the valve since the last tick."""
    exchange_ticks: float = 0.0
    """Duration in ticks of the last fresh sample's exchange, in which it was taken at some time."""
    usual_ticks: float = 0.0
    """Ticks between two fresh samples that are usual: those between the last two, but at most one
    more than was usual before."""


_E: Final = Evidence(*range(len(Evidence._fields)))
_STARTED, _MODEL, _MODEL_RATE, _X, _P1, _P2, _GAP = (int(i) for i in _E[:7])
_HIGH, _LOW, _ACCOUNT, _STILL, _WORK = (int(i) for i in _E[7:12])
_ABOVE_1, _ABOVE_2, _SPOOL_TICKS, _COMMAND, _EXCHANGE, _USUAL = (int(i) for i in _E[12:])

_UNTIMED_TICKS: Final = 2.5
"""Greatest uncertainty in ticks of the time between two samples across which accounts are kept.

It must not exceed the time between the samples either. In this time the ram can go half the travel
that an account may leave unexplained.
"""


def no_evidence() -> NDArray[np.float64]:
    """Return the memory of the checks before the first tick."""
    return np.array(Evidence())


@inlined
def implausible(values, fresh, elapsed_ticks, exchange_ticks, command, homed, tol, evidence):
    """Check one tick and return (cause, channel), or (0, -1) if everything is plausible.

    Only fresh samples are checked. Without position or one of both pressures (NaN), only the spool
    is checked; without spool, supply pressure or load, the checks that need it are left out or use
    the nominal value.

    Args:
        values: float64 (len(FAST_INPUTS),), the latest value of each channel, SI; NaN if none came
            or it is not to be trusted.
        fresh: whether this tick brought a sample.
        elapsed_ticks: ticks since the last call, during which the last command was at the valve.
        exchange_ticks: duration of this tick's exchange in ticks; if the host stalls, the sample
            may come from any time within it.
        command: command in V at the valve from this tick on; 0 while the valve is disabled.
        homed: whether the position is known in the stroke, and not just relative to switch-on.
        tol: `rig.loop.interlocks.check_tolerances.Tolerances`.
        evidence: `Evidence`, updated.
    """
    cause, channel = _NONE, NO_CHANNEL
    position, p1, p2 = values[POSITION], values[PRESSURE_1], values[PRESSURE_2]
    evidence[_GAP] += elapsed_ticks
    _advance_valve(elapsed_ticks, tol, evidence)
    evidence[_COMMAND] = command
    if fresh and not (isnan(position) or isnan(p1) or isnan(p2)):
        reference = _HOMED if homed else _RELATIVE
        if evidence[_STARTED] != reference:
            evidence[_STARTED] = reference
            evidence[_X], evidence[_P1], evidence[_P2] = position, p1, p2
        step = position - evidence[_X]
        unsure_ticks = exchange_ticks + evidence[_EXCHANGE]
        known = not _in_a_gap(tol, evidence)
        timed = known and unsure_ticks <= min(evidence[_GAP], _UNTIMED_TICKS)
        if _jumped(step, unsure_ticks, tol, evidence):
            cause, channel = Cause.ENCODER_JUMP.value, POSITION
        elif timed and _against_flow(values, step, homed, tol, evidence):
            frozen = evidence[_STILL] >= evidence[_ACCOUNT]
            cause = Cause.ENCODER_FROZEN.value if frozen else Cause.POSITION_AGAINST_FLOW.value
            channel = POSITION
        elif known and _works_backwards(p1 - p2, values[_LOAD], step, tol, evidence):
            cause, channel = Cause.PRESSURES_CROSSED.value, PRESSURE_1
        else:
            channel = _above_supply(p1, p2, values[_SUPPLY], tol, evidence)
            cause = _NONE if channel == NO_CHANNEL else Cause.PRESSURE_ABOVE_SUPPLY.value
        evidence[_X] = position
        if not timed:
            evidence[_P1], evidence[_P2] = p1, p2
    if cause == _NONE and fresh and _not_following(values[_SPOOL], tol, evidence):
        cause, channel = Cause.SPOOL_NOT_FOLLOWING.value, _SPOOL
    if fresh:
        evidence[_USUAL] = min(evidence[_GAP], evidence[_USUAL] + 1.0)
        evidence[_GAP] = 0.0
        evidence[_EXCHANGE] = exchange_ticks
    return cause, channel


@inlined
def _jumped(step, unsure_ticks, tol, evidence):
    longest_s = (evidence[_GAP] + unsure_ticks) * tol.period_s
    return abs(step) > tol.jump_speed_m_per_s * longest_s + 2.0 * tol.count_m


@inlined
def _in_a_gap(tol, evidence):
    """Return whether nothing is known of how the ram went from the last sample to this one.

    It is so if samples stayed out for longer than usual, by a time in which the ram can go as far
    as an account may leave unexplained. The device may have had other commands than at both ends
    of such a gap; somebody may even have nulled the valve. A device may be slower than the loop, so
    that what is usual follows the gaps. It grows by a tick with each sample at most, so that of
    several such gaps in a row the second is one, too.
    """
    longer_s = (evidence[_GAP] - evidence[_USUAL]) * tol.period_s
    return 0.5 * tol.jump_speed_m_per_s * longer_s > tol.flow_account_m


@inlined
def _against_flow(values, step, homed, tol, evidence):
    """Return whether more travel than is allowed is not explained by the valve's flow.

    The step since the last fresh sample is compared with what eq. 2.3 allows for the flow of eqs.
    2.1 and 2.2. What is beyond goes to the accounts of travel in `evidence`, which are updated.
    Oil that leaks out makes the ram extend less than the account of chamber 1 gives and more than
    that of chamber 2: acc_2 - q_12 <= A v <= acc_1 - q_12, whatever external leaks there are.
    """
    par, elapsed_ticks = tol.par, evidence[_GAP]
    elapsed_s = elapsed_ticks * tol.period_s
    p1, p2, supply = evidence[_P1], evidence[_P2], par.supply_pressure
    # A failing supply, or its transducer, is not the encoder's fault: it may only widen the bounds.
    if values[_SUPPLY] > supply:
        supply = values[_SUPPLY]
    opening = values[_SPOOL]
    if isnan(opening):
        opening = evidence[_MODEL]
    kept = elapsed_s / (_SMOOTHING + elapsed_s)
    change_1 = kept * (values[PRESSURE_1] - p1)
    change_2 = kept * (values[PRESSURE_2] - p2)
    evidence[_P1] += change_1
    evidence[_P2] += change_2
    evidence[_STILL] = 0.0 if step != 0.0 else evidence[_STILL] + elapsed_ticks

    q1, q2 = valve_flows(opening, p1, p2, supply, par.return_pressure, tol.conductance)
    least = 1.0 / sqrt(1.0 + tol.return_restriction * (tol.conductance * opening) ** 2)
    unknown = tol.conductance * tol.null_m
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    v1, v2 = chamber_volumes(values[POSITION] if homed else middle, par)
    compressed_1 = v1 * change_1 / par.bulk_modulus
    compressed_2 = v2 * change_2 / par.bulk_modulus
    part = _HOMED_COMPRESSION if homed else _UNHOMED_COMPRESSION
    high = (
        (q1 if q1 > 0.0 else least * q1)
        + unknown * sqrt(max(p1, supply - p1))
        + tol.flow_fraction * abs(q1)
    )
    high += tol.leak_coefficient * sqrt(max(p2 - p1, 0.0))
    low = (
        (q2 if q2 < 0.0 else least * q2)
        - unknown * sqrt(max(p2, supply - p2))
        - tol.flow_fraction * abs(q2)
    )
    low -= tol.leak_coefficient * sqrt(max(p1 - p2, 0.0))
    high_m = (high * elapsed_s - compressed_1 + part * abs(compressed_1)) / par.piston_area
    low_m = (low * elapsed_s + compressed_2 - part * abs(compressed_2)) / par.piston_area
    # A cavity takes up travel that no flow explains, so that a dry chamber has no account.
    evidence[_HIGH] = 0.0 if p1 < _DRY else max(evidence[_HIGH] + step - high_m, 0.0)
    evidence[_LOW] = 0.0 if p2 < _DRY else max(evidence[_LOW] + low_m - step, 0.0)
    worst = max(evidence[_HIGH], evidence[_LOW])
    evidence[_ACCOUNT] = evidence[_ACCOUNT] + elapsed_ticks if worst > 0.0 else 0.0
    # Of samples that are more than a tick apart, the flow between them is not known.
    unseen = 0.5 * tol.jump_speed_m_per_s * (elapsed_ticks - 1.0) * tol.period_s
    return worst > tol.flow_account_m + unseen


@inlined
def _works_backwards(load_pressure, load, step, tol, evidence):
    """Update the account of work; return whether the ram gave back more energy than it can store.

    A real ram cannot, as friction only takes energy. Without a load cell (NaN) the result is False,
    since a spring could give the energy.
    """
    if isnan(load):
        return False
    area = tol.par.piston_area
    work = (area * load_pressure - load) * step + area * tol.pressure_bias_Pa * abs(step)
    evidence[_WORK] = max(evidence[_WORK] - work, 0.0)
    return evidence[_WORK] > tol.work_J


@inlined
def _above_supply(p1, p2, supply, tol, evidence):
    """Return the channel of a chamber pressure that has been above the supply for too long, or -1.

    The times for which the pressures have been above it are updated in `evidence`.
    """
    limit = (tol.par.supply_pressure if isnan(supply) else supply) + tol.above_supply_Pa
    evidence[_ABOVE_1] = evidence[_ABOVE_1] + evidence[_GAP] if p1 > limit else 0.0
    evidence[_ABOVE_2] = evidence[_ABOVE_2] + evidence[_GAP] if p2 > limit else 0.0
    if evidence[_ABOVE_1] > tol.above_supply_ticks:
        return PRESSURE_1
    if evidence[_ABOVE_2] > tol.above_supply_ticks:
        return PRESSURE_2
    return NO_CHANNEL


@inlined
def _not_following(spool, tol, evidence):
    """Return whether the spool has been away from the nominal valve's for more than `spool_ticks`.

    The time for which it has been away is updated in `evidence`; without a spool signal (NaN) the
    result is False. The time since the last sample counts only if the spool was away then, too: in
    a gap between samples the device may not have taken the commands either, so that where its spool
    was meanwhile is not known.
    """
    if isnan(spool):
        return False
    model = evidence[_MODEL]
    allowed = tol.spool_m + tol.spool_fraction * abs(model)
    allowed += tol.spool_lag_s * abs(evidence[_MODEL_RATE])
    away = abs(spool - model) > allowed
    since = evidence[_GAP] if evidence[_SPOOL_TICKS] > 0.0 else min(evidence[_GAP], 1.0)
    evidence[_SPOOL_TICKS] = evidence[_SPOOL_TICKS] + since if away else 0.0
    return evidence[_SPOOL_TICKS] > tol.spool_ticks


@inlined
def _advance_valve(ticks, tol, evidence):
    """Advance the nominal spool in `evidence` by so many ticks of the last command.

    It is a second-order lag (docs/model.md).
    """
    par = tol.par
    natural, target = par.valve_natural_frequency, par.valve_gain * evidence[_COMMAND]
    step = tol.period_s / _SUBSTEPS
    spool, rate = evidence[_MODEL], evidence[_MODEL_RATE]
    for _ in range(_SUBSTEPS * min(ticks, _SETTLED_TICKS)):
        damping = 2.0 * par.valve_damping * natural * rate
        rate += step * (natural * natural * (target - spool) - damping)
        spool += step * rate
    evidence[_MODEL], evidence[_MODEL_RATE] = spool, rate
