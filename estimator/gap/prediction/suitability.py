"""This module decides whether recordings can support a verdict; docs/gap.md derives the limits.

Before anything is fitted, there must be enough recordings, every channel must move, the sensors
must be within their ranges and no noisier than stated, and the readings must have something to do
with the model. After the search, what was found must predict better than the assumption that
nothing changes. Before that, a plant from outside must have finite states along a recording.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np

from estimator.gap.plant import (
    Array,
    BoolArray,
    Gains,
    Output,
    Plant,
    PlantError,
    Record,
    record_of,
    seen_parts,
)
from rig.recording import Recording

from .fit import Fitter
from .linear import BLOCK_S, LEAST_SAMPLES, mean_squares, settling, slices_of
from .predictor import Predictor
from .variables import Values

FITTED_BLOCKS: Final = 8
"""Least number of half-second blocks to fit to; the scatter of fewer gives no standard error."""
JUDGED_BLOCKS: Final = 4
"""Least number of half-second blocks in the held-out recordings."""
MOVES: Final = 10.0
"""Least distance that a channel must move, in multiples of its noise, between readings averaged
over 50 ms. An effect of a tenth of that is then as large as the noise of one reading."""
SATURATED: Final = 0.5
"""Greatest share of a channel's readings that may be missing or at an end of its range, among the
samples of which the recording has any reading."""
NOISIER: Final = 10.0
"""Greatest noise that readings may have, in multiples of the stated noise. The oscillation of the
oil, curved over 3 samples, looks like 4 at most."""
LOST: Final = 100.0
"""Standard deviations. If the median miss of one-step predictions is larger, the channel has
nothing to do with the model: no effect does this, but a channel in other units does."""
WORSE: Final = 4.0
"""A prediction says nothing of the rig if its squared error is more than this many times that of
"nothing changes", plus the noise variance. In a slow motion a missing effect may well cost more
than predicting that nothing changes; another rig costs far more."""
MIXED_UP: Final = 4.0
"""Least number of times by which the cost of all predictions must fall when two channels are
exchanged: a model that is wrong by an effect costs more with right channels than with wrong ones by
no such factor, as half of all that it predicts is then wrong."""
_BEGINNING_S: Final = 3.0
"""s. Length of each record's beginning that tells of most exchanged channels that they are not
mixed up: five blocks after the filter has settled."""
_RESOLVED_S: Final = 1.01e-3
"""s. With this period or a shorter one, the motion of a rig is far smoother than its noise."""
_BEFORE: Final = 12
"""Number of readings before one that foretell it: enough for the oil of both chambers, the valve
and a load that swings, with two for each and some for the course of the motion."""
_NORMAL: Final = 0.6745
"""Median magnitude of a normal deviate."""
_AVERAGED_S: Final = 0.05
"""s. Readings are averaged over this time to measure how far a channel moves."""


def usable(records: Sequence[Record], plant: Plant) -> list[Record]:
    """Return those parts of the records that the filter can follow and that are long enough.

    A part must be as long as the filter's settling and one block, or longer. If there is no such
    part, the records that are long enough are returned whole, so that the report can say what is
    wrong with their readings; the list may be empty.
    """
    long = [record for record in records if slices_of(record, plant.period)]
    parts = [part for record in long for part in seen_parts(record, plant.period)]
    return [part for part in parts if slices_of(part, plant.period)] or long


def unsuitable(fitter: Fitter, judged: Fitter) -> list[str]:
    """Return the reasons, in words, why recordings cannot support a verdict; empty if they can.

    Lengths are checked first, then the commands and readings to fit to, then whether every channel
    has anything to do with the model as given (`LOST`) and is not mixed up with another. The first
    of these checks that fails gives its reasons, and the later ones are not made.

    Args:
        fitter: fitter of the records to fit to.
        judged: fitter of the held-out records.
    """
    plant = fitter.predictor.plant
    reasons = [
        *_too_short(fitter.records, plant, FITTED_BLOCKS, "to fit to"),
        *_too_short(judged.records, plant, JUDGED_BLOCKS, "held out"),
    ]
    if reasons:
        return reasons
    reasons += _commands(fitter.records, plant)
    for index, output in enumerate(plant.outputs):
        reasons += _readings(fitter.records, index, output, plant.period)
    if reasons:
        return reasons
    return [*_mixed_up(fitter), *_lost(fitter), *_lost(judged)]


def _too_short(records: Sequence[Record], plant: Plant, least: int, which: str) -> list[str]:
    blocks = sum(len(slices_of(record, plant.period)) for record in records)
    if blocks >= least:
        return []
    seconds = sum(len(record) for record in records) * plant.period
    block = max(BLOCK_S, LEAST_SAMPLES * plant.period)
    settled = settling(plant.period) * plant.period
    return [
        f"the recordings {which} are too short: {seconds:.1f} s make {blocks} blocks of "
        f"{block:g} s once the filter has settled ({settled:g} s each), {least} are needed"
    ]


def _commands(records: Sequence[Record], plant: Plant) -> list[str]:
    for record in records:
        for asked in record.inputs.T:
            known = asked[np.isfinite(asked)]
            if known.size and known.min() < known.max():
                return []
    return [f"{', '.join(plant.inputs)} never changes: nothing was asked of the rig"]


def _readings(records: Sequence[Record], index: int, output: Output, period: float) -> list[str]:
    """Return what is wrong with the readings of one channel, in words; empty if nothing is.

    Nothing is wrong with a channel that was not recorded at all.
    """
    if all(record.lacks(index) for record in records):
        return []
    known = [np.isfinite(r.variances[:, index]) for r in records]
    usable_samples = np.concatenate(
        [
            good if r.unread is None else good[~r.unread.all(1)]
            for r, good in zip(records, known, strict=True)
        ]
    )
    name = output.channel
    saturated = 1.0 - float(usable_samples.mean())
    if saturated > SATURATED:
        return [
            f"{name} is missing or at an end of its range for {saturated:.0%} of the samples "
            f"(range {output.lower:g} to {output.upper:g} {output.unit}; is it in {output.unit}?)"
        ]
    noise = output.variance**0.5
    count = max(round(_AVERAGED_S / period), 1)
    travel = max(
        _travel(r.readings[:, index], good, count) for r, good in zip(records, known, strict=True)
    )
    if travel < MOVES * noise:
        return [
            f"{name} hardly moves: {travel:.3g} {output.unit}, and its noise is {noise:.3g} "
            f"{output.unit}; {MOVES * noise:.3g} {output.unit} are needed (is it in {output.unit}?)"
        ]
    seen = max(_noise(r, index, period) for r in records)
    if seen > NOISIER * noise:
        return [
            f"{name} is mostly noise: {seen:.3g} {output.unit} from sample to sample, and "
            f"{noise:.3g} {output.unit} are stated (is it in {output.unit}?)"
        ]
    return []


def _travel(readings: Array, good: BoolArray, count: int) -> float:
    """Return how far apart the least and the greatest average of `count` good readings are.

    `good` bool (n,) says which of the readings (n,) are good. Each is in one average at most. The
    result is 0 if there are fewer than `count`.
    """
    kept = readings[good]
    whole = len(kept) // count * count
    return float(np.ptp(kept[:whole].reshape(-1, count).mean(1))) if whole else 0.0


def _noise(record: Record, index: int, period: float) -> float:
    """Return the standard deviation of an output's white noise, at most.

    Samples without a reading are left out. It is that of the second differences. Where readings are
    more than 1 ms apart, the bends of a motion may look like noise, and two things tell them from
    it. A motion bends less than it moves from reading to reading, and white noise bends more: if
    the readings' median bend is less than their median step, the result is 0. And what the readings
    before foretell is no noise, however it bends, such as oil that swings: the result is not more
    than they leave (`_unforetold`). It is also 0 for fewer than three readings.
    """
    readings = record.readings[:, index]
    if record.unread is not None:
        readings = readings[~record.unread[:, index]]
        period *= len(record) / max(len(readings), 1)
    if len(readings) < 3:
        return 0.0
    curved = float(np.median(np.abs(readings[2:] - 2.0 * readings[1:-1] + readings[:-2])))
    noise = curved / (_NORMAL * 6.0**0.5)
    if period <= _RESOLVED_S:
        return noise
    if curved < np.median(np.abs(np.diff(readings))):
        return 0.0
    return min(noise, _unforetold(readings))


def _unforetold(readings: Array) -> float:
    """Return the standard deviation of what the `_BEFORE` readings before each do not foretell.

    They foretell it by a linear combination of them, with the coefficients that fit best to all
    readings (n,) by least squares (an autoregression, Yule 1927). White noise is foretold by
    nothing. The result is infinite with fewer than ten readings for each coefficient. It is the
    median deviate: blows now and then, which nothing foretells, hardly count.
    """
    count = len(readings) - _BEFORE
    if count < 10 * (_BEFORE + 1):
        return np.inf
    level = readings - np.mean(readings)
    before = np.column_stack([level[k : k + count] for k in range(_BEFORE)])
    after = level[_BEFORE:]
    left = after - before @ np.linalg.lstsq(before, after, rcond=None)[0]
    return float(np.median(np.abs(left))) / _NORMAL


def _mixed_up(fitter: Fitter) -> list[str]:
    """Return in words which channels of the same unit were mixed up; empty if none were.

    The model as given predicts the records once as they are and once with two channels exchanged,
    each time with gains of its own. Two are mixed up if that makes the cost fall to a part of
    1 / `MIXED_UP` or less. The cost of the first seconds (`_BEGINNING_S`) is a lower bound of it:
    where that is too much already, the rest is not predicted.
    """
    plant = fitter.predictor.plant
    whole = range(len(plant.outputs))
    recorded = [k for k in whole if not any(r.lacks(k) for r in fitter.records)]
    pairs = [
        (one, other)
        for one, other in combinations(recorded, 2)
        if plant.outputs[one].unit == plant.outputs[other].unit
    ]
    if not pairs:
        return []
    given = _cost(fitter)
    # The same readings are used, in another order.
    readings = fitter.filtered(plant.nominal).samples
    beginning = round(_BEGINNING_S / plant.period)
    found = []
    for one, other in pairs:
        order = [{one: other, other: one}.get(k, k) for k in whole]
        changed = [_exchanged(record, order) for record in fitter.records]
        begun = Fitter(fitter.predictor, [r.part(0, beginning) for r in changed], fitter.pool)
        least = begun.filtered(plant.nominal).costs(plant.nominal).sum() / max(readings, 1)
        if np.isfinite(given) and given < MIXED_UP * least:
            continue
        cost = _cost(Fitter(fitter.predictor, changed, fitter.pool))
        if np.isfinite(cost) and not given < MIXED_UP * cost:
            names = " and ".join(plant.outputs[k].channel for k in (one, other))
            found.append(
                f"{names} are mixed up: with the two exchanged the model as given predicts "
                f"{given / cost:.0f} times better; exchange the columns, or the lines at the rig"
            )
    return found


def _cost(fitter: Fitter) -> float:
    """Return the cost per reading of the model as given; infinite if no reading can be used."""
    values = fitter.predictor.plant.nominal
    filtered = fitter.filtered(values)
    return float(filtered.costs(values).sum() / filtered.samples) if filtered.samples else np.inf


def _exchanged(record: Record, order: Sequence[int]) -> Record:
    """Return a record with its channels in another order: `order` has their present indices."""

    def moved(columns: Array) -> Array:
        return np.ascontiguousarray(columns[:, order])

    return replace(
        record,
        readings=moved(record.readings),
        variances=moved(record.variances),
        unread=None if record.unread is None else np.ascontiguousarray(record.unread[:, order]),
    )


def _lost(fitter: Fitter) -> list[str]:
    plant = fitter.predictor.plant
    innovations_of = fitter.filtered(plant.nominal).innovations(plant.nominal)
    found = []
    for record, (innovations, _) in zip(fitter.records, innovations_of, strict=True):
        with np.errstate(all="ignore"):
            missed = np.median(np.abs(innovations), axis=0)
        found += [
            f"{record.source}: {output.channel} has nothing to do with the model: predictions one "
            f"sample ahead miss by {f'{miss:.0f}' if np.isfinite(miss) else 'no number'} standard "
            "deviations; are its units and columns right?"
            for output, miss in zip(plant.outputs, missed, strict=True)
            if not miss < LOST
        ]
    return found


def worse_than_resting(
    predictor: Predictor, record: Record, gains: Gains, values: Values
) -> list[str]:
    """Return the channels whose predictions are worse than the assumption that nothing changes.

    The mean squared errors over the horizon are compared; `WORSE` says what counts as worse. Errors
    that are not finite do, too. A channel without a usable reading is left out.
    """
    plant = predictor.plant
    horizon = round(plant.horizon / plant.period)
    states = predictor.innovations(record, gains, values)[1]
    errors = predictor.ahead(record, values, states)
    from_ = np.arange(len(record)) // horizon * horizon
    resting = record.readings - record.readings[from_]
    resting[~np.isfinite(errors)] = np.nan
    settled = slice(settling(plant.period), None)
    used = np.isfinite(record.variances[settled]).sum(axis=0) > 0
    # A channel that is not read is left out, because there is nothing to predict.
    model, rest = mean_squares(errors[settled]), mean_squares(resting[settled])
    return [
        output.channel
        for output, is_used, a, b in zip(plant.outputs, used, model, rest, strict=True)
        if is_used and (a > WORSE * b + output.variance or not np.isfinite(a + b))
    ]


def check_course(recording: Recording, plant: Plant) -> None:
    """Check that the plant, with its own parameter values, has finite states along a recording.

    Raises:
        PlantError: a state or reading is not finite; the error says which, when, and what may be
            the cause.
        KeyError: the recording lacks a channel of the plant.
    """
    predictor, record = Predictor(plant), record_of(recording, plant)
    with np.errstate(all="ignore"):
        gains = predictor.filter(record, plant.nominal)
        innovations, states = predictor.innovations(record, gains, plant.nominal)
    finite = np.isfinite(states)
    if finite.all() and np.isfinite(innovations).all():
        return
    row = int(np.argmin(finite.all(axis=1) & np.isfinite(innovations).all(axis=1)))
    lost = np.flatnonzero(~finite[row])
    name = plant.states[int(lost[0])].name if len(lost) else "a reading"
    raise PlantError(
        [
            f"plant {plant.name}: {name} is {states[row, lost[0]] if len(lost) else 'not finite'} "
            f"at {row * plant.period:.3f} s of {recording.source}; rates must be finite wherever "
            "the plant comes, and what is fast needs more substeps (docs/another_plant.md)"
        ]
    )
