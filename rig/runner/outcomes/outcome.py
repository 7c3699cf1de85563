"""What came of a campaign: one outcome a test, and the whole, as written to `results.json`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

from estimator.friction import FrictionCurve
from estimator.leaks import Decision, Found
from faults import OnFault
from rig.plant import LEAKS

from .figures import Figure
from .reactions import FaultAction


class Status(StrEnum):
    """How a test ended."""

    PASSED = "passed"
    FAILED = "failed"
    ERROR = "error"
    ABORTED = "aborted"
    TRIPPED = "tripped"
    SKIPPED = "skipped"
    """An operator had it left out, or ended."""
    INTERRUPTED = "interrupted"
    """A kill, a condition or an operator ended it; it is to be run again."""
    NOT_RUN = "not_run"


@dataclass(frozen=True)
class InjectedFault:
    """A fault as it was injected: what was asked of the rig, and the flow it really gave.

    Attributes:
        kind: one of the fault kinds.
        at_s, until_s: when it acted.
        coefficient: what was asked, SI (m^3/(s Pa^0.5), linear leaks m^3/(s Pa), return blockage
            Pa/(m^3/s)^2).
        linear: whether the coefficient is of the linear leak law.
        mean_flow_m3_per_s: mean absolute flow recorded from 2 s after onset to the leak's end, or
            the test's, less what a flow meter read before; None where the rig records none (supply
            and return line).
    """

    kind: str
    at_s: float
    until_s: float | None
    coefficient: float
    linear: bool
    mean_flow_m3_per_s: float | None


@dataclass(frozen=True)
class Attempt:
    """An earlier run of a test, that does not count.

    Attributes:
        number: from 1 on.
        status: how it ended.
        phase: in which it ended, a `rig.runner.campaign.phases.Phase`; empty where it came to its
            end.
        message: why.
        at: when it was begun, UTC.
        recording: file name of what was recorded of it, if anything was.
    """

    number: int
    status: Status
    phase: str
    message: str
    at: str
    recording: str | None = None


@dataclass(frozen=True)
class Happening:
    """What happened to a campaign beside its tests: to a report's reader.

    Attributes:
        at: when, UTC.
        who: an operator, or `campaign`.
        what: a sentence.
    """

    at: str
    who: str
    what: str


@dataclass(frozen=True)
class TestOutcome:
    """One test: what was expected, injected and found.

    Attributes:
        duration_s: how long the test was to last.
        recorded_s: how long it lasted; less than `duration_s` if it did not come to its end.
        injected: the faults that had begun by then.
        decision: what the detector held in the end; None before its first sample.
        detected_at_s: when it first held that, having read only the past; None if that is no fault.
        recording: file name of the recording beside `results.json`, if there is one.
        on_fault: what was asked to be done about a confirmed fault.
        actions: what the loop did about one; a trip is the status.
        thresholds_from: what the thresholds were learnt from, where the detector has to learn them.
        friction: what the motion showed of it; None without a filter that estimates the load.
        attempts: earlier runs of it that do not count.
        figures: to follow from run to run (`rig.runner.outcomes.figures`).
        found: all faults that were named on the way, those that went again among them.
    """

    __test__ = False  # not a pytest class, whatever its name

    name: str
    expect: str
    status: Status
    seed: int
    duration_s: float
    injected: tuple[InjectedFault, ...] = ()
    decision: Decision | None = None
    detected_at_s: float | None = None
    recording: str | None = None
    message: str = ""
    wall_s: float = 0.0
    recorded_s: float = 0.0
    thresholds_from: str = ""
    on_fault: OnFault = OnFault.IGNORE
    actions: tuple[FaultAction, ...] = ()
    friction: FrictionCurve | None = None
    attempts: tuple[Attempt, ...] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    found: tuple[Found, ...] = ()

    @property
    def is_finished(self) -> bool:
        """Whether it is not to be run again when its campaign is resumed.

        A test that asks to trip on a fault did what it was to do.
        """
        if self.status is Status.TRIPPED:
            return self.on_fault is OnFault.TRIP
        return self.status in (Status.PASSED, Status.FAILED, Status.ERROR, Status.SKIPPED)

    @property
    def truth(self) -> InjectedFault | None:
        """The injected leak that was expected to be found; None if none was, or it is no leak."""
        if self.expect not in LEAKS:
            return None
        return next((fault for fault in self.injected if fault.kind == self.expect), None)

    @property
    def onset_error_s(self) -> float | None:
        """Onset found less onset injected; None unless the expected leak was found."""
        found = self._found
        if found is None or found.onset_s is None or self.truth is None:
            return None
        return found.onset_s - self.truth.at_s

    @property
    def leak_error_m3_per_s(self) -> float | None:
        """Mean leak flow found less that recorded; None unless the expected leak was found."""
        found, truth = self._found, self.truth
        if found is None or truth is None:
            return None
        if found.leak_m3_per_s is None or truth.mean_flow_m3_per_s is None:
            return None
        return found.leak_m3_per_s - truth.mean_flow_m3_per_s

    @property
    def latency_s(self) -> float | None:
        """Time from the first injection to the verdict; None if nothing was injected or found."""
        if self.detected_at_s is None or not self.injected:
            return None
        return self.detected_at_s - min(fault.at_s for fault in self.injected)

    @property
    def _found(self) -> Decision | None:
        found = self.decision is not None and self.decision.verdict == self.expect
        return self.decision if found else None


EXIT_PASSED: Final = 0
EXIT_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_STOPPED: Final = 3


@dataclass(frozen=True)
class CampaignOutcome:
    """A campaign's outcomes with what is needed to run it again."""

    name: str
    description: str
    rig: str
    model: str
    filter: str
    false_alarms_per_day: float
    started: str
    tests: tuple[TestOutcome, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Versions, git state, hashes of every file read."""
    history: tuple[Happening, ...] = ()
    """What happened beside the tests: holds, interruptions, what operators asked and noted."""
    ended_with: int | None = None
    """Exit code of what ended it outside of its tests, such as a trip; None if nothing did."""

    @property
    def exit_code(self) -> int:
        """0 all as expected, 1 a test failed, crashed or was skipped, 3 tripped or stopped.

        2 where a device of the rig was not there, or not what was configured: nothing moved.
        """
        if self.ended_with is not None:
            return self.ended_with
        statuses = {test.status for test in self.tests}
        if statuses & {Status.ABORTED, Status.TRIPPED, Status.INTERRUPTED, Status.NOT_RUN}:
            return EXIT_STOPPED
        if statuses & {Status.FAILED, Status.ERROR, Status.SKIPPED}:
            return EXIT_FAILED
        return EXIT_PASSED

    @property
    def counts(self) -> dict[Status, int]:
        """How many tests ended in which way, those that occur only."""
        found = [test.status for test in self.tests]
        return {status: found.count(status) for status in Status if status in found}
