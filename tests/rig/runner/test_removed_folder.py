"""A campaign whose folder is removed stops, and goes on later in the folder that has its data."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from estimator.leaks import Decision
from rig.configuration.rigs.rig import Rig
from rig.recording import read_recording
from rig.runner import Observer, Status, StopFlag, run_campaign
from rig.runner.run_folder import read_journal
from tests.rig.runner.conftest import MakeCampaign, MakeTest
from tests.waiting import until


class Remover(Observer):
    """Removes the run's folder in the given test, and waits until the run is asked to stop."""

    def __init__(self, folder: Path, in_test: int) -> None:
        self.stop = StopFlag()
        self.told: list[str] = []
        self._folder, self._in_test = folder, in_test

    def rig_tells(self, text: str) -> None:
        self.told.append(text)

    def test_begins(self, number: int, test: object) -> None:
        self._in_test -= 1

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        if self._in_test == 0 and time_s > 1.0 and not self.stop.requested:
            shutil.rmtree(self._folder)
            until(lambda: self.stop.requested, "the loss to be noticed")


class BetweenTests(Remover):
    """Removes the run's folder after the first test, and does not wait."""

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        pass

    def test_ends(self, outcome: object) -> None:
        if self._in_test == 0:
            shutil.rmtree(self._folder)


@pytest.mark.parametrize("remover", [Remover, BetweenTests])
def test_a_campaign_whose_folder_is_removed_keeps_its_data_and_can_be_resumed(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    remover: Callable[[Path, int], Remover],
) -> None:
    tests = [make_test(name, duration_s=3.0) for name in ("first", "second")]
    campaign = make_campaign(*tests)
    folder = tmp_path / "run"
    observer = remover(folder, 2 if remover is Remover else 1)
    outcome = run_campaign(
        campaign, rig, folder, pace="fast", observer=observer, stop=observer.stop
    )
    kept = tmp_path / "run-kept"
    assert outcome.kept_in == kept
    assert not folder.exists()
    assert outcome.exit_code == 3
    assert "the loss of its folder" in observer.stop.reason
    assert str(kept) in observer.told[-1]
    assert read_journal(kept / "journal.jsonl")[-1].kind == "end"
    for test in outcome.tests:
        if test.recorded_s and test.recording is not None:
            recording = read_recording(kept / test.recording)
            assert len(recording) == pytest.approx(test.recorded_s * 1000)
    again = run_campaign(campaign, rig, kept, pace="fast", resume=True)
    assert again.tests[0].recorded_s == outcome.tests[0].recorded_s == 3.0
    assert Status.NOT_RUN not in again.counts
    assert again.kept_in is None
