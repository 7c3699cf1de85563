"""Makes the page of a sweep: how small a leak is found, ROC, confusion, and the ranges drawn."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pyarrow as pa

from rig.configuration import HEALTHY, Sweep
from rig.plant import LITRE_PER_MINUTE
from rig.report.templating import number, numbers, rendered
from rig.sweep import POWER, AskedStudy, PowerCurve, Roc, Study, columns_of, unit_of, verdict_order

from .asked_words import criteria_in_words, figures_in_words, limits_in_words, motions_in_words
from .words import limit_in_words, of_share, place_in_words, times_in_100

_DIGITS: Final = 4
_ROC_POINTS: Final = 400
_CURVE_POINTS: Final = 80
_SHOWN_AS: Final = {"onset_s": "leak onset", "coefficient": "leak coefficient"}
_SHOWN: Final = 3000
"""Greatest number of cases in a plot of single cases; more would make a browser slow."""


def sweep_page(sweep: Sweep, table: pa.Table, study: Study, asked: AskedStudy | None = None) -> str:
    """Return the HTML page of a sweep; the page fetches nothing.

    Args:
        sweep: the sweep as configured.
        table: one row for each case.
        study: the statistics of all cases.
        asked: what came of the sweep's figures, criteria and limits; None if it has none.
    """
    return rendered(
        "sweep.html.j2",
        "sweep.js",
        sweep=sweep,
        study=study,
        # An adaptive sweep may be over before its last case.
        rig_hours=f"{table.num_rows * sweep.duration_s / 3600.0:.3g}",
        right=[(place_in_words(name), of_share(each)) for name, each in study.right.items()],
        wanted=times_in_100(sweep.adaptive.found if sweep.adaptive else POWER),
        limits=[(place_in_words(name), limit_in_words(each)) for name, each in study.power.items()],
        areas=[(place_in_words(name), f"{each.area:.3f}") for name, each in study.roc.items()],
        named=sum(each.count for name, each in study.right.items() if name != HEALTHY),
        false_alarms=of_share(study.false_alarms),
        lost=of_share(study.lost),
        fitted=any(curve.slope is not None for curve in study.power.values()),
        verdicts=verdict_order(study.confusion),
        in_words=place_in_words,
        drawn=list(_drawn(sweep, table)),
        motions=list(motions_in_words(sweep)),
        asked=asked,
        passed=of_share(asked.passed) if asked and asked.passed else "",
        ended=of_share(asked.ended) if asked and asked.ended else "",
        criteria=criteria_in_words(asked) if asked else [],
        limits_asked=limits_in_words(asked) if asked else [],
        figures_asked=figures_in_words(asked) if asked else [],
        figures=_figures(table, study),
    )


def _drawn(sweep: Sweep, table: pa.Table) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, lowest and highest value, and unit of each quantity that was drawn at random.

    A quantity that no case has, as no case has its motion or a leak, is left out.
    """
    of_motions = [name for motion in sweep.motions for name in motion.drawn]
    of_leaks = [] if sweep.leaks is None else ["onset_s", "coefficient"]
    levels = range(1, 1 + (0 if sweep.leaks is None else len(sweep.leaks.profile)))
    of_leaks += [f"level_{number}_{what}" for number in levels for what in ("s", "coefficient")]
    names = (*sweep.parameters, *sweep.followers, "noise", *of_motions, *of_leaks)
    for name in names:
        values = columns_of(table.select([name]))[name].astype(np.float64)
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        low, high = float(values.min()), float(values.max())
        shown = _SHOWN_AS.get(name, name.removesuffix("_s")).replace("_", " ")
        yield shown, f"{low:.4g}", f"{high:.4g}", unit_of(table, name)


def _figures(table: pa.Table, study: Study) -> dict[str, Any]:
    return {
        "power": {name: _power(curve) for name, curve in study.power.items()},
        "roc": {name: _roc(roc) for name, roc in study.roc.items()},
        "confusion": _confusion(study),
        "cases": _cases(table),
    }


def _power(curve: PowerCurve) -> dict[str, Any]:
    """Return bins and fitted curve of a power curve, in L/min and %.

    The key `curve` is None if no curve was fitted.
    """
    middles = [(each.low * each.high) ** 0.5 / LITRE_PER_MINUTE for each in curve.bins]
    rights = [each.right for each in curve.bins]
    found: dict[str, Any] = {
        "flow": numbers(middles, _DIGITS),
        "part": [100.0 * each.part for each in rights],
        "above": [100.0 * each.interval[1] - 100.0 * each.part for each in rights],
        "below": [100.0 * each.part - 100.0 * each.interval[0] for each in rights],
        "text": [f"{each.count} of {each.of}" for each in rights],
        "curve": None,
        "limit": None,
        "wanted": 100.0 * curve.share,
    }
    if curve.intercept is not None and curve.slope is not None and curve.bins:
        flow = np.geomspace(curve.bins[0].low, curve.bins[-1].high, _CURVE_POINTS)
        chance = 1.0 / (1.0 + np.exp(-(curve.intercept + curve.slope * np.log(flow))))
        found["curve"] = {
            "flow": numbers(flow / LITRE_PER_MINUTE, _DIGITS),
            "part": numbers(100.0 * chance, _DIGITS),
        }
    if curve.steps:
        flows, shares = zip(*curve.steps, strict=True)
        found["curve"] = {
            "flow": numbers([flow / LITRE_PER_MINUTE for flow in flows], _DIGITS),
            "part": numbers([100.0 * share for share in shares], _DIGITS),
        }
    if curve.limit_m3_per_s is not None:
        found["limit"] = number(curve.limit_m3_per_s / LITRE_PER_MINUTE, _DIGITS)
    return found


def _roc(roc: Roc) -> dict[str, Any]:
    """Return a ROC curve in %, with 400 points at most."""
    at = np.unique(np.linspace(0, roc.found.size - 1, _ROC_POINTS).astype(int))
    return {
        "alarms": numbers(100.0 * roc.false_alarms[at], _DIGITS),
        "found": numbers(100.0 * roc.found[at], _DIGITS),
        "area": f"{roc.area:.3f}",
    }


def _confusion(study: Study) -> dict[str, Any]:
    verdicts = verdict_order(study.confusion)
    counts = [[row.get(verdict, 0) for verdict in verdicts] for row in study.confusion.values()]
    totals = [max(sum(row), 1) for row in counts]
    return {
        "injected": [place_in_words(name) for name in study.confusion],
        "verdicts": [place_in_words(name) for name in verdicts],
        "counts": counts,
        "parts": [
            [100.0 * n / total for n in row] for row, total in zip(counts, totals, strict=True)
        ],
        "right": [[name == verdict for verdict in verdicts] for name in study.confusion],
    }


def _cases(table: pa.Table) -> dict[str, Any]:
    """Return the columns of the plots of single leaks, such as true flow, estimate and latency.

    Flows are in L/min, times in s; None where a case has no value.
    """
    names = [
        "case",
        "fault",
        "verdict",
        "right",
        "leak_true_m3_per_s",
        "leak_m3_per_s",
        "latency_s",
    ]
    column = columns_of(table.select(names))
    at = np.flatnonzero(column["fault"] != HEALTHY)[:_SHOWN]
    return {
        "case": [int(each) for each in column["case"][at]],
        "fault": [place_in_words(str(each)) for each in column["fault"][at]],
        "verdict": [place_in_words(str(each)) for each in column["verdict"][at]],
        "right": [bool(each) for each in column["right"][at]],
        "flow": numbers(column["leak_true_m3_per_s"][at] / LITRE_PER_MINUTE, _DIGITS),
        "estimate": numbers(column["leak_m3_per_s"][at] / LITRE_PER_MINUTE, _DIGITS),
        "latency": numbers(column["latency_s"][at], _DIGITS),
    }
