"""Computes the oil accounts and the evidence on which the verdict of a recording rests.

A new detector with the settings of the run judges the recording in the same way as the run's
detector did, and its accounts are collected.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import BLOCK_S, AccountBlock
from estimator.filters import DEFAULT_FILTER, FILTERS, OUTPUTS, FilterRun
from estimator.leaks import Decision, Found, OilAccountDetector, found_in, judged, samples_of
from rig.plant import FAULTS, LEAKS
from rig.recording import Recording

Array = NDArray[np.float64]

_MEASURED: Final = ("command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa")


@dataclass(frozen=True)
class AccountHistory:
    """The oil accounts of a recording, and the detector's evidence from them.

    Attributes:
        start_s, end_s: begin and end of each complete block, s, float64 (n,); a block lasts half a
            second or longer.
        missing: missing flow of each chamber, less the model errors that the detector found, m^3/s,
            float64 (n, 2).
        explained: the part of it that the leaks which were found explain, m^3/s, float64 (n, 2).
        decided_s: times at which the detector decided, every half second, s, float64 (m,).
        statistic: test statistic of the likeliest fault at those times, float64 (m,); 0 if there is
            no evidence for any.
        threshold: the value that the statistic must exceed, float64 (m,); the detector finds a
            fault where it does.
        smallest: `details` of the detector's last decision before the first fault began, among
            them the smallest leaks that would have been found; empty if there was no such decision.
    """

    start_s: Array
    end_s: Array
    missing: Array
    explained: Array
    decided_s: Array
    statistic: Array
    threshold: Array
    smallest: Mapping[str, float]


def recorded_run(recording: Recording, filter_name: str) -> FilterRun | None:
    """Return a filter's run with the estimates of its states that a recording holds.

    The filter's other outputs and its covariance are not recorded, and are NaN. The result is None
    if not all states are recorded, or if there is no filter of this name.
    """
    chosen = FILTERS.get(filter_name)
    if chosen is None or not all(f"est_{state}" in recording for state in chosen.states):
        return None
    states = np.column_stack([recording[f"est_{state}"] for state in chosen.states])
    outputs = np.full((len(states), len(OUTPUTS)), np.nan)
    unknown = np.full((len(chosen.states), len(chosen.states)), np.nan)
    return FilterRun(chosen, recording.time_s, states, outputs, unknown)


def account_history(recording: Recording, detector: OilAccountDetector) -> AccountHistory | None:
    """Return the oil accounts of a recording, and the evidence that the detector draws from them.

    The result is None if the recording lacks estimates of the product filter or a measured channel
    that is needed, or has no complete block.

    Args:
        recording: the recording of a test.
        detector: a new detector with the settings of the run; it takes the recording's samples.
    """
    run = recorded_run(recording, DEFAULT_FILTER)
    if run is None or not all(name in recording for name in _MEASURED):
        return None
    history: list[tuple[float, Decision]] = []
    evidence: list[tuple[float, float]] = []
    blocks: list[tuple[int, AccountBlock]] = []
    errors: dict[int, tuple[bool, Array]] = {}
    for decided in judged(samples_of(recording), run, detector):
        history.append(decided)
        evidence.append(detector.evidence())
        blocks += [(detector.begun, block) for block in detector.drawn_up if block.complete]
        # When a fault is no longer found, its flow counts as errors of the model.
        claimed = bool(detector.claimed)
        if claimed or not errors.get(detector.begun, (False,))[0]:
            errors[detector.begun] = claimed, detector.model_errors()
    if not blocks:
        return None
    drawn_up = [block for _, block in blocks]
    known = [block.nuisances @ errors[begun][1] for begun, block in blocks]
    missing = np.array([block.missing for block in drawn_up]) - np.array(known)
    start_s, end_s = np.array([(block.start_s, block.end_s) for block in drawn_up]).T
    explained = _explained(drawn_up, found_in(history))
    decided_s = np.array([time_s for time_s, _ in history])
    evident = (decided_s, *np.array(evidence).T, _before_any_fault(history))
    return AccountHistory(start_s, end_s, missing, explained, *evident)


def _explained(blocks: Sequence[AccountBlock], found: Sequence[Found]) -> Array:
    explained = np.zeros((len(blocks), 2))
    for each in found:
        if not each.stays:
            continue
        for leak, coefficient, onset_s, ended_s in _leaks_of(each):
            for row, block in zip(explained, blocks, strict=True):
                there_s = min(block.end_s, ended_s) - max(block.start_s, onset_s)
                part = min(max(there_s / (block.end_s - block.start_s), 0.0), 1.0)
                row += part * coefficient * block.faults[:, FAULTS.index(leak)]
    return explained


def _leaks_of(found: Found) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, coefficient, beginning and end in s of each leak in a fault that was found.

    A leak that comes and goes is yielded once for each opening; nothing is without an onset. The
    end of a leak that may be present is infinite.
    """
    decision = found.decision
    if decision.onset_s is None:
        return
    ended_s = np.inf if found.ended_s is None else found.ended_s
    if decision.returns is not None:
        for each in decision.returns.episodes:
            gone_s = np.inf if each.end_s is None else each.end_s
            yield decision.returns.leak, decision.returns.coefficient, each.start_s, gone_s
        return
    if decision.coefficient is not None and decision.verdict in LEAKS:
        yield decision.verdict, decision.coefficient, decision.onset_s, ended_s
    for leak in LEAKS:
        if (coefficient := decision.details.get(f"{leak}_coefficient")) is not None:
            yield leak, coefficient, decision.details[f"{leak}_onset_s"], ended_s


def _before_any_fault(history: Sequence[tuple[float, Decision]]) -> Mapping[str, float]:
    """Return the details of the last decision that names no fault before the first fault began.

    The first fault began at the earliest onset in any decision that names a fault; half a block is
    added, as an onset is known no better. If no decision names a fault, the details are those of
    the last one. Return {} if there is no such decision.
    """
    onsets = [d.onset_s for _, d in history if d.names_a_fault and d.onset_s is not None]
    # An onset is known to half a block.
    begun = min(onsets, default=np.inf) + 0.5 * BLOCK_S
    before = [d.details for time_s, d in history if not d.names_a_fault and time_s <= begun]
    return before[-1] if before else {}
