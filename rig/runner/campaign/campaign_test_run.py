"""Runs one test of a campaign on a bench, records it, and judges it."""

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from math import ceil, inf
from typing import Any, Final

from estimator.filters import start_memory
from estimator.leaks import Detector, PatternDetector
from faults import CampaignTest, FaultSchedule
from rig.loop import FULL, Action, Cause, StopRequestedError, TripError, explain
from rig.plant import TICK
from rig.reserves import refusal
from rig.runner.outcomes import (
    Array,
    AwaitedEnd,
    ControlChanged,
    CriterionResult,
    DecisionRows,
    Figure,
    FrictionWatch,
    HealthyInnovations,
    LimitNotJudged,
    LimitPassed,
    LimitWatch,
    Measures,
    Reactions,
    SegmentEnds,
    Status,
    TestOutcome,
    Timeline,
    figures_of,
    metadata_of,
    segments_run,
)
from rig.runner.run_folder import log_error

from .bench import Timed, Writer
from .injection import Injection
from .judging import Judge
from .leak_step import LeakStep
from .operator_requests import Request
from .pacing import LIVE_TICKS, Lateness
from .setting import Phase, Setting

CLEANUP_S: Final = 60.0
"""How long cleaning up may take, s. On hardware the ramp and the answers of loop, field process and
recorder, each with a limit of its own, add up to 55 s."""
_ROUNDED: Final = 1e-3
"""Part of a tick by which the time of a change may be later than a tick, by rounding."""


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
    # It calls from a thread of its own, because this one may hang while it cleans up.
    deadline = threading.Timer(CLEANUP_S, setting.cleans_up_too_long)
    deadline.daemon = True
    running: _RunningTest | LeakStep | None = None
    status, message, cause = Status.ERROR, "", None
    try:
        if test.leak_test is not None:
            running = LeakStep(setting, test, deadline, _go_on)
        else:
            running = _RunningTest(setting, test, recording, deadline)
        status = running.run()
    except _InterruptedError as error:
        status, message = error.status, str(error)
    except (KeyboardInterrupt, StopRequestedError) as error:
        if isinstance(error, KeyboardInterrupt):
            setting.stop.request("KeyboardInterrupt")
        status = Status.ABORTED
    except TripError as error:
        setting.stop.request("a trip")
        status, cause = Status.TRIPPED, error.cause
        message = str(error).removeprefix("tripped: ")  # the status says that already
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            # On hardware the supervisor trips for a full disk: no further test could be recorded.
            setting.stop.request("a full disk")
            sentence, remedy = explain(Cause.DISK_FULL)
            status, message = Status.TRIPPED, f"{sentence}; {remedy}"
        elif isinstance(error, OSError):
            # What the system refuses this test it refuses the next one, too.
            setting.stop.request(f"what the system refused: {refusal(error)}")
            status = Status.ABORTED
        else:
            where = log_error(setting.keeper.folder, f"test {test.name}")
            message = f"{type(error).__name__}: {error} (traceback in {where})"
    finally:
        deadline.cancel()
    if status == Status.ABORTED:
        message = f"stopped by {setting.stop.reason}"
    wall_s = time.perf_counter() - started
    outcome = replace(
        not_run(test), status=status, message=message, wall_s=wall_s, on_fault=test.on_fault,
        fault_tripped=cause is Cause.FAULT_CONFIRMED,
    )  # fmt: skip
    return outcome if running is None else running.completed(outcome)


def not_run(test: CampaignTest) -> TestOutcome:
    """Return the outcome of a test that has not been run."""
    return TestOutcome(test.name, str(test.expect), Status.NOT_RUN, test.seed, test.duration_s)


def _go_on(setting: Setting) -> None:
    """Raise an error if the present test is to be ended early.

    Raises:
        _InterruptedError: an operator has asked to skip or repeat the test, or a condition that
            interrupts tests is not met.
    """
    interruption = setting.desk.interruption
    if interruption is Request.SKIP:
        raise _InterruptedError(Status.SKIPPED, "skipped by an operator")
    if interruption is Request.RETRY:
        raise _InterruptedError(Status.INTERRUPTED, "an operator has it run again")
    setting.suspenders.look()
    if setting.suspenders.interrupts:
        raise _InterruptedError(Status.INTERRUPTED, "; ".join(setting.suspenders.reasons))


class _RunningTest:
    """One test while it runs, with its results so far."""

    def __init__(
        self, setting: Setting, test: CampaignTest, recording: str, deadline: threading.Timer
    ) -> None:
        campaign = setting.campaign
        self._deadline = deadline
        self._setting = setting
        self._test = test
        self._recording = recording
        self._writer: Writer
        self._recorded = False
        setting.counter.begins(anew=not setting.bench.live)
        self._ticks = 0
        self._changes: list[ControlChanged] = []
        self._verdict = ""
        self._timing: Mapping[str, Any] | None = None
        self._learning = setting.references.learning(test)
        chosen = self._chosen_detector()
        if setting.kept is not None:
            setting.kept.begins(recording, chosen)
        self._detector = HealthyInnovations(chosen)
        memory = start_memory(campaign.filter_name, campaign.model, setting.rig.sensors)
        self._loop = setting.bench.loop(test, memory, campaign.model)
        self._decisions = DecisionRows()
        self._reactions = Reactions(self._loop.channels, campaign.model.parameters)
        model, sensors = campaign.model, setting.rig.sensors
        self._friction = FrictionWatch(self._detector, test, model, sensors, self._loop.alive)
        self._judge = Judge(self._friction, memory, self._loop.channels, setting.kept)
        self._position = self._loop.channels.index("position_m")
        channels, self._timeline = self._loop.channels, Timeline()
        self._measures = Measures(test, channels, self._timeline)
        self._limits = LimitWatch(test, channels, setting.rig.ladder, self._timeline)
        self._lateness = Lateness() if setting.bench.live and self._limits.watches else None
        self._end = AwaitedEnd(test, channels)
        self._segments = SegmentEnds(test, channels, self._timeline)
        self._injection = Injection(FaultSchedule(test.faults).faults, self._loop.channels)

    def run(self) -> Status:
        """Run and record the test, and return its status: PASSED, FAILED, or ABORTED after a stop.

        The rig is left safe. After a test from which others may learn, its innovations are added to
        the references.

        Raises:
            _InterruptedError: an operator or a condition ended the test.
            TripError: the rig tripped.
        """
        setting, test = self._setting, self._test
        with self._left_safe():
            setting.pacer.start()
            setting.enters(Phase.POSITIONING)
            self._loop.position()
            setting.enters(Phase.SETTLE)
            setting.pacer.wait_until(test.settle_s)
            if setting.stop.requested:
                return Status.ABORTED
            _go_on(setting)
            setting.enters(Phase.INJECT)
            self._loop.inject()
            setting.enters(Phase.MAIN, self._recording)
            channels = self._loop.channels
            metadata = metadata_of(
                setting.campaign, setting.rig, test, self._learning, channels, setting.provenance
            )
            path = setting.keeper.folder / self._recording
            with setting.bench.writer(path, channels, metadata) as self._writer:
                self._recorded = True
                setting.keeper.look()
                setting.observer.test_runs(channels, getattr(self._loop, "number", None))
                # The valve is at null before the recording is closed.
                with self._left_safe():
                    self._drive()
                    if isinstance(self._writer, Timed):
                        self._timing = self._writer.timing()
        if self._loop.ticks_left and not self._end.came:
            return Status.ABORTED
        if setting.references.is_reference(test):
            setting.references.add(test, self._detector.innovations)
        decision = self._judge.decision
        expected = decision is not None and decision.verdict == test.expect
        expected = expected and all(each.met for each in self._criteria)
        return Status.PASSED if expected else Status.FAILED

    @contextmanager
    def _left_safe(self) -> Iterator[None]:
        """Make the rig safe when the context is left; `CLEANUP_S` is counted from then on."""
        try:
            yield
        except _InterruptedError:
            # The campaign goes on with another test: the ram is held, as at the end of any test.
            self._loop.end_early()
            raise
        finally:
            if self._deadline.ident is None:
                # Where the system grants no thread, the rig is made safe without a time limit.
                with suppress(RuntimeError):
                    self._deadline.start()
            # A full disk must not keep the rig from being made safe.
            with suppress(OSError):
                self._setting.enters(Phase.CLEANUP)
            self._loop.safe_state()

    def completed(self, outcome: TestOutcome) -> TestOutcome:
        """Return a copy of an outcome with the test's results so far, such as the decision."""
        decision, figures = self._judge.decision, self._figures
        own = self._measures.figures(figures, decision)
        return replace(
            outcome,
            injected=self._injection.injected,
            decision=decision,
            detected_at_s=self._judge.detected_at_s,
            found=self._judge.found,
            recording=self._recording if self._recorded else None,
            recorded_s=self._ticks * TICK,
            thresholds_from=self._learning.source,
            actions=tuple(self._reactions.actions),
            friction=self._friction.curve,
            figures={**figures, **own},
            criteria=self._criteria,
            limits=tuple(self._limits.passed),
            limits_not_judged=self._limits_not_judged,
            control_changes=tuple(self._changes),
            counted=self._setting.counter.in_test if self._ticks else None,
            segments=segments_run(self._test, self._timeline, self._ticks * TICK),
            message=self._message(outcome),
        )

    def _message(self, outcome: TestOutcome) -> str:
        """Return why the test ended early; a limit of the test is named with value and time."""
        passed = self._limits.acted if outcome.status is Status.TRIPPED else None
        if passed is None or str(passed) in outcome.message:
            return outcome.message
        return f"{passed}; {outcome.message}"

    @property
    def _limits_not_judged(self) -> tuple[LimitNotJudged, ...]:
        return self._limits.not_judged(self._ticks * TICK, self._friction.curve)

    @property
    def _figures(self) -> dict[str, Figure]:
        innovations, curve = self._detector.innovations, self._friction.curve
        return figures_of(self._judge.decision, innovations, curve, self._timing)

    @property
    def _criteria(self) -> tuple[CriterionResult, ...]:
        """What came of the criteria in the rows so far; none before there are any."""
        test = self._test
        if not self._ticks or not (test.criteria or test.until or test.segment_ends):
            return ()
        results = self._measures.results(self._figures, self._judge.decision)
        return (*self._end.results, *self._segments.results, *results)

    def _chosen_detector(self) -> Detector:
        campaign = self._setting.campaign
        if self._setting.detector is not None:
            return self._setting.detector(campaign.model)
        if self._learning.baseline is not None:
            return PatternDetector(campaign.false_alarms_per_day, self._learning.baseline)
        return campaign.detector()

    def _drive(self) -> None:
        self._event(0.0, "test_begin", self._test.name)
        try:
            while self._loop.ticks_left and not self._setting.stop.requested and not self._end.came:
                _go_on(self._setting)
                self._run_batch()
                self._change_control()
            if self._end.came:
                # The campaign goes on with the ram held, as at the end of any test.
                self._loop.end_early()
                self._event(self._last_s, "until", str(self._end))
            self._judge.finish()
            self._note_verdict()
            is_cut = self._loop.ticks_left and not self._end.came
            if not is_cut:
                passings = self._limits.finish(self._judge.decision, lambda: self._figures)
                for each in self._limits_not_judged:
                    self._say_of_limits(self._last_s, str(each))
                self._watch(passings)
        except (TripError, _InterruptedError) as error:
            kind = "trip" if isinstance(error, TripError) else str(error.status)
            # What stopped the loop may be in no row.
            self._tell(self._limits.take_passed(self._loop.passed()))
            self._event(self._last_s, kind, str(error))
            raise
        except Exception as error:
            self._event(self._last_s, "error", f"{type(error).__name__}: {error}")
            raise
        stopped = "abort", f"stopped by {self._setting.stop.reason}"
        self._event(self._last_s, *(stopped if is_cut else ("test_end", self._verdict)))

    def _run_batch(self) -> None:
        pacer = self._setting.pacer
        ticks = self._ticks_due
        # A limit that this process acts on is looked at as often at any pace, for the same rows.
        live = pacer.live or self._setting.bench.live or self._limits.acts
        live = live or self._end.by_channel or self._segments.is_close
        rows = self._loop.advance(min(ticks, LIVE_TICKS) if live else ticks)
        self._ticks += len(rows)
        self._writer.write(rows)
        self._measures.take(rows)
        self._setting.counter.take(rows[:, self._position])
        self._setting.observer.test_rows(rows)
        for event in (*self._injection.take(rows), *self._reactions.take(rows)):
            self._event(*event)
        if self._judge.take(rows) and self._judge.decision is not None:
            self._loop.decided(self._decisions.row(self._last_s, self._judge.decision))
            self._note_verdict()
        if len(rows):
            self._watch(self._limits.take(rows, self._judge.decision, self._loop.passed()))
            if self._lateness is not None and (late := self._lateness.take(self._last_s)):
                self._say_of_limits(self._last_s, late)
            self._end.take(rows, self._judge.decision)
            self._end_segment(rows)
        for note in self._setting.desk.take_notes():
            self._event(self._last_s, "note", note)
        pacer.wait_until(self._test.settle_s + self._last_s)
        self._setting.observer.test_advances(self._last_s, self._judge.decision)

    @property
    def _ticks_due(self) -> int:
        """Number of ticks to the end of the block, or to where the file changes the control."""
        ticks, change_s = self._judge.ticks_due, self._setting.desk.next_control_change_s
        left = ticks if change_s == inf else ceil(change_s / TICK - _ROUNDED) - self._ticks
        return min(ticks, max(left, 1))

    def _change_control(self) -> None:
        """Give the loop the control that is asked for now, and record from when it holds.

        It is done between two batches, once the test has begun, while ticks of it are left.

        Raises:
            TripError: the loop did not take the change.
        """
        if not self._ticks or not self._loop.ticks_left or self._end.came:
            return
        asked = self._setting.desk.take_control_changes(self._ticks * TICK)
        at_s = self._loop.change(asked[-1].after) if asked else None
        if at_s is None:
            return
        for change in asked:
            changed = ControlChanged(at_s, change.who, str(change))
            self._changes.append(changed)
            self._event(at_s, "control", f"{change.who}: {change}")
            self._setting.desk.record(
                "control", test=self._setting.present, at_s=at_s, who=change.who, what=str(change)
            )
            self._setting.observer.rig_tells(f"{self._test.name}: {changed}")

    def _watch(self, passings: list[LimitPassed]) -> None:
        """Tell which limits were passed, and act on those that the loop does not judge.

        Raises:
            TripError: such a limit was passed that asks for a hold or worse.
        """
        self._tell(passings)
        if self._limits.due is not None:
            action = Action[self._limits.due.action.upper()]
            self._loop.limited(action, str(self._limits.due))

    def _tell(self, passings: list[LimitPassed]) -> None:
        """Tell which limits of the test were passed."""
        for passing in passings:
            # What the loop does about limits of the rig is told by the rig itself.
            if passing.of == "test":
                self._say_of_limits(passing.at_s, str(passing))

    def _say_of_limits(self, time_s: float, text: str) -> None:
        """Tell recording, journal and observer something about the test's limits."""
        self._event(time_s, "limit", text)
        self._setting.desk.record("limit", what=text, durable=False)
        self._setting.observer.rig_tells(f"{self._test.name}: {text}")

    def _end_segment(self, rows: Array) -> None:
        """Let the motion go on with its next segment if what ends the present one has come."""
        end = self._segments.take(rows, self._judge.decision)
        if end is None:
            return
        place, blend = round(end.end_s / TICK), round(end.blend_s / TICK)
        tick = self._loop.skip_to(place, blend)
        if tick is not None:
            self._timeline.skip(tick * TICK, end.end_s)
        self._event(self._last_s, "until", f"{end.label}: it came; the next segment begins")

    def _event(self, time_s: float, kind: str, text: str) -> None:
        """Write an event to the recording, and tell the observer of it."""
        self._writer.event(time_s, kind, text)
        self._setting.observer.test_event(time_s, kind, text)

    def _note_verdict(self) -> None:
        decision = self._judge.decision
        if decision is not None and decision.verdict != self._verdict:
            self._verdict = decision.verdict
            self._event(self._last_s, "verdict", self._verdict)

    @property
    def _last_s(self) -> float:
        """Time of the last recorded sample in s of the test; 0 before any."""
        return max(self._ticks - 1, 0) * TICK
