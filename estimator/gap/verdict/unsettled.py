"""This module measures the part of the remaining prediction errors that depends on the motion.

The right effect leaves what a twin leaves, the noise. An effect that stands in for something else
leaves errors that may belong to no equation and to no curve, such as those of a resonance or of
something random. Their mean is 0, but the mean of their squares is not, and it grows where the rig
is stirred (a test of heteroscedasticity, after White 1980). A sensor that is merely noisier than
stated errs at rest as much as in motion, and does not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from estimator.gap.plant import Array, Plant, Record
from estimator.gap.prediction import Filtered, Values, cost_of
from estimator.gap.search import TIME

BINS: Final = 8
"""Number of bins into which a quantity's range is divided, so that each has equally many
readings."""
STIRRED: Final = 0.1
"""Least part of a channel's mean square that must depend on the motion to count, in predicted
variances. It is ten times what matters in all channels together, and three times the precision of a
bin of a recording of half a minute."""
LEFT: Final = 0.02
"""Part of a channel's excess that named effects may leave: twice the part by which their form may
be wrong."""
_SURELY: Final = 2.0
"""Standard errors that are added to each bin, because the least of some bins is below their mean by
chance alone."""
_FEW: Final = 200
"""Least number of readings in a bin; with so many, a mean square is known to a tenth."""


@dataclass(frozen=True)
class Unsettled:
    """Mean squares of a channel's one-step errors above those of twins, in predicted variances.

    Attributes:
        channel: name of the recording's column.
        region: quantity on which the mean squares depend most: a region, or "rate of" and an input;
            "time", with a single bin, if there are too few readings.
        at: float64 (bins,), middle of each bin, SI; bins with fewer than 200 readings are left out.
        values: float64 (bins,), mean squares in the bins, less those of the twins.
        errors: float64 (bins,), standard errors of `values`.
        mean: mean square of all readings, less that of the twins.
        unit: SI unit of `at`; for the rate of an input the input's unit per s, such as "V/s".
        floor: mean square of the twins' errors.
        before: `mean` with only the nuisances refitted (`compared`); 0 if that was not computed.
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
        """Return the part of the mean that depends on the motion: what it has above the least bin.

        The bins are raised by two standard errors first, and the least counts as 0 if it is below.
        """
        return self.mean - max(float((self.values + _SURELY * self.errors).min()), 0.0)

    @property
    def counts(self) -> bool:
        """Return whether so much depends on the motion that something is left unexplained.

        That is so if `stirred` is more than `STIRRED`, and more than the part `LEFT` of `before`.
        """
        return self.stirred > max(STIRRED, LEFT * self.before)


def unsettled(filtered: Filtered, twins: Sequence[Filtered], values: Values) -> list[Unsettled]:
    """Return for each channel its mean squared errors above those of twins, in bins of a quantity.

    The quantity, that of a region or the rate of an input, is the one on which the errors depend
    most; where readings are few there is one bin. Only readings that are used count, from the first
    to the last block of each record.

    Args:
        filtered: the records, with gains for `values`.
        twins: twins of the model with these values, with gains for `values`.
        values: values of all parameters.
    """
    plant = filtered.predictor.plant
    floors = np.mean([mean_costs(twin, values) for twin in twins], axis=0)
    costs, *of_twins = (
        cost_of(_inside(filtered, [innovations for innovations, _ in each.innovations(values)]))
        for each in (filtered, *twins)
    )
    above, known = costs - np.mean(of_twins, axis=0), _inside(filtered, filtered.used)
    quantities = {
        name: _inside(filtered, parts) for name, parts in _quantities(filtered, values).items()
    }
    return [
        _of_channel(plant, output.channel, above[known[:, k], k], float(floors[k]),
                    {name: value[known[:, k]] for name, value in quantities.items()})
        for k, output in enumerate(plant.outputs)
    ]  # fmt: skip


def _inside(filtered: Filtered, parts: Sequence[Any]) -> Any:
    """Return the arrays (n, ...) of all records joined, each from its first block to its last.

    `parts` has one array for each record.
    """
    return np.concatenate(
        [
            part[blocks[0].start : blocks[-1].stop]
            for part, blocks in zip(parts, filtered.blocks, strict=True)
        ]
    )


def compared(left: Sequence[Unsettled], filtered: Filtered, values: Values) -> list[Unsettled]:
    """Return the results `left` with `before` set: the mean square at other values, less `floor`.

    `values` are these other values of all parameters, and `filtered` has the records with gains for
    them.
    """
    costs = mean_costs(filtered, values)
    return [
        replace(each, before=float(cost) - each.floor)
        for each, cost in zip(left, costs, strict=True)
    ]


def mean_costs(filtered: Filtered, values: Values) -> Array:
    """Return the mean square of each channel's innovations (outputs,), outliers counted less.

    Outliers count as in the cost (`cost_of`). Readings count that are used, from the first to the
    last block of each record; a channel without any has 0.
    """
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
    """Return the quantities (n,) of each record that errors may depend on, by name."""
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
    """Return the mean rate of an input (n,), per s: its changes over the last horizon, up or down.

    Changes up and down add up and do not cancel out.
    """
    changes = np.abs(np.diff(record.inputs[:, index], prepend=record.inputs[0, index]))
    total = np.concatenate([[0.0], np.cumsum(changes)])
    length = round(plant.horizon / plant.period)
    first = np.maximum(np.arange(len(changes)) + 1 - length, 0)
    return np.asarray((total[1:] - total[first]) / plant.horizon)


def _of_channel(
    plant: Plant, channel: str, above: Array, floor: float, quantities: dict[str, Array]
) -> Unsettled:
    """Return a channel's mean squares in bins of the quantity on which they depend most.

    Args:
        plant: plant with the units of its regions and inputs.
        channel: name of the channel.
        above: float64 (n,), squared errors less those of the twins.
        floor: mean square of the twins' errors.
        quantities: quantities (n,) that the errors may depend on, by name.
    """
    mean = float(above.mean()) if len(above) else 0.0
    one = np.zeros(1)
    best, most = Unsettled(channel, TIME.name, one, one + mean, one, mean, "s", floor), 0.0
    if not len(above):
        return best
    units = {name: region.unit for name, region in plant.regions.items()}
    for name, unit in zip(plant.inputs, plant.input_units, strict=True):
        units[f"rate of {name}"] = f"{unit}/s"
    for name, value in quantities.items():
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
        explained = float(np.sum(count[kept] * (means - mean) ** 2))
        if explained > most:
            at = 0.5 * (ends[1:] + ends[:-1])[kept]
            errors = np.sqrt(np.maximum(squares - means**2, 0.0) / count[kept])
            best = Unsettled(channel, name, at, means, errors, mean, units[name], floor)
            most = explained
    return best
