"""When what was laid out in advance takes place: a test whose segments end early runs ahead."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_INSTANT_S: Final = 1e-9


@dataclass
class Timeline:
    """Converts between times of a test and times of its motion as it is laid out, both in s.

    They are equal until the first segment ends early. From then on the motion is ahead.
    """

    _skips: list[tuple[float, float, float]] = field(default_factory=list)
    """Time of the test, and the stretch (begin, end) of the motion that was left out then."""

    def skip(self, at_s: float, to_s: float) -> None:
        """Note that at a time of the test its motion went on at a later time of its own."""
        self._skips.append((at_s, self.laid_s(at_s), to_s))

    def laid_s(self, time_s: float) -> float:
        """Return the time of the motion that belongs to a time of the test."""
        return float(self.laid_at(np.array([time_s]))[0])

    def laid_at(self, times_s: Array) -> Array:
        """Return the times of the motion, (n,), that belong to times of the test, (n,)."""
        laid_s = times_s.astype(np.float64)
        for at_s, begin, end in self._skips:
            laid_s[times_s >= at_s - _INSTANT_S] += end - begin
        return laid_s

    def test_s(self, laid_s: float) -> float:
        """Return the time of the test that belongs to a time of the motion.

        For a time that was left out, it is when that was done.
        """
        left_out_s = 0.0
        for at_s, begin, end in self._skips:
            if begin <= laid_s < end:
                return at_s
            if end <= laid_s:
                left_out_s += end - begin
        return laid_s - left_out_s
