"""Shows a campaign: bars or lines while it runs, then the table of verdicts and a summary."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final, Self

from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.table import Column
from rich.text import Text

from estimator.leaks import Decision
from faults import Campaign, CampaignTest, size_shown, to_litres_per_minute
from rig.cli.screen import Screen
from rig.runner import CampaignOutcome, InjectedFault, Observer, Status, TestOutcome
from rig.runner.leak_test import leak_test_lines
from rig.runner.outcomes import chance, in_passing, onset_shown, reaction

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
HEADINGS: Final = ("test", "injected", "found", "onset", "latency", "result")


class CampaignProgress(Observer):
    """An observer that writes one line per test, when the test ends.

    On a terminal, a bar with the live verdict is shown in the line's place until then. The observer
    is a context manager, which removes the bar and releases the terminal at its end.

    Args:
        screen: where the lines are written.
        paced: whether tests run at the wall clock; if so, and if the screen is no terminal, a line
            is also written when a test begins.
    """

    def __init__(self, screen: Screen, *, paced: bool) -> None:
        self._screen = screen
        self._paced = paced
        self._bars = Progress(
            TextColumn("{task.description}", table_column=Column(no_wrap=True), markup=False),
            BarColumn(bar_width=30),
            TextColumn("{task.completed:6.1f} of {task.total:g} s"),
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
        self,
        campaign: Campaign,
        directory: Path,
        finished: Sequence[TestOutcome],
        started: datetime,
        *,
        resumed: bool,
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
        """Start the test's bar; without a terminal, write that a test of a paced run has begun."""
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


def cells_of(test: TestOutcome) -> tuple[str | Text, ...]:
    """Return the cells of a test's row in the table of verdicts, under `HEADINGS`."""
    decision = test.decision
    passing = [] if decision is None else in_passing(decision, test.found)
    if test.leak_test is not None:
        passing += leak_test_lines(test.leak_test)
    onset_s = onset_shown(decision)
    ended = test.status.value.replace("_", " ")
    if test.status == Status.FAILED and (decision is None or decision.verdict != test.expect):
        ended += f", expected {test.expect}"
    ended += "".join(f", not met: {each}" for each in test.missed)
    done = reaction(test)
    return (
        test.name,
        "\n".join(injected(fault) for fault in test.injected) or "-",
        "\n".join((found(decision), *passing)),
        "" if onset_s is None else f"{onset_s:.2f} s",
        "" if test.latency_s is None else f"{test.latency_s:.1f} s",
        Text(f"{ended}, {done}" if done else ended, STYLES[test.status]),
    )


def injected(fault: InjectedFault) -> str:
    """Return an injected fault in words: kind, size, and when it began, in s.

    The size is the mean flow in L/min; if that is not known, what was asked for.
    """
    if fault.mean_flow_m3_per_s is None:
        size = size_shown(fault.kind, fault.coefficient, linear=fault.linear)
    else:
        size = f"{to_litres_per_minute(fault.mean_flow_m3_per_s):.3f} L/min"
    return f"{fault.kind} {size} at {fault.at_s:g} s"


def found(decision: Decision | None) -> str:
    """Return a decision in words: verdict, probability, and mean flow with its 95 % interval.

    Return "-" if there is no decision.
    """
    if decision is None:
        return "-"
    parts = (str(decision.verdict), chance(decision), leak(decision))
    return " ".join(part for part in parts if part)


def leak(decision: Decision) -> str:
    """Return a decision's mean leak flow and 95 % interval in L/min; "" if it has no flow."""
    if decision.leak_m3_per_s is None:
        return ""
    flow = f"{to_litres_per_minute(decision.leak_m3_per_s):.3f}"
    interval = decision.interval_m3_per_s
    if interval is None:
        return f"{flow} L/min"
    # The lower end is cut off at zero flow, so the half width is taken from the upper end.
    half = to_litres_per_minute(interval[1] - decision.leak_m3_per_s)
    return f"{flow} ± {half:.3f} L/min"


def summary(outcome: CampaignOutcome, wall_s: float, *, live: bool) -> Iterator[str]:
    """Yield the lines below the table: tests that crashed, numbers by status, rig time and speed.

    The speed is left out for a run at the wall clock (`live`), where it is always the same.
    """
    for test in outcome.tests:
        if test.status == Status.ERROR:
            yield f"{test.name}: {test.message}"
    counts = ", ".join(f"{count} {status.value}" for status, count in outcome.counts.items())
    yield f"{len(outcome.tests)} tests: {counts}".replace("_", " ")
    recorded_s = sum(test.recorded_s for test in outcome.tests)
    took = f"{recorded_s:.0f} s of rig time in {wall_s:.1f} s"
    rate = recorded_s / wall_s
    # A run in which code is compiled takes longer than the time of its rig.
    shown = f"{rate:.0f}" if rate >= 10.0 else f"{rate:.2g}"
    yield took if live else f"{took}: {shown} rig-seconds per second"
