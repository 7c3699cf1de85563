"""Compares what the detector makes of the same leaks under both laws of the position loop.

The trials are those of docs/detection.md: leaks of 0.005 to 0.5 L/min within 60 s of their onset
(`tools.detection_limits`), leaks of 0.03 to 2 L/min and faults of the lines at the end of 40 s
(`tools.studies.confusion`), and healthy rigs. Rig, motion, onset and noise are the same under both
laws. Motions in open loop, which have no law, are left out.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import NormalDist
from typing import Final

import numpy as np

from rig.plant import LEAKS
from tools.detection_limits.study import named_after, plans as small_leaks
from tools.pages.marked_tables import markdown
from tools.simulated.drawn_rigs import drawn_motion, drawn_rig
from tools.studies.confusion import covered, plans as all_faults
from tools.studies.leak_trials import Plan, Trial, trials

JUDGE: Final = "product"
_SMALL: Final = (0.005, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1, 0.5)
_LARGE: Final = (0.03, 0.06, 0.1, 0.3, 1.0, 2.0)
"""Edges of the rows of both tables, L/min at the leak's reference drop, which does not depend on
the law."""
_WITHIN_S: Final = 10.0
_Z: Final = NormalDist().inv_cdf(0.975)
_NAMES: Final = {False: "proportional", True: "tracking"}


@dataclass(frozen=True)
class Pair:
    """The same plan under both laws."""

    proportional: Trial
    tracking: Trial

    @property
    def plan(self) -> Plan:
        """The plan, as under the proportional loop."""
        return self.proportional.plan

    def trial(self, tracking: bool) -> Trial:
        """Return the trial under one of the laws."""
        return self.tracking if tracking else self.proportional


def is_closed_loop(plan: Plan) -> bool:
    """Return whether the motion of a plan is in closed loop, as `leak_trials.record` draws it."""
    rng = np.random.default_rng(plan.seed)
    drawn_rig(rng)
    return not drawn_motion(rng, 1)[1]


def plans(small: int, large: int) -> Iterator[Plan]:
    """Yield the plans in closed loop among `small` small leaks, and `large` leaks and other faults.

    Each yields healthy rigs too, as its own study has them. Only the product detector judges.
    """
    for plan in [*small_leaks(small), *all_faults(large)]:
        if is_closed_loop(plan):
            yield replace(plan, judges=(JUDGE,))


def pairs(small: int, large: int, kept: Path, jobs: int) -> list[Pair]:
    """Return all pairs of trials; those that are kept from before are not run again."""
    one = list(plans(small, large))
    found = trials([*one, *(replace(plan, tracking=True) for plan in one)], kept, jobs)
    return [Pair(*each) for each in zip(found[: len(one)], found[len(one) :], strict=True)]


def paired_difference(first: Sequence[bool], second: Sequence[bool]) -> tuple[float, float, float]:
    """Return the share of `second` less that of `first`, and its 95 % interval.

    Both are of the same trials, in the same order, at least one. The interval is that of Agresti
    and Min (2005, Statistics in Medicine 24, 729-740), Wald's with half a trial added to each of
    the four cells of the table of pairs, which holds its rate for small numbers too.
    """
    a, b = np.asarray(first, bool), np.asarray(second, bool)
    size = a.size + 2.0
    gained, lost = float((b & ~a).sum()) + 0.5, float((a & ~b).sum()) + 0.5
    middle = (gained - lost) / size
    spread = np.sqrt(gained + lost - (gained - lost) ** 2 / size) / size
    reach = _Z * float(spread)
    shown = float(b.mean() - a.mean())
    return shown, max(middle - reach, -1.0), min(middle + reach, 1.0)


def _is_right(trial: Trial) -> bool:
    return trial.judged[JUDGE].verdict == (trial.plan.fault or "healthy")


def _in_time(trial: Trial) -> bool:
    return named_after(trial, JUDGE) <= _WITHIN_S


def _latency(trial: Trial) -> float:
    return named_after(trial, JUDGE)


def _compared(found: Sequence[Pair], right: Callable[[Trial], bool]) -> list[str]:
    """Return the cells of how many are right under each law, and of the difference."""
    one, other = ([right(pair.trial(law)) for pair in found] for law in _NAMES)
    difference, low, high = paired_difference(one, other)
    change = f"{100.0 * difference:+.1f} ({100.0 * low:+.1f} to {100.0 * high:+.1f})"
    return [str(len(found)), str(sum(one)), str(sum(other)), change]


def _latencies(found: Sequence[Pair]) -> str:
    both = [pair for pair in found if all(np.isfinite(_latency(pair.trial(law))) for law in _NAMES)]
    if not both:
        return "–"
    return ", ".join(
        f"{np.median([_latency(pair.trial(law)) for pair in both]):.1f}" for law in _NAMES
    )


def _sizes(found: Sequence[Pair]) -> list[str]:
    """Return the cells of rms errors, relative to the true flow, and of intervals that hold it."""
    errors, held = [], []
    for law in _NAMES:
        named = [pair.trial(law) for pair in found if _is_right(pair.trial(law))]
        relative = [(each.judged[JUDGE].flow or 0.0) / each.flow - 1.0 for each in named]
        errors.append(f"{np.sqrt(np.mean(np.square(relative))):.1%}" if named else "–")
        held.append(f"{sum(covered(each) for each in named)} of {len(named)}")
    return [", ".join(errors), ", ".join(held)]


def _rows(found: Sequence[Pair], edges: Sequence[float]) -> Iterator[tuple[str, list[Pair]]]:
    for low, high in pairwise(edges):
        inside = [pair for pair in found if low <= pair.plan.size < high]
        if inside:
            yield f"{low:g} to {high:g}", inside
    yield "all", list(found)


_HEAD: Final = ("leaks", "proportional", "tracking", "difference, % of them (95 %)")


def small_table(found: Sequence[Pair]) -> str:
    """Return the table of small leaks by size: how many are named rightly within 10 s."""
    leaks = [each for each in found if _is_small(each.plan) and each.plan.fault is not None]
    head = ("leak, L/min", *_HEAD, "named after, s, median: proportional, tracking")
    rows = [[n, *_compared(one, _in_time), _latencies(one)] for n, one in _rows(leaks, _SMALL)]
    return markdown(head, rows)


def large_table(found: Sequence[Pair]) -> str:
    """Return the table of larger leaks by size: named rightly at the end, and size found."""
    leaks = [each for each in found if not _is_small(each.plan) and each.plan.fault in LEAKS]
    head = ("leak, L/min", *_HEAD, "named after, s, median", "rms error of the size",
            "true flow in 95 % interval")  # fmt: skip
    rows = [
        [name, *_compared(one, _is_right), _latencies(one), *_sizes(one)]
        for name, one in _rows(leaks, _LARGE)
    ]
    return markdown(head, rows)


def other_table(found: Sequence[Pair]) -> str:
    """Return the table of faults of the lines and of healthy rigs: right verdicts at the end."""
    groups: Mapping[str, list[Pair]] = {
        "supply leak": [pair for pair in found if pair.plan.fault == "supply_leakage"],
        "return blockage": [pair for pair in found if pair.plan.fault == "return_blockage"],
        "healthy": [pair for pair in found if pair.plan.fault is None],
    }
    rows = [
        [name, *_compared(one, _is_named_with_the_sensor if one[0].plan.fault else _is_silent)]
        for name, one in groups.items()
        if one
    ]
    return markdown(("trial", "trials", *_HEAD[1:]), rows)


def _is_named_with_the_sensor(trial: Trial) -> bool:
    """Return whether a fault of the lines is named, or without supply sensor at least noticed."""
    named = trial.plan.fault if trial.plan.supply_sensor else "unknown_fault"
    return trial.judged[JUDGE].verdict == named


def _is_silent(trial: Trial) -> bool:
    return trial.judged[JUDGE].alarm_s() is None


def _is_small(plan: Plan) -> bool:
    """Return whether a plan is one of the study of small leaks, whose trials are longer."""
    return plan.seconds > 60.0
