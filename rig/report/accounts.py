"""Computes the oil accounts and the evidence on which the verdict of a recording rests.

A new detector with the settings of the run judges the recording in the same way as the run's
detector did, and its accounts are collected.
"""

from typing import Final

import numpy as np

from estimator.evidence import AccountHistory, CollectedAccounts
from estimator.filters import DEFAULT_FILTER, FILTERS, OUTPUTS, FilterRun
from estimator.leaks import OilAccountDetector, judged, samples_of
from rig.recording import Recording

_MEASURED: Final = ("command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa")


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
    collected = CollectedAccounts(detector)
    for time_s, decision in judged(samples_of(recording), run, detector):
        collected.take(time_s, decision)
    return collected.history()
