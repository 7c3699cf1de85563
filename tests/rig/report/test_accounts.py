from pathlib import Path

import numpy as np
import pytest

from rig.plant import Parameters
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording, read_recording
from rig.report.accounts import AccountHistory, account_history
from rig.runner.outcome import TestOutcome

INJECTED_AT_S = 8.0


def recorded(test: TestOutcome, directory: Path) -> Recording:
    assert test.recording is not None
    return read_recording(directory / test.recording)


def history(test: TestOutcome, directory: Path) -> AccountHistory:
    found = account_history(recorded(test, directory), Parameters(), 1.0)
    assert found is not None
    return found


def test_a_healthy_rig_misses_no_oil(healthy: TestOutcome, run_directory: Path) -> None:
    accounts = history(healthy, run_directory)
    assert np.abs(accounts.missing).max() / LITRE_PER_MINUTE < 0.05
    assert not accounts.explained.any()
    assert (accounts.statistic < accounts.threshold).all()


def test_a_leak_of_chamber_1_makes_a_step_of_its_flow_there_and_nowhere_else(
    leaking: TestOutcome, run_directory: Path
) -> None:
    accounts = history(leaking, run_directory)
    missing = accounts.missing / LITRE_PER_MINUTE
    before, after = accounts.end_s <= INJECTED_AT_S, accounts.start_s >= INJECTED_AT_S + 0.5
    flow = leaking.injected[0].mean_flow_m3_per_s
    assert flow is not None
    assert np.abs(missing[before]).max() < 0.05
    assert missing[after, 0].mean() == pytest.approx(flow / LITRE_PER_MINUTE, rel=0.1)
    assert np.abs(missing[after, 1]).max() < 0.05


def test_what_was_found_explains_what_is_missing(leaking: TestOutcome, run_directory: Path) -> None:
    accounts = history(leaking, run_directory)
    left = (accounts.missing - accounts.explained) / LITRE_PER_MINUTE
    assert np.abs(left).max() < 0.05
    assert not accounts.explained[accounts.end_s <= INJECTED_AT_S - 0.5].any()


def test_the_evidence_crosses_its_threshold_when_the_detector_called_the_leak(
    leaking: TestOutcome, run_directory: Path
) -> None:
    accounts = history(leaking, run_directory)
    crossed = accounts.end_s[accounts.statistic > accounts.threshold]
    assert leaking.detected_at_s is not None
    assert crossed[0] == pytest.approx(leaking.detected_at_s, abs=1e-6)
    assert (accounts.statistic[accounts.end_s <= INJECTED_AT_S] >= 0.0).all()


def test_what_a_motion_would_have_shown_is_judged_by_what_came_before_the_leak(
    leaking: TestOutcome, healthy: TestOutcome, run_directory: Path
) -> None:
    before_leak, whole = history(leaking, run_directory), history(healthy, run_directory)
    assert before_leak.smallest is not None
    assert whole.smallest is not None
    assert (before_leak.smallest > 0.0).all()
    # 8 s tell less than 20 s, but the leak itself does not count as noise.
    ratio = before_leak.smallest[0, :2] / whole.smallest[0, :2]
    assert (ratio > 1.0).all()
    assert (ratio < 3.0).all()


def test_a_recording_without_the_filter_s_estimates_has_no_account(
    leaking: TestOutcome, run_directory: Path
) -> None:
    channels = recorded(leaking, run_directory).channels
    measured = {name: values for name, values in channels.items() if not name.startswith("est_")}
    assert account_history(Recording(measured), Parameters(), 1.0) is None


def test_a_recording_shorter_than_a_block_has_no_account(
    leaking: TestOutcome, run_directory: Path
) -> None:
    channels = recorded(leaking, run_directory).channels
    short = {name: values[:300] for name, values in channels.items()}
    assert account_history(Recording(short), Parameters(), 1.0) is None
