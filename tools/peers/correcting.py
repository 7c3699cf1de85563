"""Corrects a model by what a peer learns of its errors, and judges it on recordings held out."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from estimator.gap.plant import Array, Plant, Record
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.search.refits import Refits
from tools.peers.course import Course, Values, squared_errors
from tools.peers.discrepancy import (
    FACTORS,
    Learner,
    Part,
    Samples,
    Target,
    kicks_of,
    learned,
    samples_of,
    strongest,
    targets_of,
    trusting_less,
)


@dataclass(frozen=True)
class Correction:
    """What a peer learned in one equation.

    Attributes:
        equation: name of the equation.
        of: quantities on which it depends.
        size: root mean square along the recordings fitted to, in standard deviations of the error
            that the plant's model admits to in that equation.
        text: the correction in words.
    """

    equation: str
    of: tuple[str, ...]
    size: float
    text: str


@dataclass(frozen=True, eq=False)
class Corrected:
    """A model as a peer corrected it.

    Attributes:
        start: the model that was corrected, "as given" or "refitted".
        after: float64 (outputs,), mean squared errors 20 ms ahead held out, in noise variances.
        corrections: what was learned, the largest first; empty if nothing was better on recordings
            that it was not learned from.
    """

    start: str
    after: Array
    corrections: tuple[Correction, ...]


@dataclass(frozen=True, eq=False)
class _Start:
    name: str
    values: Values
    courses: list[Course]
    targets: list[Target]
    samples: list[list[Samples]]

    def parts(self, learner: Learner, records: Sequence[int], last: bool = False) -> list[Part]:
        """Return what a learner finds in some of the records, by their indices."""
        found = [
            learned(learner, target, [of_target[k] for k in records], last)
            for target, of_target in zip(self.targets, self.samples, strict=True)
        ]
        return [part for part in found if part is not None]

    def left_out(self, learner: Learner | None) -> float:
        """Return the squared error 20 ms ahead of each record, learned from the others.

        It is the mean over channels and records; without a learner nothing is corrected.
        """
        plant, everything = self.courses[0].plant, range(len(self.courses))
        found, weights = 0.0, 0
        for left in everything:
            kicks = None
            if learner is not None:
                parts = self.parts(learner, [k for k in everything if k != left])
                kicks = kicks_of(parts, plant, self.values) if parts else None
            length = len(self.courses[left].record)
            found += length * float(squared_errors([self.courses[left]], kicks).mean())
            weights += length
        return found / weights


def refitted(plant: Plant, records: Sequence[Record]) -> dict[str, float]:
    """Return the values of a plant with its nuisances refitted within their tolerances."""
    if not plant.nuisances:
        return dict(plant.nominal)
    with ThreadPoolExecutor(1) as pool:
        refits = Refits(Fitter(Predictor(plant), list(records), pool))
        return dict(refits.settled(plant.nominal, refits.nuisances)[0].values)


def corrected(
    plant: Plant, records: Sequence[Record], judged: Sequence[Record], learner: Learner
) -> Corrected:
    """Return a plant's model as a peer corrects it.

    The model given is corrected, and one with refitted nuisances, each with what the peer learns of
    disturbances by each of `FACTORS`, and with nothing. That which predicts records best that it
    was not learned from is taken, learned from all records, and judged on others.

    Args:
        plant: the plant, with the model given.
        records: records to learn from; a single one is divided in two.
        judged: records held out; nothing is chosen by these.
        learner: the peer.
    """
    if len(records) == 1:
        records = halves(records[0])
    starts = _starts("as given", plant, records, plant.nominal)
    again = refitted(plant, records)
    if again != plant.nominal:
        starts += _starts("refitted", plant, records, again)
    tried = [(start.left_out(learner), start, True) for start in starts]
    tried += [(start.left_out(None), start, False) for start in starts[:: len(FACTORS)]]
    _, start, better = min(tried, key=lambda each: each[0])
    parts = start.parts(learner, range(len(records)), last=True) if better else []
    held_out = [Course(plant, record, start.values) for record in judged]
    after = squared_errors(held_out, kicks_of(parts, plant, start.values) if parts else None)
    corrections = tuple(
        Correction(part.target.equation.name, part.depends_on(quantities), size, part.text)
        for part, size, quantities in strongest(parts, start.courses)
    )
    return Corrected(start.name, after, corrections)


def _starts(name: str, plant: Plant, records: Sequence[Record], values: Values) -> list[_Start]:
    """Return the starts with these values, one for each of `FACTORS`."""
    targets = targets_of(plant)
    courses = [Course(plant, record, values) for record in records]
    found = []
    for factor in FACTORS:
        seen = [Course(trusting_less(plant, factor), record, values) for record in records]
        samples = [[samples_of(target, course) for course in seen] for target in targets]
        found.append(_Start(name, values, courses, targets, samples))
    return found


def halves(record: Record) -> list[Record]:
    """Return the two halves of a record."""
    middle = len(record) // 2
    return [
        replace(
            record, inputs=np.ascontiguousarray(record.inputs[rows]),
            readings=np.ascontiguousarray(record.readings[rows]),
            variances=np.ascontiguousarray(record.variances[rows]), first=record.first + first,
        )
        for rows, first in ((slice(0, middle), 0), (slice(middle, None), middle))
    ]  # fmt: skip
