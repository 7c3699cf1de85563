"""This module runs the whole workflow, from recordings to the verdict and the model written."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Plant, Record, record_of
from estimator.gap.prediction import (
    AddedDisturbance,
    Curve,
    DetectionLimit,
    Estimate,
    Filtered,
    Fitter,
    GapResult,
    NamedEffect,
    Predictor,
    Rival,
    Values,
    Variable,
    channel_gaps,
    effect_variables,
    free_runs,
    mean_gap,
    slices_of,
    unsuitable,
    usable,
    worse_than_resting,
)
from estimator.gap.search import (
    ENDLESS,
    MATERIAL,
    Found,
    Named,
    Search,
    absorbed,
    attribution,
    cosines,
    drifts,
    limits,
)
from rig.recording import Recording

from .confirming import confirm
from .experiments import separations
from .judging import EXPLAINED, Evidence, judge
from .keeping import Worse, at_an_end, ends_in_words, growth, take_back, why_worse
from .unknown import Unknown, find_unknown
from .unsettled import compared, unsettled
from .with_term import with_term

_NORMAL_95: Final = 1.96
_FORM: Final = 5e-3
"""Part of an effect's size that is added to its standard error. The rig never has exactly the form
of the model and its effects, which the scatter of the recordings does not show. Twice this part is
1 %."""


@dataclass
class _Seen:
    """What is known of each named effect in addition to its fit.

    Attributes:
        held_out: normal deviate of the effect's gain on held-out recordings, by effect.
        cosines: cosine of the effect's signature with those of its rivals, by effect and rival.
    """

    held_out: dict[str, float] = field(default_factory=dict)
    cosines: dict[str, dict[str, float]] = field(default_factory=dict)


def find_gap(
    recordings: Sequence[Recording], holdout: Sequence[Recording], plant: Plant, seed: int = 1
) -> GapResult:
    """Return where a plant's model and its recordings disagree, and what the model lacks.

    If the recordings cannot support a verdict, it is `inconclusive`, with the model as given and
    the reasons. That is so without held-out recordings, too.

    Args:
        recordings: recordings to fit to, at 1 kHz.
        holdout: recordings to judge with; nothing is fitted to them.
        plant: plant with the model to be tested.
        seed: seed of the twins' sensor noise.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
    predictor = Predictor(plant)
    result = GapResult("inconclusive", [], values=dict(plant.nominal), as_given=True)
    result.identification = [(r.source, r.content_hash()) for r in recordings]
    result.holdout = [(r.source, r.content_hash()) for r in holdout]
    result.seconds = (
        sum(len(r) for r in recordings) * plant.period,
        sum(len(r) for r in holdout) * plant.period,
    )
    whole, whole_judged = (
        [record_of(recording, plant) for recording in each] for each in (recordings, holdout)
    )
    records, judged = usable(whole, plant), usable(whole_judged, plant)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        fitter, judge_with = (Fitter(predictor, each, pool) for each in (records, judged))
        result.reasons = unsuitable(fitter, judge_with)
        if not result.reasons:
            try:
                _search(result, Search(fitter, seed, judge_with), judge_with)
            except np.linalg.LinAlgError:
                result.verdict, result.effects, result.channels = "inconclusive", [], []
                result.values, result.names, result.as_given = dict(plant.nominal), (), True
                result.reasons = ["no values of the parameters make the model's predictions finite"]
        _show(result, predictor, judged, pool)
    long = [record for record in (*whole, *whole_judged) if slices_of(record, plant.period)]
    lost = sum(map(len, long)) - sum(map(len, [*records, *judged]))
    if lost:
        result.reasons.append(
            f"{lost * plant.period:.1f} s of the recordings cannot be followed, as two readings or "
            "more are missing or at an end of their range there: they are left out"
        )
    return result


def _search(result: GapResult, search: Search, judged: Fitter) -> None:
    """Run the search, and set its findings and the verdict in the result."""
    fitter, plant = search.fitter, search.plant
    found = search.run()
    _floor(search, found)
    seen = _Seen()
    seen.held_out, dropped = confirm(search.refits, found, judged)
    weak = not found.named or found.explained < EXPLAINED
    known = None if weak else _known(search, found, seen)
    left = unsettled(found.filtered, search.twins(found.fitted.values), found.fitted.values)
    if found.named:
        after = attribution(found.filtered, found.fitted.values, found.variables)
        result.rest = _ranked(
            after.curves(found.floor),
            drifts(found.filtered, found.fitted.values, found.variables, found.floor),
        )
    resting = [] if weak else _resting(found.filtered, judged)
    refitted = found.filtered.at(found.refitted.values)
    left = compared(left, refitted, found.refitted.values)
    before = attribution(refitted, found.refitted.values, search.refits.nuisances)
    result.where = _ranked(
        before.curves(found.floor),
        drifts(refitted, found.refitted.values, search.refits.nuisances, found.floor),
    )
    result.rest = result.rest if found.named else result.where
    unknown = None
    if weak:
        # Named effects that explain too little are not part of the model that is judged.
        resting = _resting(refitted, judged)
        if found.refitted.cost / found.samples - found.floor > MATERIAL:
            unknown = find_unknown(before, result.where, found.floor)
    excess = search.held_out_excess(found.fitted.values)
    without = search.held_out_excess(found.refitted.values) if found.named else excess
    worse = _compare(result, fitter, judged, found) if found.named else None
    evidence = Evidence(
        found=found,
        rest=result.rest,
        located=_located(plant, result.where if weak else result.rest, unknown),
        resting=resting,
        unsettled=left,
        held_out=excess,
        held_out_before=without,
        ahead=(result.gap_before, result.gap_after),
        scatter=float(np.mean([gap.scatter for gap in result.channels])) if found.named else 0.0,
        worse=worse.words if worse is not None and worse.beyond_chance else None,
    )
    judgement = judge(evidence)
    result.verdict, result.reasons = judgement.verdict, [*judgement.reasons, *dropped]
    if result.verdict == "inconclusive":
        result.rest, result.channels = result.where, []
        result.reasons += ends_in_words(search.refits.nuisances, found.refitted.values)
        return
    if result.verdict == "unknown_effect":
        # An effect that explains too little would be named wrongly, so that the model is only
        # refitted.
        found.fitted, found.filtered = found.refitted, refitted
        found.named, found.variables = [], search.refits.nuisances
        known = None
        result.rest = result.where
    result.reasons += ends_in_words(found.variables, found.fitted.values)
    result.values, result.names = found.fitted.values, tuple(n.effect for n in found.named)
    result.as_given = False
    if not found.named:
        worse = _compare(result, fitter, judged, found)
    if worse is not None:
        names = " and ".join(named.effect for named in found.named)
        take_back(result, plant, names or "the refit", worse)
    if result.verdict == "unknown_effect":
        if unknown is None:
            unknown = find_unknown(before, result.where, found.floor)
        if unknown is not None:
            result.term = f"{unknown.place.name}: {unknown.text(plant)}"
            result.reasons.append(
                f"in symbols, to be added to the {unknown.place.name}: {unknown.text(plant)}; it "
                f"takes away {min(unknown.share, 1.0):.0%} of the excess"
            )
            result.added, said = with_term(search.refits, found, unknown)
            result.reasons += said
    if known is None:
        known = _known(search, found, seen)
    if result.verdict != "unknown_effect":
        result.reasons += known.absorbed
    result.explained = found.explained if found.named else float("nan")
    result.effects = [_named(plant, found, named, known.errors, seen) for named in found.named]
    result.refitted = [
        _estimate(plant, found, v, known.errors) for v in found.variables if not v.key
    ]
    result.limits = known.limits
    result.experiments = separations(plant, found, fitter.pool)


@dataclass(frozen=True)
class _Known:
    """What follows about a finding from its linearisation.

    Attributes:
        errors: standard errors, SI, by parameter.
        limits: for each effect the smallest size that these motions would show.
        absorbed: remarks in words on effects that the refit of a nuisance may stand for.
    """

    errors: dict[str, float]
    limits: list[DetectionLimit]
    absorbed: list[str]


def _known(search: Search, found: Found, seen: _Seen) -> _Known:
    """Return what follows about a finding from its linearisation; set its cosines in `seen`."""
    for named in found.named:
        seen.cosines[named.effect] = _cosines(search, found, named)
    return _Known(
        _standard_errors(search, found),
        limits(found.filtered, found.fitted.values, found.variables),
        absorbed(search, found),
    )


def _resting(filtered: Filtered, judged: Fitter) -> list[str]:
    """Return the channels that "nothing changes" predicts better than the model, in any record.

    The predictions are made with the values of `filtered`, for its records and for the held-out
    ones.
    """
    values = filtered.values
    found = filtered.pool.map(
        lambda record, gains: worse_than_resting(filtered.predictor, record, gains, values),
        (*filtered.records, *judged.records), (*filtered.gains, *judged.filtered(values).gains),
    )  # fmt: skip
    return list(dict.fromkeys(channel for channels in found for channel in channels))


def _ranked(*curves: list[Curve]) -> list[Curve]:
    """Return all curves together, sorted by the share that they explain, the best first."""
    return sorted((c for part in curves for c in part), key=lambda curve: -curve.share)


def _located(plant: Plant, curves: Sequence[Curve], unknown: Unknown | None) -> float:
    """Return the part of the excess that the best disturbance of one equation explains.

    A disturbance of a reading does not count, because it explains much even of another rig, or of
    swapped channels.
    """
    places = {equation.name for equation in plant.equations}
    shares = [curve.share for curve in curves if curve.equation in places]
    if unknown is not None and unknown.place.equation is not None:
        shares.append(unknown.share)
    return max(shares, default=0.0)


def _cosines(search: Search, found: Found, named: Named) -> dict[str, float]:
    """Return the cosines of an effect's signature with its own and with those of its alternatives.

    They are given by the name of the effect. Nuisances and all else that was found are projected
    out.
    """
    plant = search.plant
    values = found.fitted.values
    own = effect_variables(plant.effects[named.effect])
    for variable in own:
        values = variable.put(values, plant.nominal[variable.parameter])
    changes = {named.effect: found.fitted.values}
    for rival in named.alternatives:
        changed = dict(values)
        for variable in effect_variables(plant.effects[rival.effect]):
            changed = variable.put(changed, rival.fitted.values[variable.parameter])
        changes[rival.effect] = changed
    kept = [v for v in found.variables if v not in own]
    alike = cosines(found.filtered, values, kept, changes)
    return dict(zip(changes, map(float, alike), strict=True))


def _show(
    result: GapResult, predictor: Predictor, judged: Sequence[Record], pool: ThreadPoolExecutor
) -> None:
    """Set the held-out gap and the free simulations in the result."""
    if not judged:
        return
    # The gap of the fitted model is known already, from when it was judged.
    if not result.channels:
        _measure(result, predictor, judged, result.values, pool)
    if result.channels:
        result.free_runs = free_runs(predictor, judged, predictor.plant.nominal, result.values)
    if result.added is not None:
        _show_added(result, result.added, predictor, judged, pool)


def _measure(
    result: GapResult, predictor: Predictor, judged: Sequence[Record], values: Values,
    pool: ThreadPoolExecutor,
) -> None:  # fmt: skip
    """Set the held-out gaps of the model as given and of one with these values.

    If one of them is not finite, both become NaN and the channels' gaps are left out.
    """
    gaps = channel_gaps(predictor, judged, predictor.plant.nominal, values, pool)
    before, after = mean_gap(gaps)
    finite = bool(np.isfinite(before + after))
    result.channels = gaps if finite else []
    result.gap_before, result.gap_after = (before, after) if finite else (np.nan, np.nan)


def _compare(result: GapResult, fitter: Fitter, judged: Fitter, found: Found) -> Worse | None:
    """Set the held-out gap with all that was found; return why that is worse, else None."""
    predictor, pool = fitter.predictor, fitter.pool
    given, values = predictor.plant.nominal, found.fitted.values
    _measure(result, predictor, judged.records, values, pool)
    held_out, fitted_to = (
        growth(predictor, records, given, values, pool)
        for records in (judged.records, fitter.records)
    )
    gap = (result.gap_before, result.gap_after)
    return why_worse(held_out, gap, fitted_to, named=bool(found.named))


def _show_added(
    result: GapResult, added: AddedDisturbance, predictor: Predictor, judged: Sequence[Record],
    pool: ThreadPoolExecutor,
) -> None:  # fmt: skip
    """Set the held-out gap with the unknown term, and drop the term if it does not lower the gap.

    The gap with the term must be lower than that of the model written, and not above that of the
    model as given.
    """
    gaps = channel_gaps(predictor, judged, predictor.plant.nominal, added.values, pool)
    given, after = mean_gap(gaps)
    term = f"{added.equation}: {added.text}"
    # `result.gap_after` is above the floor of the model written, the two others above that of the
    # model with the term.
    if not after < result.gap_after or after > given:
        result.added = None
        result.reasons.append(
            f"refitted in the model ({term}) the term does not lower the error held out: it was "
            "not added"
        )
        return
    result.added = replace(added, gap=after, channels=tuple(gaps))
    result.reasons.append(
        f"refitted in the model ({term}) it takes away {added.explained:.0%} of the excess fitted "
        f"to, and held out the gap falls from {result.gap_after:.3g} to {after:.3g} noise variances"
    )


def _floor(search: Search, found: Found) -> None:
    """Set the floor of a finding: the cost per reading of a rig that is exactly the model found."""
    costs = [twin.costs(found.fitted.values).sum() for twin in search.twins(found.fitted.values)]
    found.floor = float(np.mean(costs)) / found.samples


def _standard_errors(search: Search, found: Found) -> dict[str, float]:
    """Return the standard error of each variable's parameter, SI, by the parameter's name.

    It is the larger of two: one from the scatter of the blocks' scores, the other from how wrong
    the parameters of twins, which are known, are estimated.
    """
    columns = found.filtered.columns(found.fitted.values, found.variables)
    names = [column.name for column in columns]
    linear = found.filtered.linearise(found.fitted.values, columns)
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


def form_error(value: float, before: float) -> float:
    """Return the standard error, SI, of an effect's parameter that comes from the effect's form.

    It is 0.5 % of the size of the effect.

    Args:
        value: fitted value, SI.
        before: value in the model as given, SI. If it is more than `ENDLESS` times `value`, and
            `value` is not 0, the effect is a limit that had no effect before, and its size is
            `value` itself; else the size is the difference.
    """
    size = value if abs(before) > ENDLESS * abs(value) > 0.0 else value - before
    return _FORM * abs(size)


def _estimate(plant: Plant, found: Found, variable: Variable, errors: dict[str, float]) -> Estimate:
    value = found.fitted.values[variable.parameter]
    before = plant.nominal[variable.parameter]
    form = form_error(value, before) if variable.key else 0.0
    error = np.hypot(errors[variable.parameter], form)
    reach = float(_NORMAL_95 * error)
    end = not variable.key and at_an_end(variable, found.fitted.values)
    unit = next(p.unit for p in plant.parameters if p.name == variable.parameter)
    return Estimate(
        variable.key or variable.parameter, variable.parameter, value, value - reach, value + reach,
        unit, before, end,
    )  # fmt: skip


def _named(
    plant: Plant, found: Found, named: Named, errors: dict[str, float], seen: _Seen
) -> NamedEffect:
    effect = plant.effects[named.effect]
    alike = seen.cosines[named.effect]
    possible = {a.effect for a in named.indistinguishable}
    rivals = [
        Rival(a.effect, a.share, a.z, alike.get(a.effect, float("nan")),
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
        seen.held_out[named.effect],
    )  # fmt: skip
