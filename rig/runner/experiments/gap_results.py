"""Converts the result of a gap search to `gap.json`, `rig gap --json`, and a model's provenance."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np

import rig
from estimator.gap import (
    Curve,
    Discovered,
    Estimate,
    FreeRun,
    GapResult,
    NamedEffect,
    Plant,
    Rival,
    Round,
    Separation,
    servo_actuator,
)
from rig.configuration import dump_model
from rig.plant import CATALOGUE, DATA_SHEET, Model, SensorParameters
from rig.runner.outcomes import git_state, model_sha256, versions

from .gap_additions import slots_of, with_terms
from .gap_motions import EXPERIMENT_S, MARGIN_M, Room, motions

REVISED: Final = "revised"
"""Word that is appended to the name of the tested model, unless the name ends with it already."""
_DIGITS: Final = 6


def rig_plant(
    model: Model,
    sensors: SensorParameters = DATA_SHEET,
    room: Room | None = None,
    experiment_s: float = EXPERIMENT_S,
) -> Plant:
    """Return a rig with a model as the gap workflow's `Plant`, whose `write` writes model files.

    Args:
        model: the model to be tested.
        sensors: data sheet of the rig's transducers.
        room: range in which experiments may move the ram; the stroke less a margin if not given.
        experiment_s: duration of an experiment, s.
    """
    par = model.parameters
    space = room or Room(par.stroke_min + MARGIN_M, par.stroke_max - MARGIN_M)
    middle = 0.5 * (par.supply_pressure + par.return_pressure)
    plant = servo_actuator(model, sensors)
    return replace(
        plant,
        nominal={**plant.nominal, **slots_of(plant, model.discovered)},
        write=partial(_write_model, model),
        motions=partial(motions, space, middle, experiment_s),
        loop=((0, 0, space.gain),),
    )


def _write_model(
    parent: Model,
    values: Mapping[str, float],
    effects: tuple[str, ...],
    provenance: Mapping[str, Any],
    path: Path,
) -> None:
    """Write the file of a revised model.

    The name is the parent's with `REVISED`, or unchanged if the model is the same as its parent.

    Args:
        parent: the model that was tested.
        values: all parameters of the revised model, by their names.
        effects: effects that were found, to be added to the parent's.
        provenance: where the model comes from; the parent is added to it.
        path: of the file.

    Raises:
        ConfigError: a value is outside the range that a model file may hold.
        OSError: the file cannot be written.
    """
    kept = [name for name in parent.effects if name not in effects]
    added = [name for name in effects if name in CATALOGUE]
    parameters, others = with_terms(values, parent.discovered)
    same_terms = sorted(others) == sorted(parent.discovered)
    same = parameters == parent.parameters and not added and same_terms
    revised = same or parent.name.endswith(f" {REVISED}")
    name = parent.name if revised else f"{parent.name} {REVISED}"
    parents: dict[str, Any] = {"name": parent.name, "sha256": model_sha256(parent)}
    if parent.provenance:
        parents["provenance"] = dict(parent.provenance)
    origin = {"parent": parents, **provenance}
    dump_model(Model(name, parameters, (*kept, *added), origin, others), path)


def provenance_of(result: GapResult, command: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the provenance of a model that the gap workflow writes, as plain values.

    Args:
        result: result of the gap search.
        command: the command line; if empty, the key `command` is left out.
    """
    origin: dict[str, Any] = {"command": list(command)} if command else {}
    return {
        "written_by": "rig gap",
        **origin,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "recordings": _recordings(result.identification),
        "holdout": _recordings(result.holdout),
        "effects": {effect.name: _provenance_of(effect) for effect in result.effects},
        "discovered": [discovered_figures(each) for each in result.discovered],
        "written": result.written,
        "refitted": _refitted(result),
        "gap": _gap(result.gap_before, result.gap_after),
        "versions": versions(),
        "git": git_state(Path(rig.__file__).parent),
    }


def _provenance_of(effect: NamedEffect) -> dict[str, Any]:
    figures = effect_figures(effect)
    return {
        key: figures[key]
        for key in ("equation", "where", "parameters", "evidence", "indistinguishable_from")
    }


def _recordings(files: list[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"source": source, "sha256": sha256} for source, sha256 in files]


def answer(result: GapResult) -> dict[str, Any]:
    """Return the JSON-able object that `rig gap --json` prints; programs rely on its keys."""
    return {
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "effects": [_short(effect) for effect in result.effects],
        "written": result.written,
        "refitted": _refitted(result),
        "gap": _gap(result.gap_before, result.gap_after),
        "where": [where_figures(curve) for curve in result.where[:3]],
        "experiment": _first_experiment(result),
        "discovered": [discovered_figures(each) for each in result.discovered],
        "accounted": _plain(result.accounted),
    }


def _refitted(result: GapResult) -> dict[str, Any]:
    """Return the refitted nuisances; `kept` says whether the written model has their new values."""
    return {
        each.key: estimate_figures(each)
        | {"kept": not result.as_given, "at_an_end": each.at_an_end}
        for each in result.refitted
    }


def discovered_figures(each: Discovered) -> dict[str, Any]:
    """Return a discovered disturbance, JSON-able (docs/gap.md lists the keys)."""
    parameters: dict[str, Any] = {
        estimate.key: {
            key: value for key, value in estimate_figures(estimate).items() if key != "before"
        }
        for estimate in each.estimates
    }
    if len(each.at):
        parameters["table"] = table_figures(each)
    return {
        "name": each.name,
        "equation": each.place,
        "of": f"{each.of} x {each.times}" if each.times else each.of,
        "form": each.form,
        "text": each.text,
        "parameters": parameters,
        "evidence": {
            "gain": _plain(each.gain), "z": _plain(each.z), "share": _plain(each.share),
        },
        "gap": _gap(*each.gap),
        "could_also_be": list(each.could_also_be),
        "in_model": each.in_model,
        "suspected_leak": each.suspected_leak,
        "experiment": each.experiment,
    }  # fmt: skip


def table_figures(each: Discovered) -> dict[str, Any]:
    """Return the table of a discovered disturbance, SI, JSON-able."""
    return {
        "at": [_plain(float(x)) for x in each.at],
        "values": [_plain(float(y)) for y in each.values],
        "errors": [_plain(float(e)) for e in each.errors],
        "unit": each.unit,
        "of_unit": each.of_unit,
    }


def correction_figures(each: Discovered | None) -> dict[str, Any] | None:
    """Return the curve that corrects an effect's formula, JSON-able; None if there is none."""
    if each is None:
        return None
    found = {"equation": each.place, "of": each.of, "form": each.form, **table_figures(each)}
    if not len(each.at):
        found["parameters"] = {e.key: estimate_figures(e) for e in each.estimates}
    return found


def _first_experiment(result: GapResult) -> dict[str, Any] | None:
    """Return the first proposed experiment that has a campaign; None if none is proposed.

    If no proposed experiment has one, because no motion would help, the first one is returned.
    """
    best = sorted(result.experiments, key=lambda experiment: not experiment.campaign)
    return experiment_figures(best[0]) if best else None


def _short(effect: NamedEffect) -> dict[str, Any]:
    figures = effect_figures(effect)
    keys = ("name", "parameters", "evidence", "indistinguishable_from", "form", "correction")
    return {key: figures[key] for key in keys}


def gap_figures(result: GapResult, plant: Plant) -> dict[str, Any]:
    """Return the whole result as the content of `gap.json` (docs/gap.md lists the keys)."""
    own = {parameter.name for parameter in plant.own_parameters}
    return answer(result) | {
        "plant": plant.name,
        "effects": [effect_figures(effect) for effect in result.effects],
        "channels": [
            {
                "channel": gap.channel,
                "before": _plain(gap.before - gap.floor),
                "after": _plain(gap.after - gap.floor),
                "floor": _plain(gap.floor),
                "rms_before": _plain(gap.rms_before),
                "rms_after": _plain(gap.rms_after),
                "scatter": _plain(gap.scatter),
                "unit": gap.unit,
                "whiteness": {
                    "before": _plain(gap.whiteness_before),
                    "after": _plain(gap.whiteness_after),
                    "floor": _plain(gap.whiteness_floor),
                },
                "frequency": [
                    {
                        "from_Hz": band.low,
                        "to_Hz": band.high,
                        "before": _plain(band.before),
                        "after": _plain(band.after),
                        "floor": _plain(band.floor),
                    }
                    for band in gap.bands
                ],
            }
            for gap in result.channels
        ],
        "explained": _plain(result.explained),
        "where": [where_figures(curve) | _curve(curve) for curve in result.where],
        "rest": [where_figures(curve) | _curve(curve) for curve in result.rest],
        "limits": {
            limit.effect: {"key": limit.key, "size": _plain(limit.size), "unit": limit.unit}
            for limit in result.limits
        },
        "experiments": [experiment_figures(each) for each in result.experiments],
        "free_runs": [_free_run(run) for run in result.free_runs],
        "parameters": {name: _plain(value) for name, value in result.values.items() if name in own},
        "names": list(result.names),
        "recordings": _recordings(result.identification),
        "holdout": _recordings(result.holdout),
        "seconds": {"identification": result.seconds[0], "holdout": result.seconds[1]},
        "versions": versions(),
        "rounds": [round_figures(number, each) for number, each in enumerate(result.rounds, 1)],
    }


def estimate_figures(estimate: Estimate) -> dict[str, Any]:
    """Return a parameter's estimate with its 95 % interval and its value before, SI, JSON-able."""
    return {
        "value": _plain(estimate.value),
        "lower": _plain(estimate.lower),
        "upper": _plain(estimate.upper),
        "unit": estimate.unit,
        "before": _plain(estimate.before),
    }


def effect_figures(effect: NamedEffect) -> dict[str, Any]:
    """Return a named effect with parameters, evidence and rivals, JSON-able."""
    return {
        "name": effect.name,
        "equation": effect.equation,
        "where": effect.where,
        "parameters": {each.key: estimate_figures(each) for each in effect.parameters},
        "evidence": {
            "gain": _plain(effect.gain), "bar": _plain(effect.bar), "z": _plain(effect.z),
            "held_out_z": _plain(effect.held_out_z),
        },
        "indistinguishable_from": [rival.effect for rival in effect.indistinguishable],
        "form": effect.form,
        "correction": correction_figures(effect.correction),
        "rivals": [_rival(each, True) for each in effect.indistinguishable]
        + [_rival(each, False) for each in effect.excluded],
        "unseen": effect.unseen,
    }  # fmt: skip


def _rival(rival: Rival, possible: bool) -> dict[str, Any]:
    return {
        "name": rival.effect,
        "possible": possible,
        "share": _plain(rival.share),
        "z": _plain(rival.z),
        "cosine": _plain(rival.cosine),
        "why": rival.why,
    }


def where_figures(curve: Curve) -> dict[str, Any]:
    """Return how a disturbance of one equation would explain the gap, JSON-able.

    It has the share of the gap that is explained, and the disturbance's largest value with the
    place in the region where it occurs.
    """
    index = int(np.argmax(np.abs(curve.values)))
    return {
        "equation": curve.equation,
        "region": curve.region,
        "share": _plain(curve.share),
        "largest": _plain(float(curve.values[index])),
        "error": _plain(float(curve.errors[index])),
        "unit": curve.unit,
        "at": _plain(float(curve.at[index])),
        "region_unit": curve.region_unit,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    return {
        "curve": {
            "at": [_plain(x) for x in curve.at],
            "values": [_plain(y) for y in curve.values],
            "errors": [_plain(e) for e in curve.errors],
        },
        "gain": _plain(curve.gain),
    }


def experiment_figures(experiment: Separation) -> dict[str, Any]:
    """Return an experiment that would distinguish effects, with its campaign, JSON-able."""
    return {
        "effects": list(experiment.effects),
        "motion": experiment.motion,
        "campaign": experiment.campaign,
        "cosine": _plain(experiment.cosine),
        "predicted_z": _plain(experiment.z),
    }


def round_figures(number: int, settled: Round) -> dict[str, Any]:
    """Return one round of closing a gap on a rig, JSON-able; `number` counts from 1."""
    check = settled.check
    return {
        "round": number,
        "why": settled.why,
        "motions": list(settled.motions),
        "recordings": list(settled.recordings),
        "verdict": settled.verdict,
        "effects": [_short(effect) for effect in settled.effects],
        "discovered": [discovered_figures(each) for each in settled.discovered],
        "check": None
        if check is None
        else {
            "verdict": check.verdict,
            "effects": list(check.effects),
            "discovered": list(check.discovered),
            "gap": _gap(check.gap_before, check.gap_after),
        },
    }


def _free_run(run: FreeRun) -> dict[str, Any]:
    """Return the RMS errors of a free simulation before and after, without its samples."""
    return {
        "source": run.source,
        "channel": run.channel,
        "from_s": _plain(run.time_s[0]),
        "to_s": _plain(run.time_s[-1]),
        "rms_before": _plain(_rms(run.before - run.measured)),
        "rms_after": _plain(_rms(run.after - run.measured)),
        "unit": run.unit,
    }


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(errors))))


def _gap(before: float, after: float) -> dict[str, float | None]:
    return {"before": _plain(before), "after": _plain(after)}


def _plain(value: float) -> float | None:
    """Return a figure rounded to nine digits; None if it is NaN or infinite, which JSON lacks."""
    return float(f"{float(value):.{_DIGITS + 3}g}") if isfinite(value) else None
