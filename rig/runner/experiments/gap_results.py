"""Converts the result of a gap search to `gap.json`, `rig gap --json`, and a model's provenance."""

from collections.abc import Iterable, Mapping, Sequence
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
    FreeRun,
    GapResult,
    NamedEffect,
    Plant,
    Round,
    Separation,
    addition_of,
    servo_actuator,
    term_of,
)
from rig.configuration import dump_model
from rig.plant import (
    CATALOGUE,
    DATA_SHEET,
    AddedTerm,
    Model,
    Parameters,
    SensorParameters,
    model_sha256,
)
from rig.runner.outcomes import git_state, named, versions

from .gap_motions import Room, motions
from .parts import MARGIN_M

REVISED: Final = "revised"
"""Word that is appended to the name of the tested model, unless the name ends with it already."""
_DIGITS: Final = 9
"""Significant digits of a figure in the files."""
_FITTED: Final = ("value", "lower", "upper", "unit")
"""What is told of a parameter's estimate: its value, the ends of its 95 % interval, its SI unit."""
_IN_SHORT: Final = (
    "name", "parameters", "evidence", "indistinguishable_from", "form", "correction",
)  # fmt: skip
"""Keys of an effect's figures in the answer."""
_IN_PROVENANCE: Final = ("equation", "where", "parameters", "evidence", "indistinguishable_from")
"""Keys of an effect's figures in a model's provenance."""
_WHEN: Final = ("before", "after", "floor")
"""With the model as given, with the model as written, and for a rig that is just as written."""


def rig_plant(
    model: Model,
    sensors: SensorParameters = DATA_SHEET,
    room: Room | None = None,
) -> Plant:
    """Return a rig with a model as the gap workflow's `Plant`, whose `write` writes model files.

    Discovered terms of the model that the plant cannot hold are left out.

    Args:
        model: the model to be tested.
        sensors: data sheet of the rig's transducers.
        room: range in which experiments may move the ram; the stroke less a margin if not given.
    """
    par = model.parameters
    space = room or Room(par.stroke_min + MARGIN_M, par.stroke_max - MARGIN_M)
    middle = 0.5 * (par.supply_pressure + par.return_pressure)
    plant = servo_actuator(model, sensors)
    layout = plant.layout
    assert layout is not None
    # Terms of the model that neither its equations nor the slots can hold are left out.
    added = [each for each in map(addition_of, model.discovered) if not layout.why_not(each)]
    slots = layout.values([*layout.additions(plant.nominal), *added])
    return replace(
        plant,
        nominal={**plant.nominal, **slots},
        write=partial(_write_model, model),
        motions=partial(motions, space, middle),
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

    The model's name is the parent's with `REVISED`; it is the parent's own if that ends with the
    word already, or if the revised model is the same as its parent.

    Args:
        parent: the model that was tested.
        values: all parameters of the revised model, by their names.
        effects: effects that were found, to be added to the parent's.
        provenance: where the model comes from; the parent is added to it.
        path: path of the file.

    Raises:
        ConfigError: a value is outside the range that a model file may hold.
        OSError: the file cannot be written.
    """
    kept = [name for name in parent.effects if name not in effects]
    added = [name for name in effects if name in CATALOGUE]
    parameters, others = with_terms(values, parent.discovered)
    same = parameters == parent.parameters and sorted(others) == sorted(parent.discovered)
    revised = (same and not added) or parent.name.endswith(f" {REVISED}")
    name = parent.name if revised else f"{parent.name} {REVISED}"
    parents: dict[str, Any] = {"name": parent.name, "sha256": model_sha256(parent)}
    if parent.provenance:
        parents["provenance"] = dict(parent.provenance)
    origin = {"parent": parents, **provenance}
    dump_model(Model(name, parameters, (*kept, *added), origin, others), path)


def with_terms(
    values: Mapping[str, float], given: Sequence[AddedTerm] = ()
) -> tuple[Parameters, tuple[AddedTerm, ...]]:
    """Return a rig's parameters, and the terms of its model that these parameters cannot hold.

    The terms are those of `given` that no slot of the workflow's plant can hold, as they are, and
    then those that the slots hold.

    Args:
        values: values of all parameters of the workflow's plant, also of its slots, by name.
        given: terms of the model as given that the rig's parameters cannot hold.
    """
    parameters = Parameters(**{field: values[field] for field in Parameters._fields})
    plant = servo_actuator(Model(parameters=parameters))
    layout = plant.layout
    assert layout is not None
    own = len(layout.additions(plant.nominal))
    in_slots = (term_of(each) for each in layout.additions(values)[own:])
    nowhere = (term for term in given if layout.why_not(addition_of(term)))
    return parameters, (*nowhere, *in_slots)


def provenance_of(result: GapResult, command: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the provenance of a model that the gap workflow writes, as plain values.

    Args:
        result: result of the gap search.
        command: the command line; if empty, the key `command` is left out.
    """
    told = answer(result)
    return {
        "written_by": "rig gap",
        **({"command": list(command)} if command else {}),
        **_some(told, ("verdict", "reasons")),
        "recordings": _recordings(result.identification),
        "holdout": _recordings(result.holdout),
        "effects": {each.name: _some(_effect(each), _IN_PROVENANCE) for each in result.effects},
        **_some(told, ("discovered", "written", "refitted", "gap")),
        "versions": versions(),
        "git": git_state(Path(rig.__file__).parent),
    }


def answer(result: GapResult) -> dict[str, Any]:
    """Return the JSON-able object that `rig gap --json` prints; programs rely on its keys.

    The key `kept` of a refitted nuisance says whether the written model has its new value. The
    experiment is the first one that has a campaign, or just the first if no motion would help.
    """
    experiments = sorted(result.experiments, key=lambda experiment: not experiment.campaign)
    return {
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "effects": [_some(_effect(each), _IN_SHORT) for each in result.effects],
        "written": result.written,
        "refitted": {
            each.key: _figures(each, *_FITTED, "before")
            | {"kept": not result.as_given, "at_an_end": each.at_an_end}
            for each in result.refitted
        },
        "gap": _gap(result.gap_before, result.gap_after) | {"scatter": _plain(result.gap_scatter)},
        "where": [_where(curve) for curve in result.where[:3]],
        "experiment": _experiment(experiments[0]) if experiments else None,
        "discovered": [_discovered(each) for each in result.discovered],
        "accounted": _plain(result.accounted),
    }


def gap_figures(result: GapResult, plant: Plant) -> dict[str, Any]:
    """Return the whole result as the content of `gap.json` (docs/gap.md lists the keys)."""
    own = {parameter.name for parameter in plant.own_parameters}
    return answer(result) | {
        "plant": plant.name,
        "effects": [_effect(effect) for effect in result.effects],
        "channels": [
            {
                "channel": gap.channel,
                "before": _plain(gap.before - gap.floor),
                "after": _plain(gap.after - gap.floor),
                **_figures(gap, "floor", "rms_before", "rms_after", "scatter", "unit"),
                "whiteness": {when: _plain(getattr(gap, f"whiteness_{when}")) for when in _WHEN},
                "frequency": [
                    {"from_Hz": band.low, "to_Hz": band.high, **_figures(band, *_WHEN)}
                    for band in gap.bands
                ],
            }
            for gap in result.channels
        ],
        "explained": _plain(result.explained),
        "where": [_where(curve) | _curve(curve) for curve in result.where],
        "rest": [_where(curve) | _curve(curve) for curve in result.rest],
        "limits": {each.effect: _figures(each, "key", "size", "unit") for each in result.limits},
        "experiments": [_experiment(each) for each in result.experiments],
        "free_runs": [_free_run(run) for run in result.free_runs],
        "parameters": {name: _plain(value) for name, value in result.values.items() if name in own},
        "names": list(result.names),
        "recordings": _recordings(result.identification),
        "holdout": _recordings(result.holdout),
        "seconds": {"identification": result.seconds[0], "holdout": result.seconds[1]},
        "versions": versions(),
        "rounds": [_round(number, each) for number, each in enumerate(result.rounds, 1)],
    }


def _recordings(files: list[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"source": source, "sha256": sha256} for source, sha256 in files]


def _discovered(each: Discovered) -> dict[str, Any]:
    parameters: dict[str, Any] = {one.key: _figures(one, *_FITTED) for one in each.estimates}
    if len(each.at):
        parameters["table"] = _table(each)
    return {
        "name": each.name,
        "equation": each.place,
        "of": f"{each.of} x {each.times}" if each.times else each.of,
        "form": each.form,
        "text": each.text,
        "parameters": parameters,
        "evidence": _figures(each, "gain", "z", "share"),
        "gap": _gap(*each.gap),
        **_figures(each, "could_also_be", "in_model", "suspected_leak", "experiment"),
    }


def _table(each: Discovered) -> dict[str, Any]:
    return _figures(each, "at", "values", "errors", "unit", "of_unit")


def _correction(each: Discovered | None) -> dict[str, Any] | None:
    """Return the curve that corrects an effect's formula, JSON-able; None if there is none."""
    if each is None:
        return None
    found = {"equation": each.place, "of": each.of, "form": each.form, **_table(each)}
    if not len(each.at):
        found["parameters"] = {e.key: _figures(e, *_FITTED, "before") for e in each.estimates}
    return found


def _effect(effect: NamedEffect) -> dict[str, Any]:
    """Return a named effect with parameters, evidence and rivals, JSON-able."""
    return {
        **_figures(effect, "name", "equation", "where"),
        "parameters": {e.key: _figures(e, *_FITTED, "before") for e in effect.parameters},
        "evidence": _figures(effect, "gain", "bar", "z", "held_out_z"),
        "indistinguishable_from": [rival.effect for rival in effect.indistinguishable],
        "form": effect.form,
        "correction": _correction(effect.correction),
        "rivals": [
            {"name": each.effect, "possible": possible}
            | _figures(each, "share", "z", "cosine", "why")
            for possible, rivals in ((True, effect.indistinguishable), (False, effect.excluded))
            for each in rivals
        ],
        "unseen": effect.unseen,
    }


def _where(curve: Curve) -> dict[str, Any]:
    """Return how a disturbance of one equation would explain the gap, JSON-able.

    It has the share of the gap that is explained, and the disturbance's largest value with the
    place in the region where it occurs.
    """
    index = int(np.argmax(np.abs(curve.values)))
    return {
        **_figures(curve, "equation", "region", "share"),
        "largest": _plain(curve.values[index]),
        "error": _plain(curve.errors[index]),
        "unit": curve.unit,
        "at": _plain(curve.at[index]),
        "region_unit": curve.region_unit,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    return {"curve": _figures(curve, "at", "values", "errors"), "gain": _plain(curve.gain)}


def _experiment(experiment: Separation) -> dict[str, Any]:
    """Return an experiment that would distinguish effects, with its campaign, JSON-able."""
    return {
        **_figures(experiment, "effects", "motion"),
        "campaign": experiment.campaign,
        "cosine": _plain(experiment.cosine),
        "predicted_z": _plain(experiment.z),
    }


def _round(number: int, settled: Round) -> dict[str, Any]:
    """Return one round of closing a gap on a rig, JSON-able; `number` counts from 1."""
    check = settled.check
    return {
        "round": number,
        **_figures(settled, "why", "motions", "recordings", "verdict"),
        "effects": [_some(_effect(each), _IN_SHORT) for each in settled.effects],
        "discovered": [_discovered(each) for each in settled.discovered],
        "check": None
        if check is None
        else _figures(check, "verdict", "effects", "discovered")
        | {"gap": _gap(check.gap_before, check.gap_after)},
    }


def _free_run(run: FreeRun) -> dict[str, Any]:
    """Return a free simulation, JSON-able, without its samples.

    It has recording, channel and time, and the RMS errors with the model as given (`rms_before`)
    and as written (`rms_after`).
    """
    return {
        **_figures(run, "source", "channel"),
        "from_s": _plain(run.time_s[0]),
        "to_s": _plain(run.time_s[-1]),
        "rms_before": _plain(np.sqrt(np.nanmean(np.square(run.before - run.measured)))),
        "rms_after": _plain(np.sqrt(np.nanmean(np.square(run.after - run.measured)))),
        "unit": run.unit,
    }


def _gap(before: float, after: float) -> dict[str, Any]:
    return {"before": _plain(before), "after": _plain(after)}


def _some(figures: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    return {key: figures[key] for key in keys}


def _figures(source: object, *names: str) -> dict[str, Any]:
    """Return some attributes of an object by their names, as `_plain` values."""
    return {name: _plain(value) for name, value in named(source, *names).items()}


def _plain(value: Any) -> Any:
    """Return a number, text, or sequence of them as JSON has it.

    A number is rounded to nine significant digits; NaN and infinity, which JSON lacks, become None.
    """
    if isinstance(value, str | bool):
        return value
    if isinstance(value, Sequence | np.ndarray):
        return [_plain(item) for item in value]
    return float(f"{float(value):.{_DIGITS}g}") if isfinite(value) else None
