"""Defines the outcome of a test and of a campaign, as they are written to `results.json`."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from estimator.friction import FrictionCurve
from estimator.leaks import Decision, Found
from faults import OnFault
from rig.plant import LEAKS
from rig.runner.counters import Counted
from rig.runner.leak_test import LeakTest

from .calibrations import CalibrationUsed
from .figures import Figure
from .limits import LimitNotJudged, LimitPassed
from .measures import CriterionResult
from .reactions import FaultAction
from .segments import SegmentRun


class Status(StrEnum):
    """How a test ended; PASSED and FAILED say whether verdict and figures were as expected.

    ERROR is a crash, ABORTED a stop, TRIPPED a trip; NOT_RUN is a test without an outcome so far.
    """

    PASSED = "passed"
    FAILED = "failed"
    ERROR = "error"
    ABORTED = "aborted"
    TRIPPED = "tripped"
    SKIPPED = "skipped"
    """An operator had the test left out, or ended."""
    INTERRUPTED = "interrupted"
    """A kill, a condition or an operator ended the test; it will be run again."""
    NOT_RUN = "not_run"


@dataclass(frozen=True)
class InjectedFault:
    """A fault that was injected into a test, as it was requested, and the flow that resulted.

    Attributes:
        kind: name of the kind of fault, such as `external_leakage_1`.
        at_s, until_s: begin and end, s of the test; `until_s` is None if it lasted to the end.
        coefficient: the requested size, SI (m^3/(s Pa^0.5), linear leaks m^3/(s Pa), return
            blockage Pa/(m^3/s)^2).
        linear: whether the coefficient belongs to the linear leak law.
        mean_flow_m3_per_s: mean absolute flow recorded from 2 s after the onset to the end of the
            leak or of the test: on a simulated rig the true flow, on hardware the flow meter's
            reading, less its mean before the onset if the bypass was shut for 1 s or longer then;
            None if no flow of this fault is recorded (supply and return line).
    """

    kind: str
    at_s: float
    until_s: float | None
    coefficient: float
    linear: bool
    mean_flow_m3_per_s: float | None


@dataclass(frozen=True)
class Attempt:
    """An earlier run of a test, which does not count because the test was run again.

    Attributes:
        number: number of the attempt, counted from 1.
        status: how the attempt ended.
        phase: the phase in which it ended, as `Phase` in `rig.runner.campaign.setting`;
            empty if it ran to its end.
        message: why it ended.
        at: when it was begun, UTC, ISO 8601.
        recording: file name of its recording; None if there is none.
    """

    number: int
    status: Status
    phase: str
    message: str
    at: str
    recording: str | None = None


@dataclass(frozen=True)
class Happening:
    """Something that happened in a campaign outside its tests, as a report shows it.

    Attributes:
        at: when it happened, UTC, ISO 8601.
        who: name of the operator who asked for it; `campaign` if no operator did.
        what: what happened, in words.
    """

    at: str
    who: str
    what: str


@dataclass(frozen=True)
class ControlChanged:
    """A change of the control of a test that an operator had made while it ran.

    Attributes:
        at_s: time of the test from which it held, s.
        who: name of the operator.
        what: the keys that changed, each with the value before and after, in words.
    """

    at_s: float
    who: str
    what: str

    def __str__(self) -> str:
        """Return it in words: "from 12.345 s by anna: gain 50 V/m -> 80 V/m"."""
        return f"from {self.at_s:.3f} s by {self.who}: {self.what}"


@dataclass(frozen=True)
class TestOutcome:
    """The outcome of one test: what was expected, what was injected, and what was found.

    Attributes:
        expect: the expected verdict.
        message: why the test did not run to its end; empty if it did.
        duration_s: how long the test was to last.
        recorded_s: how long it lasted; less than `duration_s` if it was ended early.
        injected: the faults that had begun by the end of the recording.
        decision: the detector's last decision; None if it made none.
        detected_at_s: when the detector first had this verdict, in s of the test; None if the
            verdict names no fault.
        recording: file name of the recording beside `results.json`; None if there is none.
        wall_s: how long running the test took, s.
        on_fault: what the loop was to do about a confirmed fault.
        actions: what the loop did about confirmed faults; a trip is in `status` instead.
        thresholds_from: in words, what the detector's thresholds were learnt from; empty if it
            learns none.
        friction: the friction identified from the motion; None if the filter does not estimate the
            load.
        attempts: earlier runs of the test, which do not count.
        figures: the figures to follow from run to run, by name (`rig.runner.outcomes.figures`).
        found: all faults that the verdicts named during the test, also those that ended again.
        counted: what the ram did; None if no sample came.
        limits: the limits that were passed, the test's own and those of the rig.
        criteria: what came of the criteria by which the test passes beside its verdict.
        segments: the segments that were begun, with the times at which they took place.
        control_changes: changes of the control by operators while the test ran.
        limits_not_judged: the test's limits that were not judged, each with the reason.
        leak_test: what came of a test that locked the cylinder; None of a test with a motion, or if
            nothing came of it.
        fault_tripped: whether a confirmed fault tripped the rig, as `on_fault` asks; None in the
            journal of an earlier version, which does not tell.
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
    criteria: tuple[CriterionResult, ...] = ()
    limits: tuple[LimitPassed, ...] = ()
    counted: Counted | None = None
    segments: tuple[SegmentRun, ...] = ()
    control_changes: tuple[ControlChanged, ...] = ()
    limits_not_judged: tuple[LimitNotJudged, ...] = ()
    fault_tripped: bool | None = None
    leak_test: LeakTest | None = None

    @property
    def missed(self) -> tuple[CriterionResult, ...]:
        """The criteria that the test does not meet."""
        return tuple(each for each in self.criteria if not each.met)

    @property
    def is_finished(self) -> bool:
        """Whether the test counts, so that it is not run again when its campaign is resumed.

        It counts if it passed, failed, crashed or was skipped; a tripped test counts only if it was
        configured to trip on a fault, and a fault tripped it.
        """
        if self.status is Status.TRIPPED:
            return self.on_fault is OnFault.TRIP and self.fault_tripped is not False
        return self.status in (Status.PASSED, Status.FAILED, Status.ERROR, Status.SKIPPED)

    @property
    def truth(self) -> InjectedFault | None:
        """The first injected leak of the expected kind; None if there is none, or none expected.

        If it went on with other sizes, it is all of them together: from the first begin to the last
        end, with the mean flow over all that time and the coefficient of the last.
        """
        if self.expect not in LEAKS:
            return None
        found: InjectedFault | None = None
        for fault in self.injected:
            if fault.kind != self.expect:
                continue
            if found is None:
                found = fault
            elif found.until_s == fault.at_s:
                found = self._together(found, fault)
            else:
                break
        return found

    def _together(self, first: InjectedFault, second: InjectedFault) -> InjectedFault:
        flows = first.mean_flow_m3_per_s, second.mean_flow_m3_per_s
        end_s = self.recorded_s if second.until_s is None else min(second.until_s, self.recorded_s)
        lasted = second.at_s - first.at_s, max(end_s - second.at_s, 0.0)
        known = [(f, t) for f, t in zip(flows, lasted, strict=True) if f is not None and t > 0.0]
        total = sum(t for _, t in known)
        mean = sum(f * t for f, t in known) / total if total else first.mean_flow_m3_per_s
        return replace(second, at_s=first.at_s, mean_flow_m3_per_s=mean)

    @property
    def onset_error_s(self) -> float | None:
        """Estimated onset less injected onset, s; None unless the expected leak was found."""
        found = self._found
        if found is None or found.onset_s is None or self.truth is None:
            return None
        return found.onset_s - self.truth.at_s

    @property
    def leak_error_m3_per_s(self) -> float | None:
        """Estimated less recorded mean leak flow, m^3/s; None unless the expected leak was found.

        It is also None if the rig does not record the leak's flow.
        """
        found = None if self._found is None else self._found.leak_m3_per_s
        recorded = None if self.truth is None else self.truth.mean_flow_m3_per_s
        return None if found is None or recorded is None else found - recorded

    @property
    def latency_s(self) -> float | None:
        """Time from the first injected fault to the first decision with the last verdict, s.

        It is negative if that decision came before the fault, and None if nothing was injected or
        if the last verdict names no fault.
        """
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
    """The outcomes of a campaign's tests, and the facts that are needed to run it again.

    Attributes:
        started: when the run began, UTC, ISO 8601; empty before.
        tests: one outcome for each test, in the campaign's order.
    """

    name: str
    description: str
    rig: str
    model: str
    filter: str
    false_alarms_per_day: float
    started: str
    tests: tuple[TestOutcome, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Versions of the software, git state, and hashes of all files that were read."""
    history: tuple[Happening, ...] = ()
    """What happened outside the tests: holds, interruptions, requests and notes of operators."""
    ended_with: int | None = None
    """Exit code of an event that ended the run outside its tests, such as a trip; None if none."""
    calibrations: tuple[CalibrationUsed, ...] = ()
    """The calibrations of transducers by which readings were corrected."""
    uncalibrated: tuple[str, ...] = ()
    """The measured channels without calibration; () if no channel has one."""
    kept_in: Path | None = None
    """Folder to which the run's files were saved as its own was removed; None if it was not."""

    @property
    def exit_code(self) -> int:
        """The exit code of `rig run`.

        It is 0 if all tests passed; 1 if a test failed, crashed or was skipped; 3, which takes
        precedence over 1, if the run tripped or was stopped, so that tests were not run; 2 if a
        device of the rig was missing or was not the configured one, so that nothing moved.
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
        """The number of tests with each status; a status that no test has is left out."""
        found = [test.status for test in self.tests]
        return {status: found.count(status) for status in Status if status in found}
