"""The cases that are run together, one in each lane."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.lanes import LANES, aligned, start_streams
from rig.loop import LaneRigs
from rig.plant import NO_FAULT, Parameters, rest_state

from .drawing import Cases
from .motions import AMPLITUDE, PHASE, SINE_ROWS, Motions
from .setting import Setting
from .ticks import CaseLanes, scale_sines

Array = NDArray[np.float64]


@dataclass
class Group:
    """The cases of all lanes, in the arrays that compiled code takes.

    Args:
        setting: of the sweep.
        cases: of which lanes are taken.
        at: (LANES,) which of them.
    """

    setting: Setting
    cases: Cases
    at: NDArray[np.intp]
    motions: Motions = field(init=False)

    def __post_init__(self) -> None:
        cases, at = self.cases, self.at
        self.motions = cases.motions.of(at)
        scale_sines(self.motions.sines, self.motions.peak[None, :].copy(), self.setting.ticks)
        parameters = aligned(cases.parameters[:, at])
        rigs = [Parameters(*map(float, column)) for column in parameters.T]
        at_rest = [rest_state(rig, x) for rig, x in zip(rigs, self._starts(), strict=True)]
        faults = np.zeros((len(NO_FAULT), LANES))
        faults[: cases.coefficients.shape[0]] = cases.coefficients[:, at]
        onset = cases.onset_tick[at][None, :].copy()
        self.rigs = LaneRigs(aligned(np.transpose(at_rest)), parameters, faults, onset)
        motions = self.motions
        self.lanes = CaseLanes(
            motions.sines, motions.levels, motions.ends, np.zeros((1, LANES)),
            motions.open_loop[None, :].copy(), cases.noise[at][None, :].copy(), self._stream(0),
            self._stream(1),
        )  # fmt: skip

    def _starts(self) -> Array:
        """Return where each ram rests at first: where its setpoint begins, m."""
        sines = self.motions.sines.reshape(-1, SINE_ROWS, LANES)
        waves = sines[:, AMPLITUDE] * np.sin(2.0 * np.pi * sines[:, PHASE])
        begins = self.motions.levels[0] + waves.sum(axis=0)
        return np.where(self.motions.open_loop != 0.0, self.setting.middle, begins)

    def _stream(self, row: int) -> NDArray[np.uint64]:
        """Return the start of a stream of noise, of which `Cases.seeds` has a row."""
        return start_streams([int(seed) for seed in self.cases.seeds[row, self.at]])

    @property
    def names(self) -> str:
        """Return the numbers of these cases in words, for messages."""
        return f"cases {', '.join(map(str, np.unique(self.cases.numbers[self.at])))}"


def groups_of(cases: Cases) -> Iterator[NDArray[np.intp]]:
    """Yield the lanes' cases (LANES,), each case in one group; the last is filled with its last."""
    numbers = np.arange(cases.count)
    for first in range(0, cases.count, LANES):
        yield np.minimum(numbers[first] + np.arange(LANES), cases.count - 1)
