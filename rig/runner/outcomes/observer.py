"""What a run reports to whoever watches it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import Decision
from faults import Campaign, CampaignTest

from .outcome import TestOutcome

Array = NDArray[np.float64]


class Observer:
    """Is called as a run goes on, and does nothing. Derive from it and override what you need.

    Calls come from the run itself, which waits for them to return.
    """

    def campaign_begins(
        self, campaign: Campaign, directory: Path, finished: Sequence[TestOutcome]
    ) -> None:
        """Take note of a campaign that begins, or goes on.

        Args:
            campaign: the campaign.
            directory: the folder its results go to.
            finished: outcomes of the tests that are not run again.
        """

    def campaign_stands(self, *, pausing: bool, held: Sequence[str]) -> None:
        """Take note of what keeps the next test from beginning, when that changes; any thread.

        Args:
            pausing: an operator has asked for a pause, and not to go on since.
            held: conditions that are not met, in words.
        """

    def campaign_ends(self, exit_code: int, reason: str) -> None:
        """Take note that nothing more is run, and of what ended it; empty if it came to its end."""

    def rig_tells(self, text: str) -> None:
        """Take note of what the operator of a rig on hardware should know; from any thread."""

    def test_begins(self, number: int, test: CampaignTest) -> None:
        """Take note of a test that begins, the `number`-th to run, from 1."""

    def test_runs(self, channels: tuple[str, ...], segment: int | None) -> None:
        """Take note of the columns of a test's rows, before its first one.

        Args:
            channels: names of the columns.
            segment: number of the loop's segment on hardware, None on a simulated rig.
        """

    def test_rows(self, rows: Array) -> None:
        """Take note of the next rows of a test, float64 (n, channels)."""

    def test_event(self, time_s: float, kind: str, text: str) -> None:
        """Take note of what a test's recording notes, at a time (s) of the test."""

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        """Take note of the time (s) a test has come to, and of what its detector holds by then."""

    def test_ends(self, outcome: TestOutcome) -> None:
        """Take note of a test that ended, in whatever way; a test that was not run never ends."""

    def test_skipped(self, outcome: TestOutcome) -> None:
        """Take note of a test that an operator does not want to be run."""
