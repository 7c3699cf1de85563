"""Runs all methods on a case, and measures each by the gap that it leaves above the same floor."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from time import monotonic
from typing import Any, Final

import numpy as np

from estimator.gap.plant import Array, Plant, Record, record_of
from estimator.gap.prediction.held_out import channel_gaps
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.suitability import usable
from rig.configuration import load_model
from rig.configuration.models.plant_loading import load_plant
from rig.recording import read_recording
from rig.runner.experiments.gap_results import rig_plant
from rig.runner.outcomes import sensors_of
from tools.peers.cases import Case, Plan, case_of
from tools.peers.correcting import Corrected, corrected
from tools.peers.gaussian import gaussian
from tools.peers.sparse import sparse
from tools.peers.workflow import Answered, rig_gap

CATALOGUE: Final = "catalogue alone"
WHOLE: Final = "rig gap"
SPARSE: Final = "sparse regression"
PROCESS: Final = "Gaussian process"
METHODS: Final = (CATALOGUE, WHOLE, SPARSE, PROCESS)
_PEERS: Final = {SPARSE: sparse, PROCESS: gaussian}


@dataclass(frozen=True)
class Outcome:
    """What one method made of a case.

    Attributes:
        gap: excess over the common floor held out, in noise variances; None if there is none.
        seconds: by the wall clock, from reading the recordings to the answer.
        right: whether the hidden effect is named, or placed, or its quantities are right; None
            where this cannot be said.
        said: what was found, in words.
    """

    gap: float | None
    seconds: float
    right: bool | None
    said: str


@dataclass(frozen=True)
class Compared:
    """A case with the outcomes of all methods.

    Attributes:
        plan: of the case.
        hidden: what was hidden, in words.
        before: excess of the model given over the common floor; None if it is not finite.
        outcomes: by the names of `METHODS`; a method that was not asked for is left out.
    """

    plan: Plan
    hidden: str
    before: float | None
    outcomes: Mapping[str, Outcome]


def compared(plan: Plan, folder: Path, methods: Sequence[str] = METHODS) -> Compared:
    """Make a case, run the methods on it, and return their outcomes.

    The floor is that of `rig gap`, for a rig that is exactly the model that it wrote; where it gave
    none, of a rig that is exactly the model given.

    Args:
        plan: of the case.
        folder: for its files; deleted before and after.
        methods: which of `METHODS` are run.
    """
    rmtree(folder, ignore_errors=True)
    case = case_of(plan, folder)
    plant, records, judged = _loaded(case)
    answered = {}
    if WHOLE in methods:
        answered[WHOLE] = rig_gap(case, folder / "whole", True)
    if CATALOGUE in methods:
        answered[CATALOGUE] = rig_gap(case, folder / "catalogue", False)
    shown = next((a.channels for a in answered.values() if a.channels), ())
    before, floor = _given(shown, plant, judged)
    outcomes = {}
    for name, each in answered.items():
        after = errors(each.channels, "after") if each.channels else before
        gap = None if each.why else excess(after, floor)
        outcomes[name] = Outcome(gap, each.seconds, right(case, each.answer), _told(each))
    for name in methods:
        if name in _PEERS:
            begun = monotonic()
            found = corrected(plant, records, judged, _PEERS[name]())
            took = monotonic() - begun
            said = "; ".join(
                f"{c.equation} of {', '.join(c.of) or 'nothing'} ({c.size:.2g}): {c.text}"
                for c in found.corrections
            )
            outcomes[name] = Outcome(
                excess(found.after, floor), took, placed(case, found), f"{found.start}; {said}"
            )
    rmtree(folder, ignore_errors=True)
    return Compared(plan, case.hidden, excess(before, floor), outcomes)


def excess(after: Array, floor: Array) -> float | None:
    """Return the mean over channels of `after` above `floor`, (outputs,) each; None if not finite.

    A channel below the floor counts as 0, as in the product's gap.
    """
    found = float(np.mean(np.maximum(after - floor, 0.0)))
    return found if np.isfinite(found) else None


def _loaded(case: Case) -> tuple[Plant, list[Record], list[Record]]:
    """Return the plant with the model given, its records to fit to and those held out."""
    if case.plant:
        own = load_plant(case.plant, case.model)
        plant, read = own.plant, own.read
    else:
        read = read_recording
        plant = rig_plant(load_model(case.model), sensors_of(read_recording(case.fit[0])))
    fitted, held = (
        usable([record_of(read(path), plant) for path in files], plant)
        for files in (case.fit, case.holdout)
    )
    return plant, fitted, held


def _given(
    channels: Sequence[Mapping[str, Any]], plant: Plant, judged: Sequence[Record]
) -> tuple[Array, Array]:
    """Return the errors of the model given and the common floor, (outputs,), in noise variances."""
    if channels:
        return errors(channels, "before"), _figures(channels, "floor")
    with ThreadPoolExecutor(1) as pool:
        gaps = channel_gaps(Predictor(plant), judged, plant.nominal, plant.nominal, pool)
    return np.array([gap.before for gap in gaps]), np.array([gap.floor for gap in gaps])


def errors(channels: Sequence[Mapping[str, Any]], key: str) -> Array:
    """Return the mean squared errors "before" or "after", (outputs,), in noise variances.

    In gap.json they are told above the floor of that answer, which is added again here.
    """
    return _figures(channels, key) + _figures(channels, "floor")


def _figures(channels: Sequence[Mapping[str, Any]], key: str) -> Array:
    """Return a figure of each channel in gap.json, (outputs,); NaN where it has none."""
    return np.array([channel[key] for channel in channels], dtype=float)


def right(case: Case, answer: Mapping[str, Any]) -> bool | None:
    """Return whether `rig gap` names what is hidden, and nothing beside it; None if unknown.

    An effect that the answer cannot tell from the one it names counts as named. Where quantities
    are known, those of what was discovered must be these; else, where nothing of the catalogue is
    hidden, the verdict must be the right one.
    """
    if not answer:
        return False
    if case.of:
        return quantities(answer) == set(case.of)
    sets = [
        {effect["name"], *effect.get("indistinguishable_from", ())} for effect in answer["effects"]
    ]
    if case.names:
        all_named = all(any(name in each for each in sets) for name in case.names)
        return all_named and all(each & set(case.names) for each in sets)
    return answer["verdict"] == case.verdict if case.verdict else None


def quantities(answer: Mapping[str, Any]) -> set[str]:
    """Return the quantities on which depends what `rig gap` discovered, or put in symbols.

    The direction of motion counts as the velocity.
    """
    said = [each["of"] for each in answer.get("discovered") or ()]
    said += [effect["correction"]["of"] for effect in answer["effects"] if effect.get("correction")]
    if not said and answer.get("term"):
        said = [answer["term"]["text"]]
    words = " ".join(said).replace("direction", "velocity")
    return {name for name in ("position", "velocity") if name in words}


def placed(case: Case, found: Corrected) -> bool | None:
    """Return whether a peer's largest correction is where the hidden effect is; None if unknown.

    It must be in one of the case's equations and, where they are known, depend on its quantities
    and no others. Where nothing is hidden nothing must be corrected.
    """
    if case.verdict == "adequate":
        return not found.corrections
    if not case.equations:
        return None
    if not found.corrections:
        return False
    first = found.corrections[0]
    if case.of:
        return set(first.of) == set(case.of)
    return first.equation in case.equations


def _told(each: Answered) -> str:
    if each.why:
        return each.why
    names = [effect["name"] for effect in each.answer["effects"]]
    more = [
        f"{d['name']} in {d['equation']} of {d['of']}" for d in each.answer.get("discovered") or ()
    ]
    term = each.answer.get("term")
    more += [term["text"]] if term and not more else []
    return f"{each.answer['verdict']}: {', '.join([*names, *more]) or 'nothing'}"


def compared_of(fields: Mapping[str, Any]) -> Compared:
    """Return a comparison from the fields that were kept of it as JSON."""
    outcomes = {name: Outcome(**each) for name, each in fields["outcomes"].items()}
    return Compared(Plan(**fields["plan"]), fields["hidden"], fields["before"], outcomes)
