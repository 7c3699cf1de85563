"""These classes show a running campaign: live bars on a terminal, one line per test in a log."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Self

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.table import Column
from rich.text import Text

from estimator.leaks import Decision
from faults import Campaign, CampaignTest
from rig.cli.screen import Screen
from rig.runner import Observer, Status, TestOutcome
from rig.runner.outcomes import chance

STYLES: Final = {
    Status.PASSED: "green",
    Status.FAILED: "red",
    Status.ERROR: "bold red",
    Status.ABORTED: "yellow",
    Status.TRIPPED: "bold red",
    Status.SKIPPED: "dim",
    Status.INTERRUPTED: "yellow",
    Status.NOT_RUN: "dim",
}


class CampaignProgress(Observer):
    """An observer that writes one line per test, when the test ends.

    On a terminal, a bar with the live verdict is shown in the line's place until then. The observer
    is a context manager, which removes the bar and releases the terminal at its end.

    Args:
        screen: where the lines are written.
        paced: whether tests run at the wall clock; a log then also has a line when a test begins.
    """

    def __init__(self, screen: Screen, *, paced: bool) -> None:
        self._screen = screen
        self._paced = paced
        self._bars = Progress(
            TextColumn("{task.description}", table_column=Column(no_wrap=True), markup=False),
            BarColumn(bar_width=30),
            _RigTime(),
            TextColumn("{task.fields[verdict]}", markup=False),
            console=screen,
            disable=not screen.is_terminal,
            transient=True,
        )
        self._bar: TaskID | None = None
        self._count = 0
        self._number = 0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def campaign_begins(
        self, campaign: Campaign, directory: Path, finished: Sequence[TestOutcome]
    ) -> None:
        """Write which campaign is going to be run, and how many of its tests are finished."""
        self._count = len(campaign.tests)
        minutes, seconds = divmod(round(campaign.rig_time_s), 60)
        self._screen.print(
            f"{campaign.name}: {self._count} tests, {minutes} min {seconds} s of rig time, "
            f"on the rig {campaign.rig_name}, judged by {campaign.filter_name}"
        )
        if finished:
            done = f"{len(finished)} of them {'is' if len(finished) == 1 else 'are'}"
            self._screen.print(f"{done} finished, and not run again")

    def rig_tells(self, text: str) -> None:
        """Write a text that the rig reports."""
        self._screen.print(text, soft_wrap=True)

    def test_begins(self, number: int, test: CampaignTest) -> None:
        """Start the test's bar; in a log of a paced run, write that the test has begun."""
        self._number = number
        if self._screen.is_terminal:
            self._bar = self._bars.add_task(
                f"{self._place} {test.name}", total=test.duration_s, verdict="preparing"
            )
        elif self._paced:
            self._screen.print(f"{self._place} {test.name}: begun")

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        """Move the test's bar to the time in s, with the verdict so far."""
        if self._bar is not None:
            verdict = f"{decision.verdict} {chance(decision)}" if decision else ""
            self._bars.update(self._bar, completed=time_s, verdict=verdict)

    def test_ends(self, outcome: TestOutcome) -> None:
        """Write the test's line in place of its bar."""
        if self._bar is not None:
            self._bars.remove_task(self._bar)
            self._bar = None
        line = Text.assemble(
            f"{self._place} {outcome.name}: ",
            (str(outcome.status), STYLES[outcome.status]),
            f", {outcome.decision.verdict}" if outcome.decision else "",
            f" after {outcome.recorded_s:g} s",
            f"; {outcome.message}" if outcome.message else "",
        )
        self._screen.print(line)

    def test_skipped(self, outcome: TestOutcome) -> None:
        """Write that a test is not run."""
        self._screen.print(f"{outcome.name}: {outcome.status}; {outcome.message}")

    @property
    def _place(self) -> str:
        width = len(str(self._count))
        return f"[{self._number:{width}}/{self._count}]"


class MotionProgress(CampaignProgress):
    """An observer that writes one line per motion, without a verdict on leaks."""

    def test_ends(self, outcome: TestOutcome) -> None:
        """Write the motion's line."""
        super().test_ends(replace(outcome, decision=None))


class _RigTime(ProgressColumn):
    """A column that shows the seconds of rig time that are done, and how many there are in all."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.completed:6.1f} of {task.total or 0.0:g} s")
