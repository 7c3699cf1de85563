"""Where the tests of a campaign are run: a simulated rig, or a session with a real one."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FilterMemory
from faults import CampaignTest
from rig.plant import Model

Array = NDArray[np.float64]


class Loop(Protocol):
    """One test on the rig, advanced batch by batch.

    Attributes:
        channels: names of the rows' columns, the first `time_s`.
    """

    channels: tuple[str, ...]

    @property
    def ticks_left(self) -> int:
        """Ticks of the test that are still to run."""

    def position(self) -> None:
        """Bring the ram to its start, and wait until it has settled.

        Raises:
            TripError: the rig tripped.
        """

    def inject(self) -> None:
        """Get the valves that make the test's faults ready, and schedule its faults.

        Raises:
            TripError: the rig tripped.
        """

    def advance(self, ticks: int) -> Array:
        """Return the rows of the next `ticks` ticks, float64 (n, columns); fewer at the end.

        Raises:
            TripError: the rig tripped before any more rows came.
        """

    def decided(self, row: Array) -> None:
        """Take a decision on the rows so far, a row of `rig.loop.decided.DECIDED`.

        Rows that the loop writes from then on carry it. Nobody waits.
        """

    def end_early(self) -> None:
        """Have `safe_state` leave the rig ready for the next test, as at the end of a test."""

    def safe_state(self) -> None:
        """End the test, wherever it is: every injected fault away, and no motion."""


class Writer(Protocol):
    """What keeps the rows and events of a test in its recording."""

    def write(self, rows: Array) -> None:
        """Take rows, unless they reach the disk by themselves."""

    def event(self, time_s: float, kind: str, text: str) -> None:
        """Note something that happened at a time of the test."""


@runtime_checkable
class Timed(Protocol):
    """A writer that knows how well the loop kept its time."""

    def timing(self) -> Mapping[str, Any]:
        """Return `rig.loop.timing.Timing.summary` of all rows so far."""


class Bench(Protocol):
    """A rig that tests can be run on; a context manager that leaves it safe.

    Attributes:
        live: whether time passes by itself: rows come at the wall clock, and waiting is no help.
    """

    live: bool

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> Loop:
        """Return the loop of a test, before the ram is brought to its start."""

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> AbstractContextManager[Writer]:
        """Return what records a test, to a new file, once it is entered."""

    def reading(self, channel: str) -> float | None:
        """Return the newest value of a channel, NaN if it has none; None if it cannot be known."""

    def idle(self) -> None:
        """Look after the rig while it waits between two tests; called every 50 ms or so.

        Raises:
            TripError: the rig tripped.
            StopRequestedError: somebody asked for an end.
        """

    def __enter__(self) -> "Bench":
        """Get the rig ready for its first test."""

    def __exit__(self, *_: object) -> None:
        """Leave the rig safe."""
