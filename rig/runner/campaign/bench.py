"""Defines what runs the tests of a campaign: a simulated rig, or a session with a real one.

It also makes the plainest of tests, in which a ram only moves.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NoReturn, Protocol, runtime_checkable

from control import ControlSettings, Setpoint
from estimator.filters import FilterMemory
from faults import CampaignTest, Verdict
from rig.loop import Action, RungPassed
from rig.plant import Model
from rig.runner.leak_test import Lockable
from rig.runner.outcomes import Array


class Loop(Protocol):
    """One test on the rig, advanced batch by batch.

    Attributes:
        channels: names of the rows' columns; the first is `time_s`.
    """

    channels: tuple[str, ...]

    @property
    def ticks_left(self) -> int:
        """Number of the test's ticks that have not been run yet."""

    def position(self) -> None:
        """Move the ram to the test's start position, and wait until it has settled there.

        Raises:
            TripError: the rig tripped.
        """

    def inject(self) -> None:
        """Move the bypass valves to their first positions, and schedule the test's faults.

        Raises:
            TripError: the rig tripped.
        """

    def advance(self, ticks: int) -> Array:
        """Run the next `ticks` ticks, or all that are left, and return their rows.

        The rows are float64 of shape (n, columns), in SI units.

        Raises:
            TripError: the rig tripped, and no further rows came.
        """

    def change(self, control: ControlSettings) -> float | None:
        """Give the running test another control, without a bump in the command.

        Return the time of the test in s from which it holds; None if the loop has stopped the
        motion, which the next `advance` tells.

        Args:
            control: the control settings, in which the gain is given.

        Raises:
            TripError: the loop did not take the change.
        """

    def decided(self, row: Array) -> None:
        """Give the loop the detector's decision on the rows so far, without waiting for the loop.

        All rows that the loop writes afterwards carry this decision.

        Args:
            row: the decision as a row of `rig.loop.decided.DECIDED`.
        """

    def passed(self) -> list[RungPassed]:
        """Return the limits that the loop itself found passed in the test since the last call."""

    def skip_to(self, place: int, blend_ticks: int) -> int | None:
        """Go on at a later place of the test's setpoints, as they were laid out.

        Args:
            place: index of that setpoint; the number of setpoints to end the test.
            blend_ticks: number of ticks in which the setpoint goes over to those from there on.

        Returns:
            The tick of the test at which it goes on there; None if it was there already.

        Raises:
            TripError: the rig tripped.
        """

    def limited(self, action: Action, text: str) -> NoReturn:
        """Carry out the action, a hold or worse, of a limit that the loop itself does not judge.

        Args:
            action: the action.
            text: limit, value and time in words.

        Raises:
            TripError: always.
        """

    def alive(self) -> None:
        """Show that the runner works, while it computes something that takes seconds."""

    def end_early(self) -> None:
        """Note that the test is ended early but the campaign goes on.

        `safe_state` then leaves the rig ready for the next test, as after a completed test.
        """

    def safe_state(self) -> None:
        """End the test at whatever point it is: remove all injected faults and stop the motion."""


class Writer(Protocol):
    """A writer of the rows and events of one test to its recording."""

    def write(self, rows: Array) -> None:
        """Take the test's next rows and write them to the recording.

        On hardware they are only counted here: another process writes them.
        """

    def event(self, time_s: float, kind: str, text: str) -> None:
        """Write an event to the recording.

        Args:
            time_s: when it happened, in s of the test.
            kind: one word for what happened, such as `verdict`.
            text: the rest, for a reader.
        """


@runtime_checkable
class Timed(Protocol):
    """A writer that also measures how well the loop kept its time."""

    def timing(self) -> Mapping[str, Any]:
        """Return the statistics of all rows so far, as `rig.loop.timing.Timing.summary` does."""


class Bench(Protocol):
    """A rig that tests can be run on.

    It is a context manager: entering it makes the rig ready, leaving it makes the rig safe.

    Attributes:
        live: whether the rig runs at the pace of the wall clock by itself, as hardware does, so
            that the runner need not wait between batches.
    """

    live: bool

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> Loop:
        """Return the loop of a test, before the ram has moved to its start position.

        Args:
            test: the test.
            memory: the filter's memory before its first sample.
            assumed: the model that filter and interlock assume.
        """

    def lockable(self, test: CampaignTest) -> Lockable:
        """Return the rig for a test that locks the cylinder, with its ram at rest at mid stroke.

        Raises:
            TripError: the rig tripped on the way there.
            StopRequestedError: a stop of the campaign was requested.
        """

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> AbstractContextManager[Writer]:
        """Return a context manager that records a test to the new file `path` while it is entered.

        Args:
            path: path of the new recording.
            channels: names of the rows' columns.
            metadata: metadata of the recording.
        """

    def reading(self, channel: str) -> float | None:
        """Return the newest value of a channel, in the channel's unit.

        The value is NaN if the channel has no reading, and None if there is no rig to be read at
        present, as between two simulated tests.
        """

    def idle(self) -> None:
        """Check the rig while it waits between two tests; the runner calls this every 50 ms or so.

        Raises:
            TripError: the rig tripped.
            StopRequestedError: a stop of the campaign was requested.
        """

    def is_overdue(self) -> None:
        """Make the rig safe and report why, from another thread, as the process is about to end.

        The runner calls this when cleaning up after a test hangs.
        """

    def __enter__(self) -> "Bench":
        """Make the rig ready for its first test."""

    def __exit__(self, *_: object) -> None:
        """Bring the rig to its safe state."""


def plain_test(
    name: str, setpoint: Setpoint, duration_s: float, start: float, settle_s: float, seed: int = 0
) -> CampaignTest:
    """Return a test without load and faults, of which no verdict is expected.

    Args:
        name: name of the test.
        setpoint: setpoint of the test, a position in m or a command in V.
        duration_s: duration of the test, s.
        start: position at which the ram settles before the test, m.
        settle_s: how long the ram settles there, s.
        seed: sets the noise of a simulated rig.
    """
    return CampaignTest(
        name=name,
        test_name=name,
        duration_s=duration_s,
        start_position_m=start,
        settle_s=settle_s,
        setpoint=setpoint,
        load=None,
        faults=(),
        expect=Verdict.INCONCLUSIVE,
        repeat=1,
        seed=seed,
    )
