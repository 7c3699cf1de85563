"""This module runs the whole workflow, from recordings to the verdict and the model written."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import PHASES, Knob, Plant, Record, record_of
from estimator.gap.prediction import (
    Curve,
    DetectionLimit,
    Discovered,
    Estimate,
    Filtered,
    Fitted,
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
    unheard,
    unsuitable,
    usable,
    worse_than_resting,
)
from estimator.gap.search import (
    ADDED,
    ENDLESS,
    MATERIAL,
    NORMAL_95,
    DiscoveredModel,
    Discovering,
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

from .another_day import changed_since
from .choosing import Choice, choose
from .confirming import held_out_deviates
from .describing import Wanted, described_as, kept_of, measured
from .experiments import separations
from .judging import Evidence, Judgement, judge
from .keeping import Worse, at_an_end, ends_in_words, growth, take_back, why_worse
from .one_curve import OneCurve
from .phases import BEGINNING_S, has_tones, known_phases, without_tones
from .stuck_channels import stuck_channels
from .unsettled import compared, unsettled

_FORM: Final = 5e-3
"""Part of an effect's size that is added to its standard error. The rig never has exactly the form
of the model and its effects, which the scatter of the recordings does not show. Twice this part is
1 %."""


def find_gap(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    plant: Plant,
    seed: int = 1,
    wanted: Wanted | None = None,
    said: Callable[[str], None] | None = None,
) -> GapResult:
    """Return where a plant's model and its recordings disagree, and what the model lacks.

    If the recordings cannot support a verdict, it is `inconclusive`, with the model as given and
    the reasons. That is so without held-out recordings, too.

    Args:
        recordings: recordings to fit to.
        holdout: recordings to judge with; nothing is fitted to them.
        plant: plant with the model to be tested.
        seed: seed of the twins' sensor noise.
        wanted: what the model written may hold; None for all but suspected leaks.
        said: is told in words what is being done.

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
    # A tone has a phase for each of a few recordings; with more of them none is looked for.
    few = len(recordings) + len(holdout) <= PHASES
    every = [
        replace(record_of(recording, plant), number=number if few else PHASES)
        for number, recording in enumerate((*recordings, *holdout))
    ]
    whole, whole_judged = every[: len(recordings)], every[len(recordings) :]
    records, judged = usable(whole, plant), usable(whole_judged, plant)
    tell = said or _silent
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        fitter, judge_with = (Fitter(predictor, each, pool) for each in (records, judged))
        result.reasons = unsuitable(fitter, judge_with)
        if not result.reasons:
            try:
                _search(result, Search(fitter, seed), judge_with, wanted or Wanted(), tell)
            except np.linalg.LinAlgError:
                result.verdict, result.effects, result.channels = "inconclusive", [], []
                result.discovered = []
                result.values, result.names, result.as_given = dict(plant.nominal), (), True
                result.reasons = ["no values of the parameters make the model's predictions finite"]
        _show(result, predictor, judged, pool)
    _tell_stuck(result, [*recordings, *holdout], plant)
    long = [record for record in (*whole, *whole_judged) if slices_of(record, plant.period)]
    lost = sum(map(len, long)) - sum(map(len, [*records, *judged]))
    if lost:
        result.reasons.append(
            f"{lost * plant.period:.1f} s of the recordings cannot be followed, as two readings or "
            "more are missing or at an end of their range there: they are left out"
        )
    return result


def _tell_stuck(result: GapResult, recordings: Sequence[Recording], plant: Plant) -> None:
    """Set the channels that are stuck in the result: a rig with one is not as its model is."""
    stuck = stuck_channels(recordings, plant)
    result.discovered = [*result.discovered, *stuck]
    if stuck and result.verdict == "adequate":
        result.verdict = "unknown_effect"


def _silent(words: str) -> None:
    """Tell nobody what is being done."""


def _search(
    result: GapResult,
    search: Search,
    judged: Fitter,
    wanted: Wanted,
    said: Callable[[str], None],
) -> None:
    """Run the search, and set its findings and the verdict in the result."""
    said("trying the effects of the catalogue")
    discovering = Discovering(search.refits, search.twins)
    curve = OneCurve(discovering)
    found = search.run(lambda begun: curve.narrowed(begun, _floor(search, begun)))
    found.floor = _floor(search, curve.first if curve.first and curve.is_enough else found)
    said("looking for what the catalogue does not have")
    choice = choose(discovering, found, MATERIAL, curve.first)
    said("looking where the model was wrong, and what is left")
    judgement = _judgement(result, search, found, choice, judged)
    result.verdict, result.reasons = judgement.verdict, list(judgement.reasons)
    if result.verdict == "inconclusive":
        result.rest, result.channels = result.where, []
        result.reasons += ends_in_words(search.refits.nuisances, found.refitted.values)
        return
    result.reasons += ends_in_words(found.variables, found.fitted.values)
    if found.named or choice.discovered:
        result.accounted = found.explained
    result.explained = found.explained if found.named else float("nan")
    _set_answer(result, search, found, choice, judged, wanted)


def _judgement(
    result: GapResult, search: Search, found: Found, choice: Choice, judged: Fitter
) -> Judgement:
    """Return the judgement on what was chosen.

    The model that was chosen becomes that of the finding. Where the model was wrong and what is
    left are set in the result.
    """
    refitted = found.filtered.at(found.refitted.values)
    before = attribution(refitted, found.refitted.values, search.refits.nuisances)
    result.where = result.rest = _ranked(
        before.curves(found.floor),
        drifts(refitted, found.refitted.values, search.refits.nuisances, found.floor),
    )
    if not choice.named:
        found.named = []
    model = choice.model
    values = known_phases(model.fitted.values, judged)
    if values is not model.fitted.values:
        model.fitted = Fitted(dict(values), model.fitted.costs)
        model.filtered = search.fitter.filtered(values)
    found.fitted, found.filtered, found.variables = model.fitted, model.filtered, model.variables
    if choice.named or choice.discovered:
        after = attribution(found.filtered, found.fitted.values, found.variables)
        result.rest = _ranked(
            after.curves(found.floor),
            drifts(found.filtered, found.fitted.values, found.variables, found.floor),
        )
    twins = search.twins.of(found.fitted.values)
    left = unsettled(found.filtered, twins, found.fitted.values)
    left = compared(left, refitted, found.refitted.values)
    return judge(
        Evidence(
            found=found,
            discovered=choice.discovered,
            rest=result.rest,
            located=_located(search.plant, result.where),
            resting=_resting(found.filtered, judged),
            unsettled=left,
            held_out=search.held_out_excess(judged, found.fitted.values),
        )
    )


def _set_answer(
    result: GapResult, search: Search, found: Found, choice: Choice, judged: Fitter, wanted: Wanted
) -> None:
    """Set effects, disturbances, the model written and its held-out gap in the result."""
    fitter, plant = search.fitter, search.plant
    known = _known(search, found, judged)
    described = {
        id(each): described_as(each, plant)
        for each in (*choice.discovered, *choice.corrections.values())
    }
    # All is told of the whole model, and then what is not wanted is left out of that written.
    kept = kept_of(search, found, choice, described, wanted)
    layout = plant.layout
    result.values, result.names = dict(kept.values), tuple(n.effect for n in found.named)
    if layout is not None and has_tones(layout, kept.values):
        result.values = without_tones(layout, kept.values)
        result.reasons.append(
            "the model written has no tone, as it begins each recording at another phase; the gap "
            f"after has it, with the phase of the first {BEGINNING_S:g} s of what was held out"
        )
    result.as_given = False
    result.discovered = [
        measured(replace(described[id(each)], in_model=kept.writes(each)), each, fitter, judged)
        for each in choice.discovered
    ]
    result.reasons += [
        f"{each.text} It is suspected to be a leak, so that the model written does not have it: "
        "the leak detector would not see it; --accept-leaks adds it"
        for each in result.discovered
        if each.suspected_leak and not each.in_model and wanted.discovered
    ]
    worse = _compare(result, fitter, judged, kept.values, named=bool(found.named))
    corrections = {name: described[id(each)] for name, each in choice.corrections.items()}
    result.effects = [
        _named(plant, found, named, known, corrections.get(named.effect)) for named in found.named
    ]
    result.refitted = [
        _estimate(plant, found, v, known.errors) for v in found.variables if not v.key
    ]
    if worse is None:
        gap = (result.gap_before, result.gap_after)
        result.reasons += changed_since(judged, result.values, gap)
    else:
        names = " and ".join(named.effect for named in found.named)
        take_back(result, plant, names or "the refit", worse)
        result.discovered = [replace(each, in_model=False) for each in result.discovered]
    if result.verdict != "unknown_effect":
        result.reasons += known.absorbed
    result.limits = known.limits
    result.experiments = separations(plant, found, fitter.pool)


@dataclass(frozen=True)
class _Known:
    """What is known of a finding in addition to its fit.

    Attributes:
        held_out: normal deviate of each effect's gain on the held-out recordings, by effect.
        cosines: cosine of each effect's signature with those of its rivals, by effect and rival.
        errors: standard errors, SI, by parameter.
        limits: for each effect the smallest size that these motions would show.
        absorbed: remarks in words on effects that the refit of a nuisance may stand for.
    """

    held_out: dict[str, float]
    cosines: dict[str, dict[str, float]]
    errors: dict[str, float]
    limits: list[DetectionLimit]
    absorbed: list[str]


def _known(search: Search, found: Found, judged: Fitter) -> _Known:
    """Return what is known of a finding in addition to its fit."""
    return _Known(
        held_out_deviates(search.refits, found, judged),
        {n.effect: {} if n.read else _cosines(search, found, n) for n in found.named},
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


def _located(plant: Plant, curves: Sequence[Curve]) -> float:
    """Return the part of the excess that the best disturbance of one equation explains.

    A disturbance of a reading does not count, because it explains much even of another rig, or of
    swapped channels.
    """
    places = {equation.name for equation in plant.equations}
    shares = [curve.share for curve in curves if curve.equation in places]
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


def _compare(
    result: GapResult, fitter: Fitter, judged: Fitter, values: Values, *, named: bool
) -> Worse | None:
    """Set the held-out gap of a model with these values; return why it is worse, else None."""
    predictor, pool = fitter.predictor, fitter.pool
    given = predictor.plant.nominal
    _measure(result, predictor, judged.records, values, pool)
    held_out, fitted_to = (
        growth(predictor, records, given, values, pool)
        for records in (judged.records, fitter.records)
    )
    gap = (result.gap_before, result.gap_after)
    return why_worse(held_out, gap, fitted_to, named=named)


def _floor(search: Search, model: Found | DiscoveredModel) -> float:
    """Return the floor of a model: the cost per reading of a rig that is exactly like it.

    Noise that a sensor is stated to have, and has not, is left out (`unheard`): it would hide as
    much of what the model lacks.
    """
    values, filtered = model.fitted.values, model.filtered
    twins = search.twins.of(values)
    costs = [twin.costs(values).sum() for twin in twins]
    return float(np.mean(costs)) / filtered.samples - unheard(filtered, twins, values)


def _standard_errors(search: Search, found: Found) -> dict[str, float]:
    """Return the standard error of each variable's parameter, SI, by the parameter's name.

    It is the larger of two: one from the scatter of the blocks' scores, the other from how wrong
    the parameters of twins, which are known, are estimated. A variable that is held beside a
    disturbance has the error that it has without.
    """
    columns = found.filtered.columns(found.fitted.values, found.variables)
    names = [column.name for column in columns]
    linear = found.filtered.linearise(found.fitted.values, columns)
    held = np.array([variable.is_held for variable in found.variables])
    added = np.array([variable.name == ADDED for variable in found.variables])
    errors = np.zeros(len(names))
    for these, told in ((~held, ~held), (~added, held & ~added)):
        among = [name for name, one in zip(names, these, strict=True) if one]
        if told.any():
            errors[told] = linear.errors(among, linear.solve(among)[0])[told[these]]
    misses = []
    for twin in search.twins.of(found.fitted.values, 3):
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
    reach = float(NORMAL_95 * error)
    end = not variable.key and at_an_end(variable, found.fitted.values)
    unit = next(p.unit for p in plant.parameters if p.name == variable.parameter)
    return Estimate(
        variable.key or variable.parameter, variable.parameter, value, value - reach, value + reach,
        unit, before, end,
    )  # fmt: skip


def _read(plant: Plant, knob: Knob, value: float, error: float) -> Estimate:
    """Return the value of a knob that was read off a curve; `error` is its standard error."""
    unit = next(p.unit for p in plant.parameters if p.name == knob.parameter)
    reach = NORMAL_95 * error
    return Estimate(
        knob.key, knob.parameter, value, value - reach, value + reach, unit,
        plant.nominal[knob.parameter],
    )  # fmt: skip


def _named(
    plant: Plant, found: Found, named: Named, known: _Known, correction: Discovered | None
) -> NamedEffect:
    """Return a named effect as it is reported; `correction` is the curve that corrects it."""
    effect = plant.effects[named.effect]
    alike = known.cosines[named.effect]
    possible = {a.effect for a in named.indistinguishable}
    rivals = [
        Rival(a.effect, a.share, a.z, alike.get(a.effect, float("nan")),
              plant.not_told_apart.get(frozenset((named.effect, a.effect)), ""))
        for a in named.alternatives
    ]  # fmt: skip
    return NamedEffect(
        effect.name, effect.equation, effect.where,
        (_read(plant, effect.knobs[0], *named.read),) if named.read else
        tuple(_estimate(plant, found, v, known.errors) for v in found.variables
              if v.name == effect.name and v.key),
        named.gain, named.bar, named.z,
        tuple(r for r in rivals if r.effect in possible),
        tuple(r for r in rivals if r.effect not in possible),
        effect.unseen,
        known.held_out[named.effect],
        correction,
        named.read is not None,
    )  # fmt: skip
