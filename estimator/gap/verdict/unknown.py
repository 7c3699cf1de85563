"""This module describes an effect that the catalogue lacks, by a few terms in symbols with units.

The terms are chosen one after the other from a dictionary (`plant.terms`), and fitted together with
the variables of the model on the linearised course.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant, Region, Term, dictionary
from estimator.gap.prediction import Curve
from estimator.gap.search import CHANCE, MATERIAL, TIME, Attribution, Place, places_of

MOST_TERMS: Final = 3
"""Greatest number of terms of a disturbance."""
EARNS: Final = 0.05
"""Part of what all terms explain together that each term must add."""
_CERTAIN: Final = 4.0
"""Least size of a coefficient in standard errors, by the scatter of the blocks' scores."""
_FINER: Final = 9
"""Number of periods that are tried about the period of a wave."""
_PLACES: Final = 3
"""Number of places for which terms are chosen."""
_NEARLY: Final = 0.7
"""An equation is preferred to a reading if its terms gain more than this part of what the best
place's terms gain."""
_DEPENDENT: Final = 1e-4
"""A column depends on others if they leave less than this part of it."""


@dataclass(frozen=True)
class Unknown:
    """A disturbance in symbols.

    Attributes:
        place: equation or reading that the disturbance enters.
        terms: terms of the dictionary.
        coefficients: float64 (columns of all terms,), SI.
        errors: float64 (columns of all terms,), standard errors of the coefficients.
        gain: by how much the disturbance lowers the cost of the model without it.
        share: part of the cost above the floor that the disturbance takes away; 0 if no cost is
            above the floor.
    """

    place: Place
    terms: tuple[Term, ...]
    coefficients: Array
    errors: Array
    gain: float
    share: float

    def text(self, plant: Plant) -> str:
        """Return the terms with their coefficients and units: "+ 180 N sin(2 pi x / 42 mm)"."""
        return " ".join(self.terms_text(plant))

    def terms_text(self, plant: Plant) -> list[str]:
        """Return each term as text, with its coefficients and units."""
        regions = {**plant.regions, TIME.name: TIME}
        parts, first = [], 0
        for term in self.terms:
            own = self.coefficients[first : first + term.columns]
            parts.append(term.text([float(c) for c in own], self.place.unit, regions))
            first += term.columns
        return parts


def _shapes(terms: Sequence[Term], along: Mapping[str, Array]) -> Array:
    return np.concatenate([term.values(along) for term in terms], axis=1)


class _Forward:
    """Chooses columns one after the other, by what each gains in addition to those chosen before.

    Args:
        changes: float64 (blocks, readings, columns), changes of the innovations, those of the
            variables first.
        innovations: float64 (blocks, readings).
        known: number of columns of the variables, which are chosen at the beginning.

    Attributes:
        certain: length of the steps along the columns that the last call of `choose` added, in
            standard errors by the scatter of the blocks' scores.
    """

    def __init__(self, changes: Array, innovations: Array, known: int) -> None:
        self._changes, self._blocks = changes, len(changes)
        self._flat = changes.reshape(-1, changes.shape[2])
        self._rest = innovations.ravel()
        self._basis = np.zeros((self._rest.size, 0))
        self._scale = np.maximum(np.linalg.norm(self._flat, axis=0), 1e-300)
        self.certain = 0.0
        for column in range(known):
            self.choose([column])

    def choose(self, columns: Sequence[int]) -> float:
        """Add columns to the chosen ones; return by how much they lower the sum of squares.

        The sum is that of what the chosen columns leave of the innovations. A column that depends
        on the chosen ones is left out. `certain` becomes how many standard errors the steps along
        the added columns are long: 0 if none is added, or if one block shows no scatter.
        """
        before, known = float(self._rest @ self._rest), self._basis.shape[1]
        steps = []
        for column in columns:
            new = self._flat[:, column] / self._scale[column]
            for _ in range(2):
                new = new - self._basis @ (self._basis.T @ new)
            size = float(np.linalg.norm(new))
            if size > _DEPENDENT:
                self._basis = np.column_stack([self._basis, new / size])
                steps.append(float(self._basis[:, -1] @ self._rest))
                self._rest = self._rest - self._basis[:, -1] * steps[-1]
        if not steps or self._blocks < 2:
            self.certain = 0.0
            return before - float(self._rest @ self._rest)
        scores = (self._basis[:, known:] * self._rest[:, None]).reshape(
            self._blocks, -1, len(steps)
        )
        errors = np.sqrt(np.square(scores.sum(1)).sum(0) * self._blocks / (self._blocks - 1))
        self.certain = float(np.linalg.norm(np.array(steps) / np.maximum(errors, 1e-300)))
        return before - float(self._rest @ self._rest)

    def gains(self, groups: Sequence[Sequence[int]]) -> Array:
        """Return what `choose` would return for each group of one or two columns, (groups,)."""
        shared = (self._basis.T @ self._flat) / self._scale
        slopes = (self._rest @ self._flat) / self._scale
        found = np.empty(len(groups))
        for index, group in enumerate(groups):
            inner = shared[:, group]
            own = np.eye(len(group))
            if len(group) > 1:
                columns = self._flat[:, group] / self._scale[group]
                own = columns.T @ columns
            matrix = own - inner.T @ inner
            eigenvalues, vectors = np.linalg.eigh(matrix)
            along = vectors.T @ slopes[group]
            good = eigenvalues > _DEPENDENT**2
            found[index] = np.sum(along[good] ** 2 / eigenvalues[good])
        return found


def in_symbols(attribution: Attribution, place: Place, floor: float) -> Unknown | None:
    """Return the few terms that explain most of what a disturbance of a place could explain.

    The best terms are chosen one after the other, at most three. A term earns its place if its
    coefficients are four standard errors long, and if it lowers the cost by `CHANCE`, by `MATERIAL`
    for each reading, and by the part `EARNS` of what all chosen terms do together.

    Args:
        attribution: attribution about the fitted model.
        place: equation or reading that the disturbance enters.
        floor: cost per reading of a rig that is exactly the model.

    Returns:
        The disturbance, with its terms fitted together; None if no term earns its place.
    """
    plant = attribution.plant
    names = [*place.of, TIME.name]
    quantities = {name: attribution.along(name) for name in names}
    together = {name: np.concatenate(parts) for name, parts in quantities.items()}
    regions: dict[str, Region] = {**plant.regions, TIME.name: TIME}
    known = len(attribution.base)

    def laid_out(terms: Sequence[Term]) -> list[Array]:
        return [
            _shapes(terms, {name: parts[k] for name, parts in quantities.items()})
            for k in range(len(attribution.courses))
        ]

    terms = dictionary(together, regions)
    groups = _groups(terms, known)
    changes, innovations, readings = attribution.stacked(place, laid_out(terms))
    forward = _Forward(changes, innovations, known)
    chosen: list[Term] = []
    total = 0.0
    while len(chosen) < MOST_TERMS:
        best = int(np.argmax(forward.gains(groups)))
        gained = forward.choose(groups[best])
        total += gained
        bar = max(CHANCE, MATERIAL * readings, EARNS * total)
        if gained < bar or forward.certain < _CERTAIN:
            break
        chosen.append(_finer(attribution, place, terms[best], laid_out))
    if not chosen:
        return None
    linear = attribution.linear(place, laid_out(chosen))
    steps, errors, gain, cost = attribution.solved(linear)
    excess = cost - floor * linear.samples
    return Unknown(
        place, tuple(chosen), steps, errors, gain, gain / excess if excess > 0.0 else 0.0
    )


def find_unknown(attribution: Attribution, curves: Sequence[Curve], floor: float) -> Unknown | None:
    """Return the disturbance in symbols that gains most, or None if no term earns its place.

    Terms are chosen for the three places whose curves explain most; `curves` come best first. One
    place is not enough, because a wave along the stroke is too fine for a curve. An equation is
    preferred to a reading that explains hardly more, because a model can represent the equation's
    terms. `floor` is the cost per reading of a rig that is exactly the model.
    """
    places = {place.name: place for place in places_of(attribution.plant)}
    names = list(dict.fromkeys(curve.equation for curve in curves if curve.equation in places))
    found = [in_symbols(attribution, places[name], floor) for name in names[:_PLACES]]
    known = [unknown for unknown in found if unknown is not None]
    if not known:
        return None
    best = max(known, key=lambda unknown: unknown.gain)
    near = [u for u in known if u.place.equation and u.gain > _NEARLY * best.gain]
    return max(near, key=lambda unknown: unknown.gain, default=best)


def _groups(terms: Sequence[Term], known: int) -> list[list[int]]:
    """Return the column indices of each term; the columns of the variables come before them."""
    ends = known + np.cumsum([0, *(term.columns for term in terms)])
    return [list(range(a, b)) for a, b in pairwise(ends)]


def _finer(
    attribution: Attribution, place: Place, term: Term,
    laid_out: Callable[[Sequence[Term]], list[Array]],
) -> Term:  # fmt: skip
    """Return a wave with the best of some periods about its own, and any other term as it is."""
    if term.form != "wave":
        return term
    span = float(np.ptp(np.concatenate(attribution.along(term.region))))
    inverses = 1.0 / term.at[0] + np.linspace(-1.0, 1.0, _FINER) / span
    tried = [
        Term(term.region, "wave", term.times, (float(1.0 / inverse),))
        for inverse in inverses
        if inverse > 0.0
    ]
    known = len(attribution.base)
    changes, innovations, _ = attribution.stacked(place, laid_out(tried))
    forward = _Forward(changes, innovations, known)
    return tried[int(np.argmax(forward.gains(_groups(tried, known))))]
