"""A setpoint read from a CSV file."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .csv_table import read_setpoint
from .protocol import Quantity, Samples, Times, checks_of


@dataclass(frozen=True)
class FromFile:
    """A setpoint read from a CSV file (.csv or .csv.gz), linear between its rows.

    The file has a header with `time_s` and `position_m` (quantity "position") or `command_V`
    (quantity "command"); before the first row and after the last their values hold. It is read
    once, when the setpoint is made.

    Raises:
        SetpointFileError: the file is missing or bad; every problem with file:line.
    """

    path: Path
    quantity: Quantity = "position"
    _time: Samples = field(init=False, repr=False, compare=False)
    _value: Samples = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks_of(self).finish()
        time, value = read_setpoint(Path(self.path), self.quantity)
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "_time", time)
        object.__setattr__(self, "_value", value)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint at each time, as `Setpoint.sample`."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self._time, self._value)

    def peak_rate(self, duration_s: float) -> float:
        """Return the steepest slope between rows that the duration reaches, in m/s or V/s."""
        slopes = np.abs(np.diff(self._value) / np.diff(self._time))
        reached = (self._time[:-1] < duration_s) & (self._time[1:] > 0.0)
        return float(np.max(slopes, where=reached, initial=0.0))
