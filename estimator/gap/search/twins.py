"""A twin is the record that a rig exactly like the model would have made on the same course."""

from typing import Final

from estimator.gap.prediction import Filtered, Fitter, Values

FEW: Final = 2
"""Number of twins in which effects are looked for."""
_KEPT: Final = 2
"""Number of sets of values whose twins are kept: a search goes back to the values that it left for
a look at others."""


class Twins:
    """Makes twins of a fitter's records, and keeps those of the last two sets of values.

    Args:
        fitter: fitter of the records.
        seed: seed of the sensor noise.
    """

    def __init__(self, fitter: Fitter, seed: int) -> None:
        self.fitter, self._seed = fitter, seed
        self._twins: dict[tuple[float, ...], list[Filtered]] = {}

    def of(self, values: Values, count: int = FEW) -> list[Filtered]:
        """Return `count` sets of twins, each with a twin of every record, for these values.

        The twins are filtered with the same values. Each set has sensor noise of its own.
        """
        key = tuple(values.values())
        made = self._twins[key] = self._twins.pop(key, [])
        while len(self._twins) > _KEPT:
            self._twins.pop(next(iter(self._twins)))
        predictor, pool = self.fitter.predictor, self.fitter.pool
        for twin in range(len(made), count):
            numbers = range(len(self.fitter.records))
            records = pool.map(
                lambda index, first=self._seed + 1000 * twin: predictor.twin(
                    self.fitter.records[index], values, first + index
                ),
                numbers,
            )
            made.append(Fitter(predictor, list(records), pool).filtered(values))
        return made[:count]
