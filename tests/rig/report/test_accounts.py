from pathlib import Path

import numpy as np
import pytest

from estimator.accounts.nuisances import NUISANCES, NuisanceBelief
from estimator.baselines.baseline import PATTERN_FILTERS, Baseline
from estimator.baselines.baseline_file import content_of
from estimator.evidence import AccountHistory
from estimator.leaks.detection import OilAccountDetector
from estimator.leaks.pattern import HealthyLevel
from estimator.leaks.replaying import judged, samples_of
from rig.plant import LEAKS, Model
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording, read_recording
from rig.report.accounts import account_history, recorded_run
from rig.runner.outcomes.outcome import TestOutcome
from rig.runner.outcomes.recorded import account_detector_of

INJECTED_AT_S = 8.0


def recorded(test: TestOutcome, directory: Path) -> Recording:
    assert test.recording is not None
    return read_recording(directory / test.recording)


def history(test: TestOutcome, directory: Path) -> AccountHistory:
    found = account_history(recorded(test, directory), OilAccountDetector(Model()))
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
    crossed = accounts.decided_s[accounts.statistic > accounts.threshold]
    assert leaking.detected_at_s is not None
    assert crossed[0] == pytest.approx(leaking.detected_at_s, abs=1e-6)
    assert (accounts.statistic[accounts.decided_s <= INJECTED_AT_S] >= 0.0).all()


def test_what_a_motion_would_have_shown_is_judged_by_what_came_before_the_leak(
    leaking: TestOutcome, healthy: TestOutcome, run_directory: Path
) -> None:
    before_leak, whole = history(leaking, run_directory), history(healthy, run_directory)
    for leak in LEAKS[:2]:
        key = f"smallest_{leak}_m3_per_s"
        # 8 s show less than 20 s, but the leak itself does not count as noise.
        assert 1.0 < before_leak.smallest[key] / whole.smallest[key] < 3.0


def test_a_recording_without_the_filter_s_estimates_has_no_account(
    leaking: TestOutcome, run_directory: Path
) -> None:
    channels = recorded(leaking, run_directory).channels
    measured = {name: values for name, values in channels.items() if not name.startswith("est_")}
    assert account_history(Recording(measured), OilAccountDetector(Model())) is None


def frozen(recording: Recording) -> Recording:
    """Return a recording whose second pressure reads the same from 10 s on, as do its estimates."""
    channels = dict(recording.channels)
    late = recording.time_s > 10.0
    channels["pressure_2_Pa"] = np.where(late, 6.9e6, recording["pressure_2_Pa"])
    return Recording(channels, recording.metadata)


def with_settings(recording: Recording, baseline: Baseline) -> Recording:
    """Return a recording of a campaign with a baseline."""
    reported = {"detector": {"filter": "product", "baseline": content_of(baseline)}}
    return Recording(recording.channels, {**recording.metadata, **reported})


LEVELS = {name: HealthyLevel(np.ones(2), np.ones(2), 8) for name in PATTERN_FILTERS}
KNOWN = NuisanceBelief(np.full(len(NUISANCES), 0.1), 0.01 * np.eye(len(NUISANCES)))


@pytest.mark.parametrize("case", ["as it is", "frozen pressure", "baseline", "model error"])
@pytest.mark.parametrize("which", ["leaking", "healthy", "frozen at a leak"])
def test_the_plotted_evidence_crosses_its_bar_just_where_the_detector_alarms(
    case: str, which: str, request: pytest.FixtureRequest, run_directory: Path
) -> None:
    test: TestOutcome = request.getfixturevalue("healthy" if which == "healthy" else "leaking")
    recording = recorded(test, run_directory)
    if case == "frozen pressure" or which == "frozen at a leak":
        recording = frozen(recording)
    if case in ("baseline", "model error"):
        factor = 1.0 if case == "baseline" else 10.0
        recording = with_settings(recording, Baseline(KNOWN, LEVELS, model_error=factor))
    # What the run decided: its own detector, shown the same samples and estimates.
    own = OilAccountDetector(Model())
    if case in ("baseline", "model error"):
        own = OilAccountDetector(Model(), 1.0, KNOWN, factor)
    run = recorded_run(recording, "product")
    assert run is not None
    held = list(judged(samples_of(recording), run, own))
    detector = account_detector_of(recording, Model(), 1.0)
    assert detector is not None
    accounts = account_history(recording, detector)
    assert accounts is not None
    above = accounts.statistic > accounts.threshold
    assert above.tolist() == [decision.names_a_fault for _, decision in held]
    assert accounts.decided_s.tolist() == [time_s for time_s, _ in held]
    assert accounts.threshold.tolist() == [decision.threshold for _, decision in held]
    assert accounts.statistic[above].tolist() == [d.statistic for _, d in held if d.names_a_fault]


def test_a_recording_shorter_than_a_block_has_no_account(
    leaking: TestOutcome, run_directory: Path
) -> None:
    channels = recorded(leaking, run_directory).channels
    short = {name: values[:300] for name, values in channels.items()}
    assert account_history(Recording(short), OilAccountDetector(Model())) is None
