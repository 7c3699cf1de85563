"""What stays of the prediction errors once all was fitted, and goes with the motion.

An effect whose physics is that of the rig leaves what a twin leaves: the noise. One that stands in
for something else leaves a part that may be of no equation and no curve: a resonance, something
that acts at random. Its mean is nought, but not its square, which grows where the rig is stirred
(a test of heteroscedasticity, after White 1980). A sensor that is merely noisier than stated errs
in rest as much as in motion, and does not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant, Record
from estimator.gap.prediction import Filtered, Values, cost_of
from estimator.gap.search import TIME

BINS: Final = 8
"""Bins that a quantity's range is divided into, each visited equally often."""
STIRRED: Final = 0.1
"""Predicted variances of a channel that must go with the motion: ten times what matters in all
channels together, and three times what a bin of a recording of half a minute is known to."""
LEFT: Final = 0.02
"""Part of a channel's excess that names may leave, twice what their form may be wrong by."""
_SURELY: Final = 2.0
"""Standard errors: the least of some bins is below their mean by chance alone."""
_FEW: Final = 200
"""Readings in a bin, of which a mean square is known to a tenth."""


@dataclass(frozen=True)
class Unsettled:
    """Mean squares of a channel's one-step errors above those of twins, in predicted variances.

    Attributes:
        channel: of the recording.
        region: what they depend on most.
        at: float64 (bins,), the middle of each bin, SI.
        values: float64 (bins,), mean squares there.
        errors: float64 (bins,), their standard errors.
        mean: of all readings.
        unit: of `at`.
        floor: mean square of the twins' errors.
        before: `mean` with nuisances refitted only (`compared`), 0 if it was not compared.
    """

    channel: str
    region: str
    at: Array
    values: Array
    errors: Array
    mean: float
    unit: str
    floor: float
    before: float = 0.0

    @property
    def stirred(self) -> float:
        """Return what of the mean goes with the motion: above that where it is surely least."""
        return self.mean - max(float((self.values + _SURELY * self.errors).min()), 0.0)

    @property
    def counts(self) -> bool:
        """Tell whether so much goes with the motion that what was named is not the cause."""
        return self.stirred > max(STIRRED, LEFT * self.before)


def unsettled(filtered: Filtered, twins: Sequence[Filtered], values: Values) -> list[Unsettled]:
    """Return what is left of each channel's errors at values.

    Args:
        filtered: the records, with `values`.
        twins: of the model with these values, likewise.
        values: of all parameters.
    """
    plant = filtered.predictor.plant
    floors = np.mean([mean_costs(twin, values) for twin in twins], axis=0)
    innovations = filtered.innovations(values)
    of_twins = [twin.innovations(values) for twin in twins]
    excess, used = [], []
    for index, (of_record, blocks) in enumerate(zip(filtered.used, filtered.blocks, strict=True)):
        inside = slice(blocks[0].start, blocks[-1].stop)
        floor = np.mean([cost_of(twin[index][0][inside]) for twin in of_twins], axis=0)
        excess.append(cost_of(innovations[index][0][inside]) - floor)
        used.append(of_record[inside])
    above, known = np.concatenate(excess), np.concatenate(used)
    quantities = {
        name: np.concatenate(
            [
                value[blocks[0].start : blocks[-1].stop]
                for value, blocks in zip(parts, filtered.blocks, strict=True)
            ]
        )
        for name, parts in _quantities(filtered, values).items()
    }
    return [
        _of_channel(plant, output.channel, above[known[:, k], k], float(floors[k]),
                    {name: value[known[:, k]] for name, value in quantities.items()})
        for k, output in enumerate(plant.outputs)
    ]  # fmt: skip


def compared(left: Sequence[Unsettled], filtered: Filtered, values: Values) -> list[Unsettled]:
    """Return the same beside what there was at other values, with which records are filtered."""
    costs = mean_costs(filtered, values)
    return [
        replace(each, before=float(cost) - each.floor)
        for each, cost in zip(left, costs, strict=True)
    ]


def mean_costs(filtered: Filtered, values: Values) -> Array:
    """Return the mean square of each channel's innovations (outputs,), outliers as in the cost."""
    outputs = len(filtered.predictor.plant.outputs)
    total, count = np.zeros(outputs), np.zeros(outputs)
    for (innovations, _), used, blocks in zip(
        filtered.innovations(values), filtered.used, filtered.blocks, strict=True
    ):
        inside = slice(blocks[0].start, blocks[-1].stop)
        total += cost_of(innovations[inside]).sum(0)
        count += used[inside].sum(0)
    return np.asarray(total / np.maximum(count, 1.0))


def _quantities(filtered: Filtered, values: Values) -> dict[str, list[Array]]:
    """Return of each record what errors may depend on (n,), by names."""
    plant = filtered.predictor.plant
    states = [states for _, states in filtered.innovations(values)]
    found = {
        name: [
            region.value(of_record, record.inputs)
            for of_record, record in zip(states, filtered.records, strict=True)
        ]
        for name, region in plant.regions.items()
    }
    for index, name in enumerate(plant.inputs):
        found[f"rate of {name}"] = [_stirring(record, index, plant) for record in filtered.records]
    return found


def _stirring(record: Record, index: int, plant: Plant) -> Array:
    """Return by how much an input changed over the last horizon, per second (n,)."""
    changes = np.abs(np.diff(record.inputs[:, index], prepend=record.inputs[0, index]))
    total = np.concatenate([[0.0], np.cumsum(changes)])
    length = round(plant.horizon / plant.period)
    first = np.maximum(np.arange(len(changes)) + 1 - length, 0)
    return np.asarray((total[1:] - total[first]) / plant.horizon)


def _of_channel(
    plant: Plant, channel: str, above: Array, floor: float, quantities: dict[str, Array]
) -> Unsettled:
    """Return the squares (n,) of a channel's errors against what they depend on most."""
    mean = float(above.mean()) if len(above) else 0.0
    even = (np.full(1, mean), np.zeros(1))
    best, most = Unsettled(channel, TIME.name, np.zeros(1), *even, mean, "s", floor), 0.0
    for name, value in quantities.items():
        if len(value) == 0:
            continue
        ends = np.unique(np.quantile(value, np.linspace(0.0, 1.0, BINS + 1)))
        if len(ends) < 3:
            continue
        bins = np.clip(np.searchsorted(ends, value, side="right") - 1, 0, len(ends) - 2)
        count = np.bincount(bins, minlength=len(ends) - 1)
        kept = count >= _FEW
        if kept.sum() < 2:
            continue
        means, squares = (
            np.bincount(bins, power, len(ends) - 1)[kept] / count[kept]
            for power in (above, above**2)
        )
        told = float(np.sum(count[kept] * (means - mean) ** 2))
        if told > most:
            unit = plant.regions[name].unit if name in plant.regions else "/s"
            at = 0.5 * (ends[1:] + ends[:-1])[kept]
            errors = np.sqrt(np.maximum(squares - means**2, 0.0) / count[kept])
            best = Unsettled(channel, name, at, means, errors, mean, unit, floor)
            most = told
    return best
