"""What the tests of a campaign share while they run, and the phases that each goes through."""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from estimator.evidence import KeptAccounts
from estimator.leaks import DetectorFactory
from faults import Campaign
from rig.configuration import Rig
from rig.runner.counters import RigCounter
from rig.runner.outcomes import HealthyReferences, Observer
from rig.runner.run_folder import FolderKeeper
from rig.surviving import start

from .bench import Bench
from .operator_requests import Desk
from .pacing import Pacer
from .stopping import StopFlag
from .suspending import Suspenders

TELLING_S: Final = 10.0
"""Longest time in s for journal and trip report to tell of a cleanup that takes too long."""


class Phase(StrEnum):
    """The phase that a test is in."""

    SETUP = "setup"
    """The runner makes the detector, the filter and the loop."""
    POSITIONING = "positioning"
    """The ram moves to its start position and comes to rest there."""
    SETTLE = "settle"
    """If the run is paced, the runner waits for the rest of the settling time."""
    INJECT = "inject"
    """The bypass valves move to their first positions, and the faults are scheduled."""
    MAIN = "main"
    """The test's motion runs, and is recorded and judged."""
    CLEANUP = "cleanup"
    """All faults are removed, the ram is stopped or held, and the recording is closed."""


@dataclass(kw_only=True)
class Setting:
    """The objects that all tests of one campaign share while they run.

    Attributes:
        bench: the bench that the tests are run on; its context is entered before the first test.
        keeper: has the folder of the run, for recordings and tracebacks.
        counter: counts what the rig does.
        detector: makes the detector of each test, in place of the filter's own; None for the own.
        desk: takes the operators' requests.
        suspenders: the conditions that may hold the campaign.
        overdue: is called from another thread if cleaning up takes too long.
        kept: keeps the oil accounts of the tests for the report; None if they are not kept.
        present: index of the present test, or of the last one.
        phase: the phase of this test; None before the first test.
    """

    campaign: Campaign
    rig: Rig
    bench: Bench
    keeper: FolderKeeper
    pacer: Pacer
    observer: Observer
    stop: StopFlag
    references: HealthyReferences
    provenance: Mapping[str, Any]
    desk: Desk
    suspenders: Suspenders
    overdue: Callable[[], None]
    counter: RigCounter
    detector: DetectorFactory | None = None
    kept: KeptAccounts | None = None

    present: int = 0
    phase: Phase | None = None

    def cleans_up_too_long(self) -> None:
        """Tell journal and bench that cleaning up takes too long, and call `overdue`.

        What hangs may be the disk, so this waits for `TELLING_S` at most until they have noted it.
        """
        telling = [
            threading.Thread(target=tell, name="overdue", daemon=True)
            for tell in (self._bench_is_overdue, self._journal_is_overdue)
        ]
        until = time.monotonic() + TELLING_S
        try:
            for thread in telling:
                start(thread)
            for thread in telling:
                thread.join(max(0.0, until - time.monotonic()))
        finally:
            self.overdue()

    # Nothing that goes wrong in these two may keep the process from its end.
    def _bench_is_overdue(self) -> None:
        with suppress(Exception):
            self.bench.is_overdue()

    def _journal_is_overdue(self) -> None:
        with suppress(Exception):
            self.desk.record("overdue")

    def enters(self, phase: Phase, recording: str | None = None) -> None:
        """Note that the present test enters a phase, and tell this to the desk and the journal.

        Nothing happens if the test is in the phase already.

        Args:
            phase: the phase.
            recording: file name of the test's recording in the phase `MAIN`, None in other phases.
        """
        if phase is self.phase:
            return
        self.phase = phase
        more = {"recording": recording} if recording else {}
        self.desk.enters(phase)
        self.desk.record("phase", test=self.present, phase=phase, durable=False, **more)
