"""Runs the oil account and its test over a recording again, for the report's pictures.

The verdict is the one that was held when the test ran; this shows what it was held by.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.account_noise import NOISE
from estimator.finding import Finding
from estimator.flow_account import AccountBlock
from estimator.leak_test import MINIMUM_BLOCKS, LeakTest
from estimator.leak_verdicts import LeakVerdicts
from estimator.nuisances import NUISANCE_COUNT
from estimator.oil_account import OilAccount
from rig.plant import Parameters
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording.recording import Recording

Array = NDArray[np.float64]

_ESTIMATES: Final = (
    "est_spool_m",
    "est_pressure_1_Pa",
    "est_pressure_2_Pa",
    "est_position_m",
)
_MEASURED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
_NOISE: Final = NOISE * LITRE_PER_MINUTE


class _LikeliestFault(LeakTest):
    """Names the fault that is most likely, however unlikely it is."""

    def threshold(self, freedom: float) -> float:
        """Return 0: any sign of a fault will do."""
        return 0.0


@dataclass(frozen=True)
class AccountHistory:
    """The oil accounts of a recording and what their test made of them, block by block.

    Attributes:
        start_s, end_s: float64 (n,), of each complete block: half a second, or longer.
        missing: float64 (n, 2), missing flow of each chamber less the fitted model errors, m^3/s.
        explained: float64 (n, 2), what the faults found at the end explain of it, m^3/s.
        statistic: float64 (n,), of the fault that is likeliest at that time; 0 if there is none.
        threshold: float64 (n,), what a healthy rig exceeds at the stated rate.
        smallest: float64 (2, 5), smallest coefficients, SI, of `estimator.flow_account.FAULTS` that
            would have been found had they begun halfway, and with the first block; by the blocks
            before the first fault. None where these are too few.
    """

    start_s: Array
    end_s: Array
    missing: Array
    explained: Array
    statistic: Array
    threshold: Array
    smallest: Array | None


def account_history(
    recording: Recording, parameters: Parameters, false_alarms_per_day: float
) -> AccountHistory | None:
    """Return the accounts of a recording; None unless it holds the product filter's estimates."""
    if not all(name in recording for name in (*_ESTIMATES, *_MEASURED)):
        return None
    test, likeliest = LeakTest(false_alarms_per_day), _LikeliestFault(false_alarms_per_day)
    verdicts = LeakVerdicts(test)
    blocks: list[AccountBlock] = []
    findings: list[Finding] = []
    statistics, thresholds, smallest = [], [], []
    for block in _complete_blocks(recording, OilAccount(parameters, test)):
        blocks.append(block)
        likeliest.add(block)
        findings = test.search()
        likely = findings or likeliest.search()
        statistics.append(likely[0].statistic if likely else 0.0)
        thresholds.append(test.limit())
        smallest.append(np.array([verdicts.smallest(0.5), verdicts.smallest(0.0)]))
    if not blocks:
        return None
    explained = _explained(blocks, findings)
    sound = min([finding.onset for finding in findings], default=len(blocks))
    return AccountHistory(
        np.array([block.start_s for block in blocks]),
        np.array([block.end_s for block in blocks]),
        _without_model_errors(blocks, explained),
        explained,
        np.array(statistics),
        np.array(thresholds),
        smallest[sound - 1] if sound >= MINIMUM_BLOCKS else None,
    )


def _complete_blocks(recording: Recording, account: OilAccount) -> Iterator[AccountBlock]:
    """Yield each block that counts, once it is tested."""
    spool, p1, p2, position = (recording[name] for name in _ESTIMATES)
    measured = np.array([recording[name] for name in _MEASURED])
    fresh = np.isfinite(measured).all(axis=0).astype(np.float64)
    unknown = np.full(fresh.size, np.nan)
    for block in account.add(recording.time_s, spool, p1, p2, position, fresh, unknown):
        if block.complete:
            yield block


def _explained(blocks: list[AccountBlock], findings: list[Finding]) -> Array:
    explained = np.zeros((len(blocks), 2))
    for finding in findings:
        signatures = np.array([block.faults[:, finding.fault] for block in blocks])
        present = np.zeros(len(blocks))
        present[finding.onset :] = 1.0
        if finding.onset:
            present[finding.onset - 1] = finding.onset_fraction
        explained += finding.coefficient * present[:, None] * signatures
    return explained


def _without_model_errors(blocks: list[AccountBlock], explained: Array) -> Array:
    """Return the missing flow less what the known weaknesses of the model explain best.

    They are fitted beside the faults found, with the priors of `estimator.flow_account.NUISANCES`
    (ridge regression).
    """
    missing = np.array([block.missing for block in blocks])
    nuisances = np.array([block.nuisances for block in blocks])
    scaled = nuisances.reshape(-1, NUISANCE_COUNT) / _NOISE
    left = ((missing - explained) / _NOISE).ravel()
    sizes = np.linalg.solve(scaled.T @ scaled + np.eye(NUISANCE_COUNT), scaled.T @ left)
    return np.asarray(missing - nuisances @ sizes)
