"""Runs one test of a campaign on a bench, records it, and judges it."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from estimator.filters import start_memory
from estimator.leaks import Detector, DetectorFactory, PatternDetector
from faults import Campaign, CampaignTest, FaultSchedule
from rig.configuration import Rig
from rig.loop import FULL, Cause, StopRequestedError, TripError, explain
from rig.plant import TICK
from rig.runner.outcomes import (
    DecisionRows,
    FrictionWatch,
    HealthyInnovations,
    HealthyReferences,
    Observer,
    Reactions,
    Status,
    TestOutcome,
    figures_of,
    metadata_of,
)
from rig.runner.run_folder import log_error

from .bench import Bench, Loop, Timed, Writer
from .injection import Injection
from .judging import Judge
from .operator_requests import Desk, Request
from .pacing import LIVE_TICKS, Pacer
from .phases import CLEANUP_S, Deadline, Phase
from .stopping import StopFlag
from .suspending import Suspenders


@dataclass
class Setting:
    """The objects that all tests of one campaign share while they run.

    Attributes:
        bench: the bench that the tests are run on; its context is entered before the first test.
        directory: folder of the run, for recordings and tracebacks.
        detector: makes the detector of each test, in place of the filter's own; None for the own.
        desk: takes the operators' requests.
        suspenders: the conditions that may hold the campaign.
        deadline: limits how long cleaning up after a test may take.
        enters: is called with each phase that a test enters, and the file name of its recording in
            the phase `MAIN`, None in the others.
    """

    campaign: Campaign
    rig: Rig
    bench: Bench
    directory: Path
    pacer: Pacer
    observer: Observer
    stop: StopFlag
    references: HealthyReferences
    provenance: Mapping[str, Any]
    desk: Desk
    suspenders: Suspenders
    detector: DetectorFactory | None = None
    deadline: Deadline = field(default_factory=lambda: Deadline(CLEANUP_S, lambda: None))
    enters: Callable[[Phase, str | None], None] = lambda phase, recording: None


class _InterruptedError(Exception):
    """Raised to end the present test, after which the campaign goes on.

    Attributes:
        status: the status that the test gets.
    """

    def __init__(self, status: Status, reason: str) -> None:
        self.status = status
        super().__init__(reason)


def run_test(setting: Setting, test: CampaignTest, recording: str) -> TestOutcome:
    """Run one test and return its outcome; leave the rig safe and the recording closed.

    A crash, a trip, a stop (also KeyboardInterrupt), and an end that an operator or a condition
    asked for are returned as outcomes. After a trip, KeyboardInterrupt or a full disk the
    campaign's stop is requested. Other exceptions that do not derive from `Exception`, such as
    SystemExit, are raised on.

    Args:
        setting: what the tests of the campaign share.
        test: the test.
        recording: file name of its recording.
    """
    started = time.perf_counter()
    running, status, message = None, Status.ERROR, ""
    try:
        running = _RunningTest(setting, test, recording)
        status = running.run()
    except _InterruptedError as error:
        status, message = error.status, str(error)
    except KeyboardInterrupt:
        setting.stop.request("KeyboardInterrupt")
        status = Status.ABORTED
    except StopRequestedError:
        status = Status.ABORTED
    except TripError as error:
        setting.stop.request("a trip")
        status, message = Status.TRIPPED, str(error)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            # On hardware the supervisor trips for a full disk: no further test could be recorded.
            setting.stop.request("a full disk")
            sentence, remedy = explain(Cause.DISK_FULL)
            status, message = Status.TRIPPED, f"{sentence}; {remedy}"
        else:
            where = log_error(setting.directory, f"test {test.name}")
            message = f"{type(error).__name__}: {error} (traceback in {where})"
    finally:
        setting.deadline.cancel()
    if status == Status.ABORTED:
        message = f"stopped by {setting.stop.reason}"
    outcome = TestOutcome(
        name=test.name,
        expect=str(test.expect),
        status=status,
        seed=test.seed,
        duration_s=test.duration_s,
        message=message,
        wall_s=time.perf_counter() - started,
        on_fault=test.on_fault,
    )
    return outcome if running is None else running.completed(outcome)


@contextmanager
def _left_safe(setting: Setting, loop: Loop) -> Iterator[None]:
    try:
        yield
    except _InterruptedError:
        # The campaign goes on with another test: the ram is held, as at the end of any test.
        loop.end_early()
        raise
    finally:
        setting.deadline.start()
        # A full disk must not keep the rig from being made safe.
        with suppress(OSError):
            setting.enters(Phase.CLEANUP, None)
        loop.safe_state()


class _Observed:
    """A writer that passes rows and events on to another writer, and events also to the observer.

    It has the method `timing` if the other writer has it.
    """

    def __init__(self, writer: Writer, observer: Observer) -> None:
        self._writer = writer
        self._observer = observer
        self.write = writer.write
        if isinstance(writer, Timed):
            self.timing = writer.timing

    def event(self, time_s: float, kind: str, text: str) -> None:
        self._writer.event(time_s, kind, text)
        self._observer.test_event(time_s, kind, text)


class _RunningTest:
    """One test while it runs, with its results so far."""

    def __init__(self, setting: Setting, test: CampaignTest, recording: str) -> None:
        campaign = setting.campaign
        self._setting = setting
        self._test = test
        self._recording = recording
        self._recorded = False
        self._ticks = 0
        self._verdict = ""
        self._timing: Mapping[str, Any] | None = None
        self._learning = setting.references.learning(test)
        self._detector = HealthyInnovations(self._chosen_detector())
        memory = start_memory(campaign.filter_name, campaign.model, setting.rig.sensors)
        self._loop = setting.bench.loop(test, memory, campaign.model)
        self._decisions = DecisionRows()
        self._reactions = Reactions(self._loop.channels, campaign.model.parameters)
        self._friction = FrictionWatch(self._detector, test, campaign.model, setting.rig.sensors)
        self._judge = Judge(self._friction, memory, self._loop.channels)
        self._injection = Injection(FaultSchedule(test.faults).faults, self._loop.channels)

    def run(self) -> Status:
        """Run the test until its end or a stop, and return its status.

        Raises:
            _InterruptedError: an operator or a condition ended the test.
            TripError: the rig tripped.
        """
        setting, test = self._setting, self._test
        with _left_safe(setting, self._loop):
            setting.pacer.start()
            setting.enters(Phase.POSITIONING, None)
            self._loop.position()
            setting.enters(Phase.SETTLE, None)
            setting.pacer.wait_until(test.settle_s)
            if setting.stop.requested:
                return Status.ABORTED
            self._go_on()
            setting.enters(Phase.INJECT, None)
            self._loop.inject()
            setting.enters(Phase.MAIN, self._recording)
            # The right context is left first: the valve is at null before the recording is closed.
            with self._writer() as writer, _left_safe(setting, self._loop):
                self._drive(writer)
                self._timing = writer.timing() if isinstance(writer, Timed) else None
        if self._loop.ticks_left:
            return Status.ABORTED
        if setting.references.is_reference(test):
            setting.references.add(test, self._detector.innovations)
        decision = self._judge.decision
        expected = decision is not None and decision.verdict == test.expect
        return Status.PASSED if expected else Status.FAILED

    def _go_on(self) -> None:
        """Raise an error if the present test is to be ended early.

        Raises:
            _InterruptedError: an operator has asked to skip or repeat the test, or a condition that
                interrupts tests is not met.
        """
        setting = self._setting
        interruption = setting.desk.interruption
        if interruption is Request.SKIP:
            raise _InterruptedError(Status.SKIPPED, "skipped by an operator")
        if interruption is Request.RETRY:
            raise _InterruptedError(Status.INTERRUPTED, "an operator has it run again")
        setting.suspenders.look()
        if setting.suspenders.interrupts:
            raise _InterruptedError(Status.INTERRUPTED, "; ".join(setting.suspenders.reasons))

    def completed(self, outcome: TestOutcome) -> TestOutcome:
        """Return a copy of an outcome, completed by the results of the test so far."""
        return replace(
            outcome,
            injected=self._injection.injected,
            decision=self._judge.decision,
            detected_at_s=self._judge.detected_at_s,
            found=self._judge.found,
            recording=self._recording if self._recorded else None,
            recorded_s=self._ticks * TICK,
            thresholds_from=self._learning.source,
            actions=self._reactions.actions,
            friction=self._friction.curve,
            figures=figures_of(
                self._judge.decision,
                self._detector.innovations,
                self._friction.curve,
                self._timing,
            ),
        )

    def _chosen_detector(self) -> Detector:
        campaign = self._setting.campaign
        if self._setting.detector is not None:
            return self._setting.detector(campaign.model)
        if self._learning.baseline is not None:
            return PatternDetector(campaign.false_alarms_per_day, self._learning.baseline)
        return campaign.detector()

    @contextmanager
    def _writer(self) -> Iterator[Writer]:
        setting, channels = self._setting, self._loop.channels
        metadata = metadata_of(
            setting.campaign, setting.rig, self._test, self._learning, channels, setting.provenance
        )
        path = setting.directory / self._recording
        with setting.bench.writer(path, channels, metadata) as writer:
            self._recorded = True
            setting.observer.test_runs(channels, getattr(self._loop, "number", None))
            yield _Observed(writer, setting.observer)

    def _drive(self, writer: Writer) -> None:
        writer.event(0.0, "test_begin", self._test.name)
        try:
            while self._loop.ticks_left and not self._setting.stop.requested:
                self._go_on()
                self._run_batch(writer)
            self._judge.finish()
            self._note_verdict(writer)
        except TripError as error:
            writer.event(self._last_s, "trip", str(error))
            raise
        except _InterruptedError as error:
            writer.event(self._last_s, str(error.status), str(error))
            raise
        except Exception as error:
            writer.event(self._last_s, "error", f"{type(error).__name__}: {error}")
            raise
        if self._loop.ticks_left:
            writer.event(self._last_s, "abort", f"stopped by {self._setting.stop.reason}")
        else:
            writer.event(self._last_s, "test_end", self._verdict)

    def _run_batch(self, writer: Writer) -> None:
        pacer = self._setting.pacer
        ticks = self._judge.ticks_due
        live = pacer.live or self._setting.bench.live
        rows = self._loop.advance(min(ticks, LIVE_TICKS) if live else ticks)
        self._ticks += len(rows)
        writer.write(rows)
        self._setting.observer.test_rows(rows)
        for event in (*self._injection.take(rows), *self._reactions.take(rows)):
            writer.event(*event)
        if self._judge.take(rows):
            self._report_loop()
            self._note_verdict(writer)
        for note in self._setting.desk.take_notes():
            writer.event(self._last_s, "note", f"{note.who}: {note.text}")
        pacer.wait_until(self._test.settle_s + self._last_s)
        self._setting.observer.test_advances(self._last_s, self._judge.decision)

    def _report_loop(self) -> None:
        decision = self._judge.decision
        assert decision is not None
        self._loop.decided(self._decisions.row(self._last_s, decision))

    def _note_verdict(self, writer: Writer) -> None:
        decision = self._judge.decision
        if decision is not None and decision.verdict != self._verdict:
            self._verdict = decision.verdict
            writer.event(self._last_s, "verdict", self._verdict)

    @property
    def _last_s(self) -> float:
        """Time of the last recorded sample in s of the test; 0 before any."""
        return max(self._ticks - 1, 0) * TICK
