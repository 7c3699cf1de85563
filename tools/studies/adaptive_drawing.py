"""Tries the interval of adaptive sweeps on simulated leaks, and counts the cases that it saves.

`python -m tools.studies.adaptive_drawing` simulates sweeps of one place, in which a leak of a size
is found with a known chance. The chances follow curves of many forms. For each form it prints

- how many of the adaptive sweeps have an interval that holds the true size, and the median of its
  upper end over its lower end: after 400 leaks, and if each sweep stops by itself once the upper
  end is at most 20 % above the lower end, or else after 1600 leaks; and how many leaks that took;
- how many leaks drawn evenly over the whole range come to the same interval for a monotone curve
  (of a number that is known beforehand, so by the smaller limit), and how many times as many that
  are;
- how often the interval of the logistic curve of other sweeps holds the true size, drawn evenly,
  and how many leaks it would need for the same interval, which is not worth much where it is wrong.

It takes five minutes. `--seed` draws other sweeps.
"""

import argparse
from collections.abc import Callable
from math import erf, exp, log, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from rig.sweep import power_curve
from rig.sweep.adaptive import Crossing, crossing, next_span

Array = NDArray[np.float64]
Chance = Callable[[Array], Array]

RANGE: Final = log(100.0)
"""Logarithm of the largest size over the smallest: two decades, as in the shipped `detector`."""
SHARE: Final = 0.95
BATCH: Final = 32
"""Leaks of a place in a batch: a third of 96 cases."""
INTERVAL: Final = 0.2
_MOST: Final = 1600
_EVEN: Final = (500, 2000, 8000, 32000)
_EVEN_SWEEPS: Final = 10


def _logistic(x: Array) -> Array:
    return 1.0 / (1.0 + np.exp(-x))


def _normal(x: Array) -> Array:
    return np.array([0.5 * (1.0 + erf(each / 2.0**0.5)) for each in x])


FORMS: Final[dict[str, Chance]] = {
    "logistic": lambda x: _logistic(6.0 * (x - 2.0)),
    "steep logistic": lambda x: _logistic(12.0 * (x - 2.0)),
    "normal": lambda x: _normal(4.0 * (x - 2.0)),
    "Weibull": lambda x: 1.0 - np.exp(-np.exp(4.0 * (x - 2.0))),
    "slow to the top": lambda x: np.exp(-np.exp(-6.0 * (x - 2.0))),
    "two kinds of rigs": lambda x: (
        0.5 * _logistic(12.0 * (x - 1.7)) + 0.5 * _logistic(12.0 * (x - 2.3))
    ),
    "shelf at 85 %": lambda x: (
        0.85 * _logistic(10.0 * (x - 1.7)) + 0.15 * _logistic(10.0 * (x - 2.5))
    ),
    "never above 98 %": lambda x: 0.98 * _logistic(6.0 * (x - 2.0)),
    "long tails": lambda x: 0.5 + np.arctan(12.0 * (x - 2.0)) / pi,
    "a step": lambda x: np.where(x < 2.0, 0.3, 0.99),
}
"""Chance that a leak is found, over ln(size / smallest size), which is from 0 to `RANGE`."""


def true_size(chance: Chance) -> float:
    """Return where a chance reaches `SHARE`, as part of the range of sizes."""
    low, high = 0.0, RANGE
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chance(np.array([middle]))[0] < SHARE else (low, middle)
    return low / RANGE


class Sweep:
    """A simulated sweep of one place.

    Args:
        chance: chance that a leak is found.
        seed: seeds of the sweep's random numbers.

    Attributes:
        sizes: parts of the range of sizes, in order of the cases.
        found: whether each leak was found.
    """

    def __init__(self, chance: Chance, *seed: int) -> None:
        self._chance, self._rng = chance, np.random.default_rng(seed)
        self.sizes, self.found = np.empty(0), np.empty(0, np.bool_)

    def draw(self, count: int, low: float = 0.0, high: float = 1.0) -> None:
        """Add leaks whose sizes are spread evenly between two parts of the range."""
        sizes = low + (high - low) * (np.arange(count) + self._rng.random(count)) / count
        found = self._rng.random(count) < self._chance(sizes * RANGE)
        self.sizes = np.concatenate([self.sizes, sizes])
        self.found = np.concatenate([self.found, found])

    def told(self) -> Crossing:
        """Return where the wanted share is passed."""
        return crossing(self.sizes, self.found, SHARE)

    def adaptively(self, count: int, interval: float = 0.0) -> Crossing:
        """Draw up to `count` leaks in batches, as an adaptive sweep does, and return the crossing.

        Args:
            count: greatest number of leaks.
            interval: as the key `interval` of a sweep.
        """
        span, here = (0.0, 1.0), self.told()
        while self.sizes.size < count:
            self.draw(min(BATCH, count - self.sizes.size), *span)
            here = self.told()
            if width(here.low, here.high) <= 1.0 + interval:
                break
            span = next_span(here)
        return here


def width(low: float, high: float) -> float:
    """Return upper end over lower end of an interval; it counts up to the range of sizes.

    Args:
        low: lower end, as part of the range.
        high: upper end.
    """
    return exp((min(high, 1.0) - max(low, 0.0)) * RANGE)


def logistic_interval(sweep: Sweep) -> tuple[float, float]:
    """Return the interval of a logistic curve, in parts of the range; all of it without a curve."""
    ends = power_curve(np.exp(sweep.sizes * RANGE), sweep.found).interval_m3_per_s
    return (0.0, 1.0) if ends is None else (log(ends[0]) / RANGE, log(ends[1]) / RANGE)


def even_cases(widths: Array, wanted: float) -> float:
    """Return how many evenly drawn leaks come to an interval, between the numbers that were tried.

    Args:
        widths: median of upper end over lower end for each of `_EVEN`, (4,).
        wanted: upper end over lower end that is wanted.
    """
    sizes, wanted_log = np.log(np.log(widths)), log(log(wanted))
    return float(np.exp(np.interp(-wanted_log, -sizes, np.log(_EVEN))))


def row_of(name: str, sweeps: int, seed: int) -> tuple[str, ...]:
    """Return a row of the table: what came of simulated sweeps by one form of curve."""
    chance = FORMS[name]
    true = true_size(chance)
    cells = [name]
    widths: list[float] = []
    cases: list[int] = []
    for count, interval in ((400, 0.0), (_MOST, INTERVAL)):
        held, widths, cases = 0, [], []
        for number in range(sweeps):
            sweep = Sweep(chance, seed, number, count)
            found = sweep.adaptively(count, interval)
            held += found.low <= true <= found.high
            widths.append(width(found.low, found.high))
            cases.append(sweep.sizes.size)
        cells += [f"{100.0 * held / sweeps:.0f} %", f"{np.median(widths):.3f}"]
    used, wanted = float(np.median(cases)), float(np.median(widths))
    monotone, logistic, honest = [], [], 0
    for count in _EVEN:
        even = [Sweep(chance, seed, number, count, 1) for number in range(_EVEN_SWEEPS)]
        for each in even:
            each.draw(count)
        # A number of leaks that is known beforehand needs no more than the smaller limit.
        ends = [each.told() for each in even]
        monotone.append(np.median([width(each.near_low, each.near_high) for each in ends]))
        curves = [logistic_interval(each) for each in even]
        logistic.append(np.median([width(*each) for each in curves]))
        honest += sum(low <= true <= high for low, high in curves)
    needed, by_curve = (even_cases(np.array(each), wanted) for each in (monotone, logistic))
    part = 100.0 * honest / (_EVEN_SWEEPS * len(_EVEN))
    cells += [f"{used:.0f}", needed_words(needed), f"{needed / used:.1f}"]
    return (*cells, f"{part:.0f} %", needed_words(by_curve))


def needed_words(leaks: float) -> str:
    """Return a number of leaks as text; beyond what was tried it is only known to lie there."""
    if leaks <= _EVEN[0]:
        return f"below {_EVEN[0]}"
    return f"above {_EVEN[-1]}" if leaks >= _EVEN[-1] else f"{leaks:.0f}"


def main() -> None:
    """Print the table for all forms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=100, help="of each form (default 100)")
    parser.add_argument("--seed", type=int, default=1, help="default 1")
    options = parser.parse_args()
    table = Table(title=f"{options.sweeps} simulated sweeps of each form, seed {options.seed}")
    for column in (
        "chance of being found", "400 leaks: held", "upper / lower", "stopped: held",
        "upper / lower", "leaks", "evenly", "times as many", "logistic curve: held", "its leaks",
    ):  # fmt: skip
        table.add_column(column, justify="left" if column.startswith("chance") else "right")
    for name in FORMS:
        table.add_row(*row_of(name, options.sweeps, options.seed))
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
