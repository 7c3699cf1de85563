"""Warnings about a test that can be foreseen from its file and its rig, without computing anything.

Each is one sentence for `rig check`, and what it warns of runs all the same.
"""

from collections.abc import Iterator
from math import inf
from typing import Final

import numpy as np

from control import FromFile, Sequence, Setpoint
from estimator.filters import DEFAULT_FILTER
from estimator.leaks import travel_needed
from faults import (
    FOLLOWING_ERROR,
    FRICTION,
    STEP_FIGURES,
    STEP_M,
    WATCHED_FIGURES,
    CampaignTest,
    Criterion,
    Verdict,
)
from rig.configuration.reading import show, show_alike
from rig.configuration.rigs import Rig
from rig.plant import TICK, Model

_ENDS_EARLY_S: Final = 0.1
"""How long before its test a setpoint file may end without a warning, s. The last row of a file
with ten rows a second or more comes at most so long before the test's end."""
_LAGS_S: Final = 2.0
"""How long a ram may still move after its setpoint has come to rest, s: seven time constants of the
position loop of the shipped rigs, 1/3.5 s at 50 V/m, after which a thousandth of a step is left."""
_NEVER_BELOW_0: Final = (
    "rms_error", "peak_error", *STEP_FIGURES, "leak", "bulk_modulus", "residual_pressure_1",
    "residual_pressure_2",
)  # fmt: skip
"""Figures that are never below 0, beside those of the loop's timing."""


def setpoint_warnings(test: CampaignTest) -> Iterator[str]:
    """Yield a warning for each setpoint file of a test that ends before its motion does."""
    for setpoint, lasts_s in _motions(test):
        if not isinstance(setpoint, FromFile):
            continue
        if setpoint.last_time_s < lasts_s - _ENDS_EARLY_S:
            yield (
                f"the setpoint file {setpoint.path.name} ends at {setpoint.last_time_s:g} s of "
                f"{lasts_s:g} s, and its last value is held from then on; lengthen it, or shorten "
                "the motion"
            )


def until_warnings(test: CampaignTest) -> Iterator[str]:
    """Yield a warning if a test awaits a fault's verdict, and is to be healthy in the end.

    It fails if the verdict comes, which is not the one expected, and also if it does not come.
    """
    awaited = [test.until, *(each.until for each in test.segment_ends)]
    found = [each.verdict for each in awaited if each is not None and each.verdict is not None]
    for verdict in dict.fromkeys(found):
        if verdict != Verdict.HEALTHY and test.expect == Verdict.HEALTHY:
            yield (
                f"it awaits {verdict} and expects healthy, so that it fails whether the verdict "
                f"comes or not; write `expect: {verdict}`, or await something else"
            )


def inconclusive_warnings(test: CampaignTest, model: Model, filter_name: str) -> Iterator[str]:
    """Yield a warning if a test that expects healthy will end inconclusive, as its ram stands.

    The detector of the product filter says healthy only of a ram that has moved by `travel_needed`
    in the later half of the time. What is known beforehand is the setpoint of a closed loop; a ram
    that lags behind it is given `_LAGS_S` to come to rest. A test that may end early, or that a
    fault is injected into, is left out.
    """
    is_judged = filter_name == DEFAULT_FILTER and test.setpoint.quantity == "position"
    if (
        not is_judged
        or test.expect != Verdict.HEALTHY
        or test.faults
        or test.until
        or test.segment_ends
    ):
        return
    needed_m = travel_needed(model.parameters)
    begin_s = max(0.5 * test.duration_s - _LAGS_S, 0.0)
    ticks = np.arange(round(begin_s / TICK), round(test.duration_s / TICK))
    setpoint = test.setpoint.sample(ticks * TICK)
    travel_m = float(setpoint.max() - setpoint.min())
    if travel_m < needed_m:
        moved, needed = show_alike([travel_m, needed_m], "m")
        yield (
            f"its verdict will be `inconclusive`, so that it fails: the ram moves by {moved} in "
            f"the later half, and a leak shows from {needed} on; let it move to the end, or "
            "shorten the test"
        )


def limit_warnings(test: CampaignTest, rig: Rig) -> Iterator[str]:
    """Yield a warning for each end of a test's limit beyond an end at which the rig itself stops.

    Rungs of the rig that only indicate stop nothing, and are left out.
    """
    for limit in test.limits:
        figure, _, of = limit.watched.rpartition(" of ")
        channel = of if figure in ("peak", "valley") else limit.watched
        rungs = [r for r in rig.ladder if r.channel == channel and r.action != "indicate"]
        least = max((rung.low for rung in rungs), default=-inf)
        most = min((rung.high for rung in rungs), default=inf)
        ends = (
            ("low", -inf < limit.low < least, limit.low, least),
            ("inner_low", -inf < limit.inner_low < least, limit.inner_low, least),
            ("inner_high", most < limit.inner_high < inf, limit.inner_high, most),
            ("high", most < limit.high < inf, limit.high, most),
        )
        for key, is_beyond, end, own in ends:
            if is_beyond:
                yield (
                    f"the limit of {limit.watched} at {key} {show(end, limit.unit)} is never "
                    f"reached: the rig's own limit at {show(own, limit.unit)} acts before; give a "
                    "narrower one, or leave it out"
                )


def figure_warnings(test: CampaignTest, rig: Rig, filter_name: str) -> Iterator[str]:
    """Yield a warning for each limit of a figure that this rig, or this filter, never tells.

    Args:
        test: the test.
        rig: the rig.
        filter_name: name of the filter by which the campaign judges.
    """
    watched = dict.fromkeys(limit.watched for limit in test.limits)
    for name in watched:
        if name.startswith("loop_") and name in WATCHED_FIGURES and rig.backend == "simulated":
            yield (
                f"the limit of {name} is not judged here: the loop of a simulated rig runs by no "
                "clock; it is judged on hardware and on the emulated rig"
            )
        if name.startswith(FRICTION) and filter_name != DEFAULT_FILTER:
            yield (
                f"the limit of {name} is never judged: {filter_name} does not estimate the load, "
                f"from which friction follows; judge by {DEFAULT_FILTER}"
            )


def criterion_warnings(test: CampaignTest, rig: Rig, filter_name: str) -> Iterator[str]:
    """Yield a warning for each criterion of a test that can never be met.

    Args:
        test: the test.
        rig: the rig.
        filter_name: name of the filter by which the campaign judges.
    """
    for each in test.criteria:
        why = _never_met(each, test, rig, filter_name)
        if why:
            yield f"the criterion {each.label} is never met: {why}"


def _never_met(each: Criterion, test: CampaignTest, rig: Rig, filter_name: str) -> str:
    """Return why a criterion of a test can never be met, with a remedy; "" if it can be."""
    figure = each.figure
    if each.high < 0.0 and (
        figure in _NEVER_BELOW_0 or figure.startswith("loop_") or each.channel == FOLLOWING_ERROR
    ):
        return f"it is at most {show(each.high, each.unit)}, and never below 0; give 0 or more"
    if figure == "loop_missed" and each.low > 1.0:
        return "it is a share of the ticks, at most 1; give less"
    if figure in STEP_FIGURES and not _has_step(test, each.from_s, each.until_s):
        return (
            f"there is no step, a jump of the setpoint by more than {show(STEP_M, 'm')} in a tick, "
            "where it is taken; leave it out, or ask for rms_error or peak_error"
        )
    if figure.startswith("loop_") and figure in WATCHED_FIGURES and rig.backend == "simulated":
        return (
            "the loop of a simulated rig runs by no clock; it is known on hardware and on the "
            "emulated rig"
        )
    if figure.startswith(FRICTION) and filter_name != DEFAULT_FILTER:
        return (
            f"{filter_name} does not estimate the load, from which friction follows; judge by "
            f"{DEFAULT_FILTER}"
        )
    return ""


def _has_step(test: CampaignTest, from_s: float, until_s: float) -> bool:
    """Return whether the setpoint of a test jumps within a stretch of it, s of the test."""
    ticks = np.arange(round(from_s / TICK), round(min(until_s, test.duration_s) / TICK))
    return bool(np.any(np.abs(np.diff(test.setpoint.sample(ticks * TICK))) > STEP_M))


def _motions(test: CampaignTest) -> list[tuple[Setpoint, float]]:
    """Return each setpoint of a test with how long it lasts, s."""
    if isinstance(test.setpoint, Sequence):
        return [(each.setpoint, each.duration_s) for each in test.setpoint.stretches]
    return [(test.setpoint, test.duration_s)]
