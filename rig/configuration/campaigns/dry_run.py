"""The dry run works out, before anything moves, what a campaign would do to its rig."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import Sequence, period_of
from estimator.filters import DEFAULT_FILTER
from faults import (
    Campaign,
    CampaignTest,
    Condition,
    Criterion,
    Fault,
    FaultSchedule,
    OnFault,
    TestLimit,
    Verdict,
    size_shown,
)
from rig.configuration.reading import show
from rig.configuration.rigs import Rig, as_shown, control_in_words
from rig.plant import TICK, Model, Parameters
from rig.recording import unit_of

from .following import Following, expected_following
from .foreseen import (
    criterion_warnings,
    figure_warnings,
    inconclusive_warnings,
    limit_warnings,
    setpoint_warnings,
    until_warnings,
)
from .judged_controls import control_warnings, unstable_controls
from .leak_tests import planned_lines, step_warnings
from .loop_of_test import motion_key

_SEGMENTS_SHOWN: Final = 12


@dataclass(frozen=True)
class PlannedFault:
    """A fault as it will be injected.

    Attributes:
        fault: the fault.
        size: its size as text: a leak's flow at a pressure drop of 6.9 MPa, a blockage's
            coefficient.
        needle_opening: opening of the needle valve, 0 to 1; None where no needle makes the fault.
    """

    fault: Fault
    size: str
    needle_opening: float | None

    def __str__(self) -> str:
        """Return the fault as one line of text."""
        fault = self.fault
        end = "" if fault.until_s == inf else f" until {fault.until_s:g} s"
        verb = "changing" if fault.follows else "growing"
        ramp = f", {verb} over {fault.ramp_s:g} s" if fault.ramp_s else ""
        text = f"{fault.kind} at {fault.at_s:g} s{end}{ramp}: {self.size}"
        if self.needle_opening is not None:
            text += f", needle at {self.needle_opening:.1%}"
        return text


@dataclass(frozen=True)
class PlannedTest:
    """A test as it will run.

    Attributes:
        test: the test.
        command_range_V: lowest and highest command of an open-loop test; None in closed loop.
        position_range_m: lowest and highest setpoint in closed loop; in open loop, lowest and
            highest position of the simulated ram, with the faults injected.
        peak_speed_m_per_s: greatest speed of the setpoint in closed loop (inf if it jumps), or of
            the simulated ram in open loop.
        valve_speed_m_per_s: speed of an unloaded ram at the rig's largest command.
        faults: the faults of the test.
        following: how the ram is expected to follow its setpoint; None in open loop.
        leak_test: what a test does that locks the cylinder, as lines; empty for a motion.
        warnings: what will not go as commanded, and what the detector cannot find or size, each
            with its remedy.
    """

    test: CampaignTest
    command_range_V: tuple[float, float] | None  # noqa: N815
    position_range_m: tuple[float, float]
    peak_speed_m_per_s: float
    valve_speed_m_per_s: float
    faults: tuple[PlannedFault, ...]
    warnings: tuple[str, ...]
    following: Following | None = None
    leak_test: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Return the test as lines of text, the first of which begins with its name."""
        test = self.test
        low, high = self.position_range_m
        speed = f"at most {self.peak_speed_m_per_s:.2g} m/s"
        if not isfinite(self.peak_speed_m_per_s):
            speed = "in jumps"
        motion = f"{low:.3f} to {high:.3f} m, {speed} (valve: {self.valve_speed_m_per_s:.2g} m/s)"
        if test.leak_test is not None:
            head = f"{test.name}: some {test.duration_s:g} s after {test.settle_s:g} s of settling"
            waits = (f"  wait for {_condition(each)}" for each in test.wait_for)
            warned = (f"  warning: {warning}" for warning in self.warnings)
            return [head, *self.leak_test, *waits, *warned]
        if self.command_range_V is not None:
            least, most = self.command_range_V
            motion = f"{least:.3g} to {most:.3g} V, simulated: {motion}"
        longest = "at most " if test.segment_ends else ""
        head = f"{test.name}: {longest}{test.duration_s:g} s after {test.settle_s:g} s of settling"
        lines = [head, f"  motion {motion}", *_segment_lines(test)]
        if self.following is not None:
            lines.append(f"  {self.following}")
        lines.append(f"  expect {test.expect}")
        lines += [f"  fault {fault}" for fault in self.faults]
        for each in test.control_changes:
            words = control_in_words(each.control) or "gain times error alone"
            lines.append(f"  control from {show(each.at_s, 's')}: {words}")
        lines += [f"  wait for {_condition(each)}" for each in test.wait_for]
        if test.until is not None:
            lines.append(f"  {test.until.label}, at most {test.duration_s:g} s")
        lines += [f"  pass by {criterion_in_words(each)}" for each in test.criteria]
        lines += [f"  limit {limit_in_words(each)}" for each in test.limits]
        if test.on_fault != OnFault.IGNORE:
            lines.append(f"  on a confirmed fault: {test.on_fault}")
        return lines + [f"  warning: {warning}" for warning in self.warnings]


def _condition(condition: Condition) -> str:
    unit = unit_of(condition.channel)
    span = _range(condition.low, condition.high, unit)
    return f"{condition.channel} {span}, at most {show(condition.give_up_s, 's')}"


def criterion_in_words(criterion: Criterion) -> str:
    """Return a criterion in words: "rms_error at most 3 mm"."""
    return f"{criterion.label} {_range(criterion.low, criterion.high, criterion.unit)}"


def limit_in_words(limit: TestLimit) -> str:
    """Return a limit in words: "following_error_m: warn above 3 mm, trip above 5 mm"."""
    ends = [end for band in limit.bands for end in (band.low, band.high)]
    shown = iter(as_shown(ends, limit.watched, limit.unit))
    bands = [
        f"{band.action.replace('_', ' ')} {_beyond(band.low, band.high, next(shown), next(shown))}"
        for band in limit.bands
    ]
    over = f" over {show(limit.over_s, 's')}" if limit.over_s else ""
    over = f" of each {limit.each}" if limit.each else over
    lasting = f", for {show(limit.for_s, 's')}" if limit.for_s else ""
    during = f", in {limit.during}" if limit.during else ""
    return f"{limit.watched}{over}: {', '.join(bands)}{lasting}{during}"


def _range(low: float, high: float, unit: str) -> str:
    """Return a range in words; one of its ends may be infinite."""
    ends = (("at least", low), ("at most", high))
    return " and ".join(f"{word} {show(end, unit)}" for word, end in ends if isfinite(end))


def _beyond(low: float, high: float, low_shown: str, high_shown: str) -> str:
    ends = (("below", low, low_shown), ("above", high, high_shown))
    return " or ".join(f"{word} {text}" for word, end, text in ends if isfinite(end))


def _segment_lines(test: CampaignTest) -> list[str]:
    """Return a line for each segment of a test, up to a few; none if it has no segments."""
    setpoint, ends = test.setpoint, {each.end_s: each.until.label for each in test.segment_ends}
    if not isinstance(setpoint, Sequence):
        return []
    lines = []
    for start, each in zip(setpoint.starts_s, setpoint.stretches, strict=True):
        kind, period_s = type(each.setpoint).__name__.lower(), period_of(each.setpoint)
        cycles = f", {each.duration_s / period_s:g} cycles" if period_s else ""
        blend = f", after {each.blend_s:g} s to get there" if each.blend_s else ""
        named = f" {each.name}" if each.name else ""
        awaited = ends.get(start + each.total_s)
        lasts = f"{awaited}, at most {each.duration_s:g} s" if awaited else f"{each.duration_s:g} s"
        lines.append(f"  segment{named} at {start:g} s: {kind}, {lasts}{cycles}{blend}")
    left = len(lines) - _SEGMENTS_SHOWN
    return lines if left <= 0 else [*lines[:_SEGMENTS_SHOWN], f"  and {left} more segments"]


def plan_campaign(campaign: Campaign, rig: Rig) -> tuple[PlannedTest, ...]:
    """Return the plan of every test of a campaign, as it will run on the rig.

    For an open-loop test the ram's motion is simulated with the rig's plant, which takes time; for
    the others the motion is taken from the setpoint, and how it is followed is computed. Tests with
    the same setpoint, load, control and gain are computed once.
    """
    known: dict[str, Following] = {}
    warned: dict[str, tuple[str, ...]] = {}
    unstable = dict(unstable_controls(campaign, rig))
    plans = []
    for test in campaign.tests:
        if test.leak_test is not None:
            plans.append(_plan_leak_test(test, rig, campaign))
            continue
        of_control = control_warnings(test, rig, campaign.model, warned)
        if test.name in unstable:
            of_control = (unstable[test.name], *of_control)
        following = _following(test, rig, campaign.model, known)
        plans.append(_plan(test, rig, campaign, following, of_control))
    return tuple(plans)


def _plan_leak_test(test: CampaignTest, rig: Rig, campaign: Campaign) -> PlannedTest:
    place, model = test.start_position_m, campaign.model
    return PlannedTest(
        test=test,
        command_range_V=None,
        position_range_m=(place, place),
        peak_speed_m_per_s=0.0,
        valve_speed_m_per_s=valve_speed(rig.plant.parameters, rig.limits.command_V),
        faults=(),
        warnings=tuple(step_warnings(test, rig, model, campaign.filter_name)),
        leak_test=tuple(planned_lines(test, rig, model)),
    )


def _following(
    test: CampaignTest, rig: Rig, assumed: Model, known: dict[str, Following]
) -> Following | None:
    """Return how a test's ram is expected to follow, from `known` if it is there.

    It is None in open loop.
    """
    if test.setpoint.quantity != "position":
        return None
    same = motion_key(test)
    if same not in known:
        known[same] = expected_following(test, rig, assumed)
    return known[same]


def valve_speed(par: Parameters, command_V: float) -> float:  # noqa: N803
    """Return the speed in m/s of an unloaded ram at a steady command (eqs. 2.1 and 2.2).

    Each port of the symmetric valve takes half the supply pressure, so
    v = C_d w k_sp |u| sqrt((p_s - p_e) / rho) / A.
    """
    opening = par.valve_gain * abs(command_V)
    root = sqrt((par.supply_pressure - par.return_pressure) / par.density)
    return par.discharge_coefficient * par.area_gradient * opening * root / par.piston_area


def _plan(
    test: CampaignTest,
    rig: Rig,
    campaign: Campaign,
    following: Following | None,
    of_control: tuple[str, ...],
) -> PlannedTest:
    times = np.arange(round(test.duration_s / TICK)) * TICK
    setpoint = test.setpoint.sample(times)
    commanded = None
    if test.setpoint.quantity == "position":
        position = (float(setpoint.min()), float(setpoint.max()))
        speed = test.setpoint.peak_rate(test.duration_s)
    else:
        commanded = (float(setpoint.min()), float(setpoint.max()))
        position, speed = _simulated_motion(test, rig, setpoint)
    fastest = valve_speed(rig.plant.parameters, rig.limits.command_V)
    return PlannedTest(
        test=test,
        command_range_V=commanded,
        position_range_m=position,
        peak_speed_m_per_s=speed,
        valve_speed_m_per_s=fastest,
        faults=tuple(_plan_fault(fault, rig) for fault in test.faults),
        warnings=(
            *_warnings(test, rig, position, speed, fastest),
            *_volts_warnings(following, speed <= fastest),
            *of_control,
            *_detector_warnings(test, rig, campaign.filter_name),
            *_waiting_warnings(test, rig),
            *setpoint_warnings(test),
            *until_warnings(test),
            *inconclusive_warnings(test, campaign.model, campaign.filter_name),
            *limit_warnings(test, rig),
            *figure_warnings(test, rig, campaign.filter_name),
            *criterion_warnings(test, rig, campaign.filter_name),
        ),
        following=following,
    )


def _simulated_motion(
    test: CampaignTest, rig: Rig, command: NDArray[np.float64]
) -> tuple[tuple[float, float], float]:
    # The import is here so that checking closed-loop campaigns need not wait for the compiler.
    from rig.plant import simulate

    plant = rig.plant
    if test.load is not None:
        plant = plant.with_effect(
            "spring_load", stiffness=test.load.stiffness, contact=test.load.contact
        )
    table = FaultSchedule(test.faults).table(command.size, TICK)
    motion = simulate(plant, command, position=test.start_position_m, faults=table)
    position, velocity = motion["position"], motion["velocity"]
    return (float(position.min()), float(position.max())), float(np.abs(velocity).max())


def _waiting_warnings(test: CampaignTest, rig: Rig) -> Iterator[str]:
    if test.wait_for and rig.backend == "simulated":
        yield "there is no simulated rig before its test begins, so that it waits for nothing"


def _warnings(
    test: CampaignTest, rig: Rig, position: tuple[float, float], speed: float, fastest: float
) -> Iterator[str]:
    limits, par = rig.limits, rig.plant.parameters
    closed_loop = test.setpoint.quantity == "position"
    if not closed_loop and not (
        limits.position_min_m <= position[0] and position[1] <= limits.position_max_m
    ):
        yield (
            f"the ram drifts beyond the limits of {show(limits.position_min_m, 'm')} to "
            f"{show(limits.position_max_m, 'm')}; start elsewhere or shorten the test"
        )
    if closed_loop and isfinite(speed) and speed > fastest:
        yield (
            f"the setpoint moves at up to {speed:.2g} m/s, the valve delivers {fastest:.2g} m/s; "
            "the ram will lag"
        )
    if test.load is not None and closed_loop:
        force = test.load.stiffness * max(0.0, position[1] - test.load.contact)
        stall = (par.supply_pressure - par.return_pressure) * par.piston_area
        if force > stall:
            yield (
                f"the spring pushes back with {show(force, 'N')}, the ram stalls at "
                f"{show(stall, 'N')}; reduce the motion beyond {show(test.load.contact, 'm')}"
            )


def _volts_warnings(following: Following | None, reachable: bool) -> Iterator[str]:
    """Yield a warning if a motion that an unloaded ram could follow asks for too many volts.

    Under the proportional loop the ram lags far more than that anyway, and no warning is given.
    """
    if following is not None and reachable and following.tracks and following.out_of_reach:
        yield f"{following.out_of_reach}; the ram will lag, whatever the control"


def _detector_warnings(test: CampaignTest, rig: Rig, filter_name: str) -> Iterator[str]:
    """Yield warnings about faults of a test that the detector cannot find, or cannot size."""
    if test.on_fault == OnFault.TOLERATE and filter_name != DEFAULT_FILTER:
        yield (
            f"the detector of {filter_name} does not say how large a leak is, so that none is "
            f"tolerated; judge by {DEFAULT_FILTER}"
        )
    if any(fault.kind == Verdict.SUPPLY_LEAKAGE for fault in test.faults):
        droops = rig.plant.parameters.supply_droop > 0.0
        if not droops and (rig.backend == "simulated" or not rig.has_supply_pressure_sensor):
            yield (
                f"the supply of the model {rig.plant.name} does not droop, so that a leak of its "
                "line changes nothing that is measured; give it a supply_droop"
            )
        elif not rig.has_supply_pressure_sensor:
            yield (
                "without a transducer for the supply pressure a supply leak is an unknown_fault "
                "at best; expect that"
            )


def _plan_fault(fault: Fault, rig: Rig) -> PlannedFault:
    size = size_shown(fault.kind, fault.coefficient, linear=fault.linear)
    valve = None if fault.linear else rig.bypass_valves.get(fault.kind)
    opening = valve.needle_opening_for(fault.coefficient) if valve else None
    return PlannedFault(fault, size, opening)
