"""The workflow from recordings to verdict: where, refit, name, alternatives, held-out gap."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np

from rig.recording import Recording

from .disturbances import curves
from .fit import Fitter
from .held_out import channel_gaps, mean_gap
from .plant import Plant
from .predictor import Predictor
from .records import record_of
from .results import Estimate, GapResult, NamedEffect, Rival
from .search import MATERIAL, Found, Named, Search
from .variables import Variable

EXPLAINED: Final = 0.8
"""Of the excess in prediction error: what named effects must take away to be the whole answer."""
_NORMAL_95: Final = 1.96


def find_gap(
    recordings: Sequence[Recording], holdout: Sequence[Recording], plant: Plant, seed: int = 1
) -> GapResult:
    """Return where a plant's model and its recordings disagree, and what it lacks.

    Args:
        recordings: to fit to, 1 kHz.
        holdout: to judge with, never fitted to.
        plant: with the model to be tested.
        seed: of the twins' sensor noise.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
    predictor = Predictor(plant)
    records = [record_of(recording, plant) for recording in recordings]
    judged = [record_of(recording, plant) for recording in holdout]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        fitter = Fitter(predictor, records, pool)
        search = Search(fitter, seed)
        found = search.run()
        _floor(search, found)
        fitter.refresh(found.refitted.values)
        where = curves(fitter, found.refitted.values, search.nuisances, found.floor)
        fitter.refresh(found.fitted.values)
        rest = curves(fitter, found.fitted.values, found.variables, found.floor)
        errors = _standard_errors(fitter, search, found)
    gaps = channel_gaps(predictor, judged, plant.nominal, found.fitted.values)
    before, after = mean_gap(gaps)
    result = GapResult("adequate", [])
    result.effects = [_named(plant, found, named, errors) for named in found.named]
    result.refitted = [_estimate(plant, found, v, errors) for v in found.variables if not v.key]
    result.channels, result.gap_before, result.gap_after = gaps, before, after
    result.explained, result.where, result.rest = found.explained, where, rest
    result.values, result.names = found.fitted.values, tuple(n.effect for n in found.named)
    result.identification = [(r.source, r.content_hash()) for r in recordings]
    result.holdout = [(r.source, r.content_hash()) for r in holdout]
    result.seconds = (
        sum(len(r) for r in records) * plant.period,
        sum(len(r) for r in judged) * plant.period,
    )
    _judge(result, found)
    return result


def _floor(search: Search, found: Found) -> None:
    """Set the cost per reading of a rig that is exactly the model found."""
    costs = [
        fitter.costs(found.fitted.values).sum() for fitter in search.twins(found.fitted.values)
    ]
    found.floor = float(np.mean(costs)) / found.samples


def _standard_errors(fitter: Fitter, search: Search, found: Found) -> dict[str, float]:
    """Return the standard error of each variable's parameter.

    By the scatter of the blocks' scores, and by what twins, whose parameters are known, are
    estimated wrong by: the larger.
    """
    columns = fitter.columns(found.fitted.values, found.variables)
    names = [column.name for column in columns]
    linear = fitter.linearise(found.fitted.values, columns)
    steps, _ = linear.solve(names)
    errors = linear.errors(names, steps)
    misses = []
    for twin in search.twins(found.fitted.values, 3):
        misses.append(twin.linearise(found.fitted.values, columns).solve(names)[0])
    wrong = np.sqrt(np.mean(np.square(misses), axis=0))
    return {
        variable.parameter: variable.reach(found.fitted.values, float(max(error, miss)))
        for variable, error, miss in zip(found.variables, errors, wrong, strict=True)
    }


def _estimate(plant: Plant, found: Found, variable: Variable, errors: dict[str, float]) -> Estimate:
    value = found.fitted.values[variable.parameter]
    reach = _NORMAL_95 * errors[variable.parameter]
    unit = next(p.unit for p in plant.parameters if p.name == variable.parameter)
    return Estimate(
        variable.key or variable.parameter, variable.parameter, value, value - reach, value + reach,
        unit, plant.nominal[variable.parameter],
    )  # fmt: skip


def _named(plant: Plant, found: Found, named: Named, errors: dict[str, float]) -> NamedEffect:
    effect = plant.effects[named.effect]
    possible = {a.effect for a in named.indistinguishable}
    rivals = [
        Rival(a.effect, a.share, a.z, float("nan"),
              plant.not_told_apart.get(frozenset((named.effect, a.effect)), ""))
        for a in named.alternatives
    ]  # fmt: skip
    return NamedEffect(
        effect.name, effect.equation, effect.where,
        tuple(_estimate(plant, found, v, errors) for v in found.variables
              if v.name == effect.name and v.key),
        named.gain, named.bar, named.z,
        tuple(r for r in rivals if r.effect in possible),
        tuple(r for r in rivals if r.effect not in possible),
        effect.unseen,
    )  # fmt: skip


def _judge(result: GapResult, found: Found) -> None:
    """Set verdict and reasons."""
    excess = found.fitted.cost / found.samples - found.floor
    unexplained = excess > MATERIAL and (not found.named or found.explained < EXPLAINED)
    if unexplained and result.rest and result.rest[0].gain > MATERIAL * found.samples:
        curve = result.rest[0]
        result.verdict = "unknown_effect"
        result.reasons.append(
            f"predictions stay worse than the sensors' noise allows; a disturbance of the "
            f"{curve.equation} that depends on {curve.region} would take away "
            f"{curve.share:.0%} of that, and no effect of the catalogue does"
        )
    elif found.named:
        result.verdict = "missing_effect"
    else:
        result.reasons.append("what the model predicts differs from the readings by their noise")
