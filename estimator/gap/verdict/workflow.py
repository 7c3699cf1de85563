"""This module runs the whole workflow, from recordings to the verdict and the model written."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from estimator.gap.plant import NOT_IN_FILES, PHASES, Plant, record_of
from estimator.gap.prediction import (
    Curve,
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
    with_effect_of,
    worse_than_resting,
)
from estimator.gap.search import (
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

from .at_random import random_delays
from .choosing import Choice, choose
from .describing import Wanted, described_as, measured, stuck_channels, without_unwanted
from .experiments import separations
from .intervals import form_error, standard_errors
from .judging import Evidence, Judgement, judge
from .keeping import (
    at_an_end,
    changed_since,
    ends_in_words,
    growth,
    held_out_deviate,
    take_back,
    why_worse,
)
from .one_curve import OneCurve
from .phases import as_written, beginning, known_phases
from .unneeded import without_unneeded
from .unsettled import compared, unsettled


def find_gap(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    plant: Plant,
    seed: int = 1,
    wanted: Wanted | None = None,
    said: Callable[[str], None] = lambda words: None,
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
        said: is told in words what is being done; nobody is by default.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
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
    both = [every[: len(recordings)], every[len(recordings) :]]
    used = [usable(whole, plant) for whole in both]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        fitter, judged = (Fitter(Predictor(plant), each, pool) for each in used)
        result.reasons = unsuitable(fitter, judged)
        if not result.reasons:
            try:
                _search(result, Search(fitter, seed), judged, wanted or Wanted(), said)
            except np.linalg.LinAlgError:
                result.verdict, result.effects, result.channels = "inconclusive", [], []
                result.discovered = []
                result.values, result.names, result.as_given = dict(plant.nominal), (), True
                result.reasons = ["no values of the parameters make the model's predictions finite"]
        _show(result, judged)
    stuck = stuck_channels([*recordings, *holdout], plant)
    result.discovered = [*result.discovered, *stuck]
    if stuck and result.verdict == "adequate":
        # A rig with a stuck channel is not as its model is.
        result.verdict = "unknown_effect"
    long = [record for whole in both for record in whole if slices_of(record, plant.period)]
    lost = sum(map(len, long)) - sum(len(record) for records in used for record in records)
    if lost:
        result.reasons.append(
            f"{lost * plant.period:.1f} s of the recordings cannot be followed, as two readings or "
            "more are missing or at an end of their range there: they are left out"
        )
    return result


def _search(
    result: GapResult,
    search: Search,
    judged: Fitter,
    wanted: Wanted,
    said: Callable[[str], None],
) -> None:
    """Search the records, and set what is found, the verdict and its reasons in the result.

    If the verdict is inconclusive, the model as given stays the one that is written.
    """
    said("trying the effects of the catalogue")
    discovering = Discovering(search.refits, search.twins)
    curve = OneCurve(discovering)
    found = search.run(lambda begun: curve.narrowed(begun, _floor(search, begun)))
    found.floor = _floor(search, curve.first if curve.first and curve.is_enough else found)
    said("looking for what the catalogue does not have")
    choice = choose(discovering, found, MATERIAL, curve.first)
    choice = without_unneeded(search, discovering, found, choice)
    said("looking where the model was wrong, and what is left")
    result.verdict, result.reasons = _judgement(result, search, found, choice, judged)
    if result.verdict == "inconclusive":
        result.rest, result.channels, result.discovered = result.where, [], []
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

    The finding is changed in place: it gets the model that was chosen, with the phases of tones in
    the held-out recordings, and names no effects if none were chosen. In the result, `where` and
    `rest` are set: where the model was wrong, and what is left; and `discovered` is set to an input
    that acts at random times, which no curve shows.
    """
    refitted, values = found.filtered.at(found.refitted.values), found.refitted.values
    result.where = result.rest = _curves(refitted, values, search.refits.nuisances, found.floor)
    if not choice.named:
        found.named = []
    model = choice.model
    phased = known_phases(model.fitted.values, judged)
    if phased is not model.fitted.values:
        model.fitted = Fitted(dict(phased), model.fitted.costs)
        model.filtered = search.fitter.filtered(phased)
    found.fitted, found.filtered, found.variables = model.fitted, model.filtered, model.variables
    if choice.named or choice.discovered:
        result.rest = _curves(found.filtered, found.fitted.values, found.variables, found.floor)
    twins = search.twins.of(found.fitted.values)
    left = unsettled(found.filtered, twins, found.fitted.values)
    left = compared(left, refitted, values)
    result.discovered = random_delays(found.filtered, found.fitted.values, left)
    # A disturbance of a reading does not count as located, because it explains much even of another
    # rig, or of swapped channels.
    places = {equation.name for equation in search.plant.equations}
    return judge(
        Evidence(
            found=found,
            discovered=choice.discovered,
            rest=result.rest,
            located=max(
                (each.share for each in result.where if each.equation in places), default=0.0
            ),
            resting=_resting(found.filtered, judged),
            unsettled=left,
            held_out=search.held_out_excess(judged, found.fitted.values),
        )
    )


def _set_answer(
    result: GapResult, search: Search, found: Found, choice: Choice, judged: Fitter, wanted: Wanted
) -> None:
    """Set in the result all that is told if the verdict is not inconclusive.

    That is the effects, disturbances, refitted nuisances, the model written with its held-out gap,
    detection limits, experiments and further reasons. If the fitted model predicts worse than the
    model as given, the latter is written, and the verdict may change (`take_back`).
    """
    fitter, plant = search.fitter, search.plant
    described = {
        id(each): described_as(each, plant)
        for each in (*choice.discovered, *choice.corrections.values())
    }
    # All is told of the whole model, and then what is not wanted is left out of that written.
    kept = without_unwanted(search, found, choice, described, wanted)
    result.values = dict(known_phases(kept, judged))
    result.names, result.as_given = tuple(named.effect for named in found.named), False
    at_random, result.discovered = result.discovered, []
    for each in choice.discovered:
        told = described[id(each)]
        in_model = wanted.allows(told) and each.addition.form not in NOT_IN_FILES
        result.discovered.append(measured(replace(told, in_model=in_model), each, judged))
    result.discovered += at_random
    result.reasons += [
        f"{each.text} It is suspected to be a leak, so that the model written does not have it: "
        "the leak detector would not see it; --accept-leaks adds it"
        for each in result.discovered
        if each.suspected_leak and not each.in_model and wanted.discovered
    ]
    _measure(result, judged)
    gap = (result.gap_before, result.gap_after)
    held_out, fitted_to = (growth(each, plant.nominal, result.values) for each in (judged, fitter))
    worse = why_worse(held_out, gap, fitted_to, named=bool(found.named))
    errors = standard_errors(search, found)
    corrections = {name: described[id(each)] for name, each in choice.corrections.items()}
    result.effects = [
        _named(search, found, named, errors, judged, corrections.get(named.effect))
        for named in found.named
    ]
    result.refitted = [_fitted(plant, found, v, errors) for v in found.variables if not v.key]
    if worse is None:
        result.reasons += changed_since(judged, result.values, gap)
    else:
        names = " and ".join(named.effect for named in found.named)
        take_back(result, plant, names or "the refit", worse)
    result.values, left_out = as_written(plant.layout, result.values)
    if "tone" in left_out:
        begins_s = beginning(plant.period) * plant.period
        result.reasons.append(
            "the model written does not have the tone, because it begins each recording at another "
            "phase; the gap after is computed with the tone, whose phase is taken from the first "
            f"{begins_s:g} s of each recording held out"
        )
    for form in [each for each in dict.fromkeys(left_out) if each != "tone"]:
        result.reasons.append(
            f"the model written does not have the {form}, because simulator and filters have no "
            f"memory for it; the gap after is computed with the {form}"
        )
    if result.verdict != "unknown_effect":
        result.reasons += absorbed(search, found)
    result.limits = limits(found.filtered, found.fitted.values, found.variables)
    result.experiments = separations(plant, found, fitter.pool)


def _resting(filtered: Filtered, judged: Fitter) -> list[str]:
    """Return the names of the channels that the model predicts badly in any record.

    Badly means worse than the assumption that nothing changes (`worse_than_resting`). The
    predictions are made with the values of `filtered`, for its records and for the held-out ones.
    """
    values = filtered.values
    found = filtered.pool.map(
        lambda record, gains: worse_than_resting(filtered.predictor, record, gains, values),
        (*filtered.records, *judged.records), (*filtered.gains, *judged.filtered(values).gains),
    )  # fmt: skip
    return list(dict.fromkeys(channel for channels in found for channel in channels))


def _curves(
    filtered: Filtered, values: Values, variables: Sequence[Variable], floor: float
) -> list[Curve]:
    """Return the disturbances and drifts that would explain the cost above a floor.

    They are sorted by the share that they explain, the best first; the arguments are those of
    `drifts`.
    """
    curves = attribution(filtered, values, variables).curves(floor)
    curves += drifts(filtered, values, variables, floor)
    return sorted(curves, key=lambda curve: -curve.share)


def _cosines(search: Search, found: Found, named: Named) -> dict[str, float]:
    """Return the cosine of a named effect's signature with itself and that of each alternative.

    The keys are the names of the effects, that of the named one first. Nuisances and all else that
    was found are projected out. All are NaN if the model breaks down without both.
    """
    plant, effect = search.plant, search.plant.effects[named.effect]
    values = with_effect_of(found.fitted.values, effect, plant.nominal)
    changes: dict[str, Values] = {named.effect: found.fitted.values}
    for rival in named.alternatives:
        other = plant.effects[rival.effect]
        changes[rival.effect] = with_effect_of(values, other, rival.fitted.values)
    own = effect_variables(effect)
    kept = [v for v in found.variables if v not in own]
    alike = cosines(found.filtered, values, kept, changes)
    return dict(zip(changes, map(float, alike), strict=True))


def _show(result: GapResult, judged: Fitter) -> None:
    """Set the held-out gap, unless it is known already, and the free simulations in the result.

    Nothing is set without held-out records; there are no simulations if a gap is not finite.
    """
    if not judged.records:
        return
    # The gap of the fitted model is known already, from when it was judged.
    if not result.channels:
        _measure(result, judged)
    if result.channels:
        given = judged.predictor.plant.nominal
        result.free_runs = free_runs(judged.predictor, judged.records, given, result.values)


def _measure(result: GapResult, judged: Fitter) -> None:
    """Set the held-out gaps of the model as given and of the one written.

    If one of them is not finite, both become NaN and the channels' gaps are left out.
    """
    given = judged.predictor.plant.nominal
    gaps = channel_gaps(
        judged.predictor, judged.records, given, result.values, judged.pool,
        measured=judged.measured,
    )  # fmt: skip
    before, after = mean_gap(gaps)
    finite = bool(np.isfinite(before + after))
    result.channels = gaps if finite else []
    result.gap_before, result.gap_after = (before, after) if finite else (np.nan, np.nan)


def _floor(search: Search, model: Found | DiscoveredModel) -> float:
    """Return the floor of a model: the cost per reading of a rig that is exactly like it.

    Noise that a sensor is stated to have, and has not, is left out (`unheard`): it would hide as
    much of what the model lacks.
    """
    values, filtered = model.fitted.values, model.filtered
    twins = search.twins.of(values)
    costs = [twin.costs(values).sum() for twin in twins]
    return float(np.mean(costs)) / filtered.samples - unheard(filtered, twins, values)


def _fitted(plant: Plant, found: Found, variable: Variable, errors: dict[str, float]) -> Estimate:
    """Return the estimate of a fitted variable; `errors` has standard errors by parameter."""
    name, values = variable.parameter, found.fitted.values
    form = form_error(values[name], plant.nominal[name]) if variable.key else 0.0
    end = not variable.key and at_an_end(variable, values)
    error = float(np.hypot(errors[name], form))
    return _estimate(plant, variable.key or name, name, values[name], error, at_an_end=end)


def _estimate(
    plant: Plant, key: str, parameter: str, value: float, error: float, *, at_an_end: bool = False
) -> Estimate:
    """Return a parameter's value with its 95 % interval from its standard error, SI."""
    reach = NORMAL_95 * error
    unit = next(p.unit for p in plant.parameters if p.name == parameter)
    before = plant.nominal[parameter]
    return Estimate(key, parameter, value, value - reach, value + reach, unit, before, at_an_end)


def _named(
    search: Search, found: Found, named: Named, errors: dict[str, float], judged: Fitter,
    correction: Discovered | None,
) -> NamedEffect:  # fmt: skip
    """Return a named effect as it is reported.

    Args:
        search: the search that found it.
        found: finding with everything that was chosen.
        named: the effect.
        errors: standard errors, SI, by parameter.
        judged: fitter of the held-out records.
        correction: the curve that corrects the effect's formula; None if there is none.
    """
    plant, effect = search.plant, search.plant.effects[named.effect]
    if named.read is None:
        alike = _cosines(search, found, named)
        own = [v for v in found.variables if v.name == effect.name and v.key]
        estimates = tuple(_fitted(plant, found, v, errors) for v in own)
    else:
        alike, knob = {}, effect.knobs[0]
        estimates = (_estimate(plant, knob.key, knob.parameter, *named.read),)
    possible = {a.effect for a in named.indistinguishable}
    rivals = [
        Rival(a.effect, a.share, a.z, alike.get(a.effect, float("nan")),
              plant.not_told_apart.get(frozenset((named.effect, a.effect)), ""))
        for a in named.alternatives
    ]  # fmt: skip
    return NamedEffect(
        effect.name, effect.equation, effect.where, estimates, named.gain, named.bar, named.z,
        tuple(r for r in rivals if r.effect in possible),
        tuple(r for r in rivals if r.effect not in possible),
        effect.unseen, held_out_deviate(search.refits, found, named, judged), correction,
        named.read is not None,
    )  # fmt: skip
