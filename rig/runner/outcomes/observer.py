"""Defines the methods by which a run reports its progress to an observer."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from estimator.leaks import Decision
from faults import Campaign, CampaignTest

from .figures import Array
from .outcome import TestOutcome


class Observer:
    """A base class for observers of a run, whose methods the run calls and which do nothing here.

    A derived class overrides the methods that it needs. The run waits for each call to return.
    """

    def campaign_begins(
        self,
        campaign: Campaign,
        directory: Path,
        finished: Sequence[TestOutcome],
        started: datetime,
        *,
        resumed: bool,
    ) -> None:
        """Handle the begin of a campaign, or of its continuation after a stop or a kill.

        Args:
            campaign: the campaign.
            directory: the folder to which the campaign's results are written.
            finished: outcomes of the tests that an earlier part of the run has finished.
            started: when the run was begun, or gone on with, UTC, as its journal has it.
            resumed: whether it is gone on with.
        """

    def campaign_stands(self, *, pausing: bool, held: Sequence[str], by: str = "") -> None:
        """Handle a pause, its end, or a change of the reasons for a hold; called from any thread.

        Args:
            pausing: whether an operator has asked for a pause, and not to go on since.
            held: the reasons why conditions hold the campaign, a sentence each; empty if none does.
            by: who has asked for the pause; empty if nobody has.
        """

    def campaign_ends(self, exit_code: int, reason: str) -> None:
        """Handle the end of the campaign.

        Args:
            exit_code: exit code of the run.
            reason: what stopped the campaign; empty if it ran to its end.
        """

    def rig_tells(self, text: str) -> None:
        """Handle a line that the operator of the rig should read; called from any thread."""

    def test_begins(self, number: int, test: CampaignTest) -> None:
        """Handle the begin of a test, the `number`-th in running order, counted from 1."""

    def test_runs(self, channels: tuple[str, ...], segment: int | None) -> None:
        """Handle the names of the columns of a test's rows, before the first row comes.

        Args:
            channels: names of the columns.
            segment: number of the loop's segment on hardware, None on a simulated rig.
        """

    def test_rows(self, rows: Array) -> None:
        """Handle the next rows of a test, float64 (n, channels)."""

    def test_event(self, time_s: float, kind: str, text: str) -> None:
        """Handle an event that is written to a test's recording.

        Args:
            time_s: time of the event, s of the test.
            kind: one word for what happened, such as `verdict`.
            text: the rest, for a reader.
        """

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        """Handle the progress of a test, after each batch of rows.

        Args:
            time_s: time of the last row, s of the test.
            decision: the detector's latest decision; None before the first one.
        """

    def test_ends(self, outcome: TestOutcome) -> None:
        """Handle the end of a test that was begun, however it ended."""

    def test_skipped(self, outcome: TestOutcome) -> None:
        """Handle a test that is not begun because an operator has asked to skip it."""
