"""This module selects lags, resonances and plays of a quantity that are worth an exact look.

Something on a path may remember: a filter before the valve, a pilot stage, a mass on a spring, oil
in a dead end, a contact that gives way before it slides. What it does to an equation then depends
on the course of a quantity (`estimator.gap.plant.memories`). By how much each of some time
constants, frequencies, dampings and widths would lower the cost follows from two figures, to second
order: the slope of the cost by the disturbance (`Attribution.pull`), and the curvature, which is
that by white noise weighted with the disturbance's spectrum.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import TIME_NAME, Array

from .disturbances import Attribution, Place
from .findings import CHANCE
from .shapes import STARTS, Shape
from .spectra import curvature_of

_LAGS: Final = (2.0, 0.5)
"""Least time constant in sampling periods, and greatest in s: a longer one than a block of half a
second has no end within it."""
_STEP: Final = 2.0
"""Ratio of one time constant, or width, to the next one that is tried."""
_FREQUENCIES: Final = (2.0, 8.0)
"""Least frequency of a resonance, Hz, and least number of samples in its period: the swing must be
over, or go round, in a block of half a second."""
_CLOSE: Final = 1.25
"""Ratio of one frequency to the next one: the best is at most an eighth away, and is refined."""
_DAMPINGS: Final = (0.08, 0.35)
_PLAYS: Final = (1.0 / 256.0, 0.5)
"""Least and greatest half width of a play, as parts of the range of its quantity: a wider one would
never be crossed."""
_BEST: Final = {"lag": 2, "resonance": 6, "play": 2}
"""Number of lags, resonances and plays that are selected."""
_LEAST: Final = 0.03
"""Least part of a disturbance's square that counts as more than what the variables could do."""
_PIECE: Final = 512
"""Number of samples in the pieces of a spectrum."""


def memories(
    attribution: Attribution, place: Place, of: str, along: Sequence[Mapping[str, Array]],
    least: float = CHANCE, kept: dict[Shape, Array] | None = None,
) -> list[Shape]:  # fmt: skip
    """Return what remembers a quantity and promises the most, as many of a form as `_BEST` says.

    In a reading these are plays alone: of a lag there the curve against the rate tells. Each
    must promise to lower the cost by `least`.

    Args:
        attribution: linearised courses, with what is to be explained.
        place: equation or reading that the disturbance enters.
        of: name of the quantity that it follows.
        along: quantities by name at each sample of each course, (m,) each, as `Shape.columns` takes
            them.
        least: least promise that is worth a look.
        kept: spectra of shapes along these courses, which do not depend on the place; those that
            are computed are added. None if they are not kept.
    """
    period = float(along[0][TIME_NAME][1] - along[0][TIME_NAME][0])
    pulls = attribution.pull(place)
    frequencies, curvature = curvature_of(attribution, place)
    at = np.fft.rfftfreq(_PIECE, period)
    # White noise has twice the mean square of a tone.
    weights = 2.0 * np.interp(at, frequencies, curvature)
    spectra: dict[Shape, Array] = {} if kept is None else kept
    promising = _Promising(along, pulls, attribution.base_pulls(place), weights, spectra)
    low, high = np.quantile(np.concatenate([each[of] for each in along]), (0.01, 0.99))
    held = attribution.is_held(of)
    tried = _plays(of, float(high - low), held)
    if place.equation is not None:
        tried += _tried(of, period, held)
    ranked = sorted(((promising.gain(shape), shape) for shape in tried), key=lambda e: -e[0])
    return [
        shape
        for form, most in _BEST.items()
        for gain, shape in [each for each in ranked if each[1].form == form][:most]
        if gain >= least
    ]


def _tried(of: str, period: float, held: bool) -> list[Shape]:
    """Return all lags and resonances of a quantity that are tried at a sampling period, s.

    `held` says whether the quantity stays as it is from sample to sample.
    """
    found, constant = [], _LAGS[0] * period
    while constant <= _LAGS[1]:
        found.append(Shape(of, "", "lag", (constant,), (), held))
        constant *= _STEP
    frequency = _FREQUENCIES[0]
    while frequency <= 1.0 / (_FREQUENCIES[1] * period):
        found += [
            Shape(of, "", "resonance", (frequency, damping), (), held) for damping in _DAMPINGS
        ]
        frequency *= _CLOSE
    return found


def _plays(of: str, span: float, held: bool) -> list[Shape]:
    """Return all plays of a quantity with this range that are tried; none if it does not change."""
    found, half = [], _PLAYS[0] * span
    while 0.0 < half <= _PLAYS[1] * span:
        found.append(Shape(of, "", "play", (half,), (), held))
        half *= _STEP
    return found


@dataclass(frozen=True)
class _Promising:
    """Tells by how much shapes of one quantity at one place would lower the cost, to second order.

    Attributes:
        along: quantities by name at each sample of each course, (m,) each.
        pulls: slope of half the cost by the disturbance at each sample, (m,) for each course.
        with_base: products of the disturbance with the fit's variables, (m, variables) for each
            course; and those of the variables with each other (`Attribution.base_pulls`).
        weights: what white noise of each frequency changes, per sample (`_PIECE` // 2 + 1,).
        spectra: spectra of shapes that are known (`_spectrum`); those that are computed are added.
    """

    along: Sequence[Mapping[str, Array]]
    pulls: Sequence[Array]
    with_base: tuple[list[Array], Array]
    weights: Array
    spectra: dict[Shape, Array]

    def gain(self, shape: Shape) -> float:
        """Return by how much a shape would lower the cost beyond what the variables could."""
        base, gram = self.with_base
        slopes, crossed = np.zeros(shape.count), np.zeros((len(gram), shape.count))
        is_known = shape in self.spectra
        spectrum = np.zeros((len(self.weights), shape.count, shape.count))
        for k, quantities in enumerate(self.along):
            columns = shape.columns(quantities)
            slopes += columns.T @ self.pulls[k]
            if len(gram):
                crossed += base[k].T @ columns
            if not is_known:
                starts = np.flatnonzero(quantities[STARTS] > 0.0)
                for begin, end in zip(starts, [*starts[1:], len(columns)], strict=True):
                    spectrum += _spectrum(columns[begin:end])
        spectrum = self.spectra.setdefault(shape, spectrum)
        matrix = np.einsum("fij,f->ij", spectrum, self.weights)
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix / np.outer(scale, scale)
        if len(gram):
            stood_in = crossed.T @ np.linalg.lstsq(gram, crossed, rcond=1e-12)[0]
            scaled -= stood_in / np.outer(scale, scale)
        if not np.isfinite(scaled).all():
            return 0.0
        # The squares are known to some parts in a hundred, so that less of them is not believed.
        values, vectors = np.linalg.eigh(scaled)
        along_them = vectors.T @ (slopes / scale)
        return float((along_them**2 / np.maximum(values, _LEAST)).sum())


def _spectrum(columns: Array) -> Array:
    """Return powers and cross powers of columns (m, count), (`_PIECE` // 2 + 1, count, count).

    Times what white noise of each frequency changes, they sum to the squares and products of what
    the columns change.
    """
    pieces = max(len(columns) // _PIECE, 1)
    cut = columns[: pieces * _PIECE]
    if len(cut) < _PIECE:
        cut = np.pad(cut, ((0, _PIECE - len(cut)), (0, 0)))
    window = np.hanning(_PIECE)[:, None]
    spectra = np.fft.rfft(cut.reshape(pieces, _PIECE, -1) * window, axis=1)
    power = np.einsum("pfi,pfj->fij", spectra.conj(), spectra).real
    # A spectrum's two halves are alike, and the window lets a part of the power through.
    return np.asarray(2.0 * power * len(columns) / (pieces * _PIECE * (window**2).sum()))
