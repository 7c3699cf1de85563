"""Simulates several independent rigs in lanes, for studies that need thousands of hours.

Each rig has parameters, load, motion, faults and noise of its own. The physics is compiled from the
same source as that of `SimulatedLoop`. Up to rounding, the samples of a rig do not depend on the
rigs in the other lanes.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, POSITION_GAIN, Guide
from rig.lanes import LANES, aligned, empty_lanes, fill_normal, start_streams
from rig.loop.lane_control import lane_guide
from rig.loop.lane_ticks import (
    LOGGED,
    MOST_STEPS,
    NOISE_COUNT,
    READING_COUNT,
    LaneRigs,
    LoopSetting,
    plant_ticks,
    reading_ticks,
)
from rig.plant import (
    DATA_SHEET,
    LONGEST_STEP,
    NO_FAULT,
    NOMINAL,
    REMEMBERING,
    FaultInput,
    Parameters,
    SensorParameters,
    rest_state,
)

Array = NDArray[np.float64]

_BATCH: Final = 500
"""Greatest number of ticks in a batch; its log then fits into the processor's cache."""


class SimulatedLanes:
    """Rigs that begin at rest, one in each lane, and are advanced together.

    Args:
        rigs: true parameters of each rig, (LANES,), all with the same friction law.
        seeds: seed of each rig's noise, (LANES,).
        positions: where each ram rests at first, (LANES,), m.
        faults: coefficients of each rig's faults, (LANES,); None means no faults.
        onsets: tick from which on each rig's faults act, (LANES,); None means the first tick.
        sensors: the transducers' data sheet.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        guides: what each rig's position loop adds to gain times error, (LANES,), with tables from
            the first tick on; None means nothing.

    Attributes:
        rigs: true parameters of each rig, (LANES,).
        plant: states of the rigs, float64 (n, LANES), as in `rest_state`; updated in place.

    Raises:
        ValueError: an argument has not `LANES` items, the rigs differ in friction law, or a rig has
            an effect with a memory outside the plant's state (`REMEMBERING`).
    """

    def __init__(
        self,
        rigs: Sequence[Parameters],
        seeds: Sequence[int],
        positions: Sequence[float],
        *,
        faults: Sequence[FaultInput] | None = None,
        onsets: Sequence[int] | None = None,
        sensors: SensorParameters = DATA_SHEET,
        gain: float = POSITION_GAIN,
        limit: float = COMMAND_LIMIT,
        guides: Sequence[Guide] | None = None,
    ) -> None:
        faults = [NO_FAULT] * LANES if faults is None else faults
        onsets = [0] * LANES if onsets is None else onsets
        for name, given in (("rigs", rigs), ("positions", positions), ("faults", faults),
                            ("onsets", onsets)):  # fmt: skip
            if len(given) != LANES:
                raise ValueError(f"{name}: {len(given)} given for {LANES} lanes")
        if len({rig.friction_law for rig in rigs}) != 1:
            raise ValueError("rigs: both friction laws among them; lanes need one")
        _require_no_memory(rigs)
        at_rest = [rest_state(rig, x) for rig, x in zip(rigs, positions, strict=True)]
        self.rigs = tuple(rigs)
        self.plant = _by_lane(at_rest)
        onset = np.array([onsets], dtype=np.float64)
        self._lanes = LaneRigs(self.plant, _by_lane(rigs), _by_lane(faults), onset)
        self._sensors = sensors
        self._loop = LoopSetting(gain, limit, LONGEST_STEP)
        self._guide = None if guides is None else lane_guide([gain] * LANES, guides)
        self._ticks = 0
        self._streams = start_streams(seeds)
        self._log = empty_lanes(_BATCH * MOST_STEPS * LOGGED).reshape((-1, LOGGED, LANES))

    def advance(self, setpoint: Array, open_loop: Array) -> Array:
        """Run all rigs for as many ticks as there are setpoints, and return their readings.

        The rigs go on from where the call before left them.

        Args:
            setpoint: float64 (ticks, LANES) in m, or in V in open loop.
            open_loop: float64 (ticks, LANES), 1 where the setpoint is the command, else 0.

        Returns:
            The readings, float64 (ticks, 6, LANES), in the order of `LANE_READINGS`.

        Raises:
            RuntimeError: a rig needed more than `MOST_STEPS` integration steps a millisecond, on
                average over a batch of up to 500 ticks.
        """
        ticks = setpoint.shape[0]
        readings = empty_lanes(ticks * READING_COUNT).reshape((ticks, READING_COUNT, LANES))
        for first in range(0, ticks, _BATCH):
            part = slice(first, first + _BATCH)
            self._batch(setpoint[part], open_loop[part], readings[part])
        return readings

    def _batch(self, setpoint: Array, open_loop: Array, readings: Array) -> None:
        ticks = setpoint.shape[0]
        rows = empty_lanes(ticks)
        enough = plant_ticks(
            self._ticks, np.ascontiguousarray(setpoint), np.ascontiguousarray(open_loop),
            self._loop, self._guide, self._lanes, self.rigs[0], self._sensors, self._log, rows,
        )  # fmt: skip
        if not enough:
            raise RuntimeError(
                f"a rig needed more than {MOST_STEPS} steps a millisecond throughout"
            )
        self._ticks += ticks
        noise = empty_lanes(ticks * NOISE_COUNT)
        fill_normal(self._streams, noise)
        reading_ticks(
            self._log, rows, noise, self._lanes.parameters, self.rigs[0], self._sensors, readings
        )  # fmt: skip


def _require_no_memory(rigs: Sequence[Parameters]) -> None:
    for lane, rig in enumerate(rigs):
        for field in REMEMBERING:
            if getattr(rig, field) != getattr(NOMINAL, field):
                raise ValueError(
                    f"rigs: {field} of rig {lane} is {getattr(rig, field):g}, and lanes keep no "
                    f"memory of commands and readings; run that rig by SimulatedLoop"
                )


def _by_lane(of_rigs: Sequence[Any]) -> Array:
    """Return an aligned array (n, LANES) from a sequence of `LANES` rigs with n values each."""
    return aligned(np.transpose(np.array(of_rigs, dtype=np.float64)))
