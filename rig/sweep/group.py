"""Prepares the cases of a group, which are run together, one in each lane."""

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
    """One case for each lane, in the arrays that compiled code takes.

    Args:
        setting: what all cases of the sweep share.
        cases: the cases from which those of the group are chosen.
        at: indices of the chosen cases, (LANES,).
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
        """Return the positions at which the rams rest at first, m, (LANES,).

        It is the first value of the setpoint; in open loop, the middle of the position limits.
        """
        sines = self.motions.sines.reshape(-1, SINE_ROWS, LANES)
        waves = sines[:, AMPLITUDE] * np.sin(2.0 * np.pi * sines[:, PHASE])
        begins = self.motions.levels[0] + waves.sum(axis=0)
        return np.where(self.motions.open_loop != 0.0, self.setting.middle, begins)

    def _stream(self, row: int) -> NDArray[np.uint64]:
        """Return the initial state of a stream of noise, from a row of `Cases.seeds`."""
        return start_streams([int(seed) for seed in self.cases.seeds[row, self.at]])

    @property
    def names(self) -> str:
        """The numbers of these cases as text, for messages."""
        return f"cases {', '.join(map(str, np.unique(self.cases.numbers[self.at])))}"


def groups_of(cases: Cases) -> Iterator[NDArray[np.intp]]:
    """Yield for each group the indices of its cases, (LANES,).

    The groups share no case. If cases are missing in the last group, its last case is repeated.
    """
    numbers = np.arange(cases.count)
    for first in range(0, cases.count, LANES):
        yield np.minimum(numbers[first] + np.arange(LANES), cases.count - 1)
