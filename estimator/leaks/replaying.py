"""The replay, which runs a filter and a detector over a recording as they run in the loop."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.accounts import BLOCK_TICKS
from estimator.filters import DEFAULT_FILTER, FilterRun, run_filter
from rig.plant import DATA_SHEET, TICK, Model, SensorParameters
from rig.recording import Recording

from .decision import SILENT, Decision
from .detection import Detector, OilAccountDetector
from .found import Found, found_in
from .oil_account import Samples
from .pattern import PatternDetector

_JUDGED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
_LONGEST_S: Final = 5.05e-3
"""Longest period of the rows of a recording, s: the account bridges 5 ms."""

DetectorFactory = Callable[[Model], Detector]


@dataclass(frozen=True)
class ReplayResult:
    """The estimates and decisions that a replay of one recording produced.

    Attributes:
        run: the filter's estimates.
        decision: the final decision.
        detected_at_s: sample time at which the detector first gave the verdict that is also the
            final one, from earlier samples alone; None if that is healthy or inconclusive.
        history: pairs of time in s and decision, one for every half second and one for a shorter
            piece at the end; only a last one if the recording cannot be judged.
        unfit: why the recording cannot be judged, in words; empty if it can.
    """

    run: FilterRun
    decision: Decision
    detected_at_s: float | None
    history: tuple[tuple[float, Decision], ...]
    unfit: str = ""

    @property
    def found(self) -> tuple[Found, ...]:
        """Return all faults that were named at any time, including those that ended."""
        return found_in(self.history)


def why_unfit(recording: Recording, filter_name: str = DEFAULT_FILTER) -> str:
    """Return in words why leaks cannot be judged from a recording, by how it was sampled; else "".

    Readings that were interpolated have neither the noise nor the changes that the detector weighs.
    Over more than 5 ms without a reading the oil's flow is not known (`FlowAccount.add`). The
    thresholds of the thesis's filters hold for a reading in every ms.
    """
    sampling = recording.sampling
    if sampling is None:
        return ""
    for name in _JUDGED:
        if name in sampling.interpolated:
            return f"{name} {sampling.interpolated[name].words}; record every reading as it is"
    if sampling.period > _LONGEST_S:
        return (
            f"a row every {sampling.period * 1e3:.4g} ms is too slow for the flow of the oil; "
            f"record one every {_LONGEST_S * 1e3:.0f} ms or more often, best every ms"
        )
    if filter_name != DEFAULT_FILTER and (sampling.gaps or sampling.period > 1.01 * TICK):
        return f"{filter_name} needs a row every ms, without gaps; the product filter does not"
    return ""


def samples_of(recording: Recording) -> Samples:
    """Return the channels that detectors take; spool and supply pressure are NaN if absent.

    Raises:
        KeyError: the recording lacks command, position or a pressure.
    """
    missing = np.full(recording.time_s.size, np.nan)
    channels = recording.channels
    return Samples(
        recording.time_s,
        channels["command_V"],
        channels["position_m"],
        channels["pressure_1_Pa"],
        channels["pressure_2_Pa"],
        channels.get("spool_m", missing),
        channels.get("supply_pressure_Pa", missing),
    )


def detector_for(name: str, model: Model, false_alarms_per_day: float) -> Detector:
    """Return a new detector for the filter of that name, without a baseline.

    It is the detector by oil accounts for the default filter, and the pattern's for any other.
    """
    if name == DEFAULT_FILTER:
        return OilAccountDetector(model, false_alarms_per_day)
    return PatternDetector(false_alarms_per_day)


def replay(
    recording: Recording,
    model: Model,
    *,
    filter_name: str = DEFAULT_FILTER,
    false_alarms_per_day: float = 1.0,
    detector: Detector | None = None,
    sensors: SensorParameters = DATA_SHEET,
) -> ReplayResult:
    """Run a filter and its detector over a recording; return the estimates and all decisions.

    Args:
        recording: recording with command, position and both pressures, in samples of 1 ms.
        model: model of the rig that filter and detector assume.
        filter_name: a name in `estimator.filters.registry.FILTERS`.
        false_alarms_per_day: rate of the built-in detectors; without effect if `detector` is given.
        detector: a detector to use instead of the one that belongs to the filter.
        sensors: data sheet of the transducers.

    Raises:
        KeyError: the recording lacks command, position or a pressure.
        ValueError: there is no filter of that name, or the default detector's rate is not above 0
            and at most 10000.
    """
    run = filter_recording(recording, model, filter_name, sensors)
    if unfit := why_unfit(recording, filter_name):
        unjudged = Decision("inconclusive")
        last_s = float(recording.time_s[-1])
        return ReplayResult(run, unjudged, None, ((last_s, unjudged),), unfit)
    judge = detector or detector_for(filter_name, model, false_alarms_per_day)
    history = list(judged(samples_of(recording), run, judge))
    final = history[-1][1]
    return ReplayResult(run, final, first_held(history), tuple(history))


def judged(
    samples: Samples, run: FilterRun, detector: Detector
) -> Iterator[tuple[float, Decision]]:
    """Feed samples and estimates to a detector; yield time in s and decision each half second.

    A shorter piece at the end has a decision too. Pieces are fed while the result is iterated over.
    """
    for start in range(0, samples.time_s.size, BLOCK_TICKS):
        # The first block takes one more sample: an account needs one before its first interval.
        part = slice(start + 1 if start else 0, start + BLOCK_TICKS + 1)
        piece = stretch(samples, part)
        if piece.time_s.size == 0:
            break
        detector.update(piece, part_of(run, part))
        yield float(piece.time_s[-1]), detector.decide()


def filter_recording(
    recording: Recording,
    model: Model,
    filter_name: str = DEFAULT_FILTER,
    sensors: SensorParameters = DATA_SHEET,
) -> FilterRun:
    """Run the named filter over a recording and return its estimates.

    Raises:
        KeyError: the recording lacks command, position or a pressure.
        ValueError: there is no filter of that name.
    """
    samples = samples_of(recording)
    measured = np.column_stack(
        [samples.position, samples.pressure_1, samples.pressure_2, samples.spool,
         samples.supply_pressure]
    )  # fmt: skip
    return run_filter(samples.time_s, samples.command, measured, model, filter_name, sensors)


def stretch(samples: Samples, part: slice) -> Samples:
    """Return the samples at the indices of `part`."""
    return Samples(*(series[part] for series in samples))


def part_of(run: FilterRun, part: slice) -> FilterRun:
    """Return a filter's estimates at the indices of `part`.

    The covariance stays that after the last sample of the whole run.
    """
    return replace(run, time_s=run.time_s[part], states=run.states[part], outputs=run.outputs[part])


def first_held(history: list[tuple[float, Decision]]) -> float | None:
    """Return the time in s of the first decision with the verdict of the last one.

    The result is None if that verdict is no fault. The verdict may have changed in between.

    Args:
        history: pairs of time in s and decision, at least one.
    """
    final = history[-1][1].verdict
    if final in SILENT:
        return None
    return next(time for time, decision in history if decision.verdict == final)
