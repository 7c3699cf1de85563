"""Defines what all cases of a sweep share, and the cases that run together, one in each lane."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from control import Sequence
from estimator.leaks import SILENT
from rig.configuration import Rig, Sweep, SweepFilter
from rig.lanes import LANES, aligned, start_streams
from rig.loop import LANE_READINGS, LaneRigs, LoopSetting
from rig.plant import NO_FAULT, TICK, Model, Parameters, SensorParameters, rest_state

from .asked import LIMIT_PASSED, Asked, Known, asked_of, columns_told, judged_case, readings_kept
from .drawing import Cases
from .guiding import MotionControl, guide_of_cases
from .ticks import BLOCK, SEEN, SETTLED, CaseLanes, scale_sines, setpoint_ticks

Array = NDArray[np.float64]
Figures = dict[str, NDArray[np.generic]]
"""Columns of the table by their names, with one value for each of n cases."""


class SweepError(RuntimeError):
    """Raised if cases of a sweep cannot be run; the message says why."""


@dataclass(frozen=True)
class Setting:
    """The settings that all cases of a sweep share, as a worker needs them.

    Attributes:
        like: parameters of the rig, of which each case replaces those that are drawn.
        sensors: data sheet of the rig's transducers.
        model: the model that the filter assumes.
        ticks: number of ticks of a case.
        loop: settings of the position loop.
        controls: control of each motion of the sweep.
        guided: whether the cases differ in their control, or add something to gain times error.
        middle: middle of the rig's position limits, at which a case in open loop begins, m.
        has_spool, has_supply: whether the rig measures spool position and supply pressure.
        sequences: setpoint of each motion with segments; None for other motions.
        asked: what is asked of the cases of each motion.
        kept: which readings of each case must be kept for that, as in `rig.loop.LANE_READINGS`;
            none if nothing is asked of samples.
        corrections: what the calibrations of the rig's transducers add to readings: index in
            `rig.loop.LANE_READINGS`, indicated values and the corrections there, SI. Between two
            points they are linear, beyond the ends those of the ends (`rig.io.corrections_of`).
    """

    like: Parameters
    sensors: SensorParameters
    model: Model
    filter_name: SweepFilter
    false_alarms_per_day: float
    ticks: int
    loop: LoopSetting
    controls: tuple[MotionControl, ...]
    guided: bool
    middle: float
    has_spool: bool
    has_supply: bool
    sequences: tuple[Sequence | None, ...]
    asked: tuple[Asked, ...]
    kept: tuple[str, ...]
    corrections: tuple[tuple[int, Array, Array], ...]

    @property
    def blocks(self) -> int:
        """Number of blocks, of half a second each, in a case."""
        return (self.ticks - 1) // BLOCK


def _corrections(rig: Rig) -> Iterator[tuple[int, Array, Array]]:
    """Yield what the calibrations of a rig's transducers add to the readings of its lanes."""
    for each in rig.calibrations:
        if each.channel in LANE_READINGS:
            points = np.array([(point.indicated, point.correction) for point in each.points])
            yield LANE_READINGS.index(each.channel), points[:, 0].copy(), points[:, 1].copy()


def setting_of(sweep: Sweep) -> Setting:
    """Return the settings that all cases of a sweep share."""
    base = sweep.rig
    closed = [motion for motion in sweep.motions if motion.quantity == "position"]
    gains = {sweep.gain_of(motion) for motion in closed}
    tracks = any(not sweep.control_of(motion).is_proportional for motion in closed)
    draws = any("position_gain" in motion.values for motion in closed)
    asked = tuple(asked_of(sweep, motion) for motion in sweep.motions)
    return Setting(
        like=base.plant.parameters,
        sensors=base.sensors,
        model=sweep.model,
        filter_name=sweep.filter_name,
        false_alarms_per_day=sweep.false_alarms_per_day,
        ticks=sweep.ticks,
        loop=LoopSetting(
            next(iter(gains), base.gain_V_per_m), base.limits.command_V, sweep.longest_step_s
        ),
        controls=tuple(
            MotionControl(motion.type, sweep.control_of(motion), sweep.gain_of(motion))
            for motion in sweep.motions
        ),
        guided=tracks or draws or len(gains) > 1,
        middle=0.5 * (base.limits.position_min_m + base.limits.position_max_m),
        has_spool=base.has_spool_sensor,
        has_supply=base.has_supply_pressure_sensor,
        sequences=tuple(motion.sequence for motion in sweep.motions),
        asked=asked,
        kept=readings_kept(asked),
        corrections=tuple(_corrections(base)),
    )


@dataclass
class Group:
    """One case for each lane, in the arrays that compiled code takes.

    Args:
        setting: what all cases of the sweep share.
        cases: the cases from which those of the group are chosen.
        at: indices of the chosen cases, (LANES,).

    Attributes:
        motions: setpoints of the chosen cases, with sums of sines scaled to their peaks.
        rigs: rigs of the chosen cases, at rest.
        lanes: setpoints and noise of the chosen cases, before the first tick.
    """

    setting: Setting
    cases: Cases
    at: NDArray[np.intp]

    def __post_init__(self) -> None:
        self._setpoints: Array | None = None
        cases, at = self.cases, self.at
        self.motions = motions = cases.motions.of(at)
        scale_sines(motions.sines, motions.peak[None, :].copy(), self.setting.ticks)
        parameters = aligned(cases.parameters[:, at])
        rigs = [Parameters(*map(float, column)) for column in parameters.T]
        at_rest = [rest_state(rig, x) for rig, x in zip(rigs, self._starts(), strict=True)]
        faults = aligned(np.zeros((len(NO_FAULT), LANES)))
        faults[: cases.coefficients.shape[0]] = cases.coefficients[:, at]
        onset = cases.onset_tick[at][None, :].copy()
        setting = self.setting
        growth = cases.growth(at, setting.ticks)
        self.rigs = LaneRigs(aligned(np.transpose(at_rest)), parameters, faults, onset, growth)
        # Whether there is a table is the same in all groups, so that there is one code for it.
        segmented = any(sequence is not None for sequence in setting.sequences)
        table = self.setpoints() if segmented else None
        guide = None
        if setting.guided:
            guide = guide_of_cases(
                motions, setting.controls, setting.model.parameters, setting.sensors,
                setting.loop.limit, self.setpoints,
            )  # fmt: skip
        self.lanes = CaseLanes(
            motions.sines, motions.wave, motions.levels, motions.ends, table, np.zeros((1, LANES)),
            motions.open_loop[None, :].copy(), guide, cases.noise[at][None, :].copy(),
            self._stream(0), self._stream(1),
        )  # fmt: skip

    def setpoints(self) -> Array:
        """Return the setpoints of all ticks of these cases, m or V, float64 (ticks, LANES)."""
        if self._setpoints is None:
            ticks, motions = self.setting.ticks, self.motions
            held = np.zeros((1, LANES))
            self._setpoints = aligned(np.empty((ticks, LANES)))
            setpoint_ticks(
                0, motions.sines, motions.wave, motions.levels, motions.ends, held, self._setpoints
            )
            for lane, kind in enumerate(motions.kind.tolist()):
                sequence = self.setting.sequences[kind]
                if sequence is not None:
                    self._setpoints[:, lane] = _sampled(sequence, ticks)
        return self._setpoints

    def _starts(self) -> Array:
        """Return the positions at which the rams rest at first, m, (LANES,).

        A position is the setpoint at time 0; in open loop, the middle of the position limits.
        """
        return np.where(self.motions.open_loop != 0.0, self.setting.middle, self.motions.begins())

    def _stream(self, row: int) -> NDArray[np.uint64]:
        """Return the initial state of a stream of noise, from a row of `Cases.seeds`."""
        return start_streams([int(seed) for seed in self.cases.seeds[row, self.at]])

    @property
    def names(self) -> str:
        """The numbers of these cases as text, for messages."""
        return f"cases {', '.join(map(str, np.unique(self.cases.numbers[self.at])))}"

    def outcome_columns(self, verdicts: NDArray[np.str_], ends_s: Array) -> Figures:
        """Return what follows from the verdicts as columns of the table, (LANES,) each.

        The keys are `verdict`, the last one; `right`, whether that is the injected fault;
        `detected_at_s`, when it was first given; `latency_s`, from the onset until it was first
        given after the onset; and `false_alarm`. Both times are NaN if the last verdict names no
        fault, and the latency also if that verdict is wrong. An alarm is false if a verdict names a
        fault at or before the onset, or at any time in a healthy case.

        Args:
            verdicts: the verdict after each block, (blocks, LANES).
            ends_s: time of each of these verdicts, s, (blocks,).
        """
        final = verdicts[-1]
        faults, onset_s = self.cases.faults[self.at], self.cases.onset_s[self.at]
        silent = np.isin(verdicts, SILENT)
        first_held = ends_s[np.argmax(verdicts == final, axis=0)]
        # An alarm is false before a leak begins, and at any time on a healthy rig.
        before = np.where(np.isnan(onset_s), np.inf, onset_s)
        right = final == faults
        # A verdict before the onset is a false alarm; the latency ends at the first right one
        # after it.
        since = (verdicts == final) & (ends_s[:, None] > np.nan_to_num(onset_s, nan=-1.0))
        latency_s = ends_s[np.argmax(since, axis=0)] - onset_s
        return {
            "verdict": final,
            "right": right,
            "detected_at_s": np.where(silent[-1], np.nan, first_held),
            "latency_s": np.where(right & ~silent[-1], latency_s, np.nan),
            "false_alarm": (~silent & (ends_s[:, None] <= before)).any(axis=0),
        }

    def room(self) -> Array:
        """Return an array for the readings that are kept, (ticks, `Setting.kept`, LANES).

        It has no ticks if none are kept.
        """
        kept = self.setting.kept
        return np.empty((self.setting.ticks if kept else 0, len(kept), LANES))

    def asked_columns(self, kept: Array, leak: Array, latency_s: Array) -> Figures:
        """Return what follows from what is asked of these cases as columns, (LANES,) each.

        Args:
            kept: the readings of each tick that are kept, SI, (ticks, `Setting.kept`, LANES).
            leak: flow of each leak as estimated, m^3/s, (LANES,); NaN where it is not told.
            latency_s: time from each onset until the leak was named, s, (LANES,); NaN where it
                was not.
        """
        told = columns_told(self.setting.asked)
        columns: dict[str, list[float | str]] = {
            name: ["" if name == LIMIT_PASSED else float("nan")] * LANES for name in told
        }
        setpoints, leaky = self.setpoints(), ~np.isnan(self.cases.onset_s[self.at])
        judged: dict[int, int] = {}
        for lane, case in enumerate(self.at.tolist() if told else ()):
            # The last group repeats its last case.
            first = judged.setdefault(case, lane)
            if first < lane:
                for column in columns.values():
                    column[lane] = column[first]
                continue
            asked = self.setting.asked[int(self.motions.kind[lane])]
            readings = {
                name: np.ascontiguousarray(kept[:, row, lane])
                for row, name in enumerate(self.setting.kept)
            }
            known = Known(float(leak[lane]), float(latency_s[lane]), bool(leaky[lane]))
            found = judged_case(asked, readings, setpoints[:, lane].copy(), known)
            for name, value in found.items():
                columns[name][lane] = value
        return {name: np.array(values) for name, values in columns.items()}

    def true_flow(self, total: Array) -> Array:
        """Return the mean leak flow from 2 s after the onset to the end, m^3/s; NaN if healthy.

        Args:
            total: sum of the flow over every tenth tick of that time, m^3/s, (LANES,).
        """
        last = float(self.setting.ticks - 1)
        onset = self.cases.onset_tick[self.at]
        count = np.floor(last / SEEN) - np.ceil((onset + SETTLED) / SEEN) + 1.0
        leaky = ~np.isnan(self.cases.onset_s[self.at])
        return np.where(leaky, total / np.maximum(count, 1.0), np.nan)


@lru_cache(maxsize=8)
def _sampled(sequence: Sequence, ticks: int) -> Array:
    """Return a setpoint at each tick, m or V, (ticks,)."""
    return sequence.sample(np.arange(ticks) * TICK)


def groups_of(cases: Cases) -> Iterator[NDArray[np.intp]]:
    """Yield for each group the indices of its cases, (LANES,), in the order of the cases.

    Groups share no case. If cases are missing in the last group, its last case is repeated.
    """
    for first in range(0, cases.numbers.size, LANES):
        yield np.minimum(first + np.arange(LANES), cases.numbers.size - 1)
