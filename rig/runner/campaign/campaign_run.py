"""Runs a campaign, and writes its results to disk however it ends."""

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from estimator.leaks import DetectorFactory
from faults import Campaign, CampaignTest
from rig.configuration import Rig
from rig.io import DriverError
from rig.loop import StopRequestedError, TripError
from rig.runner.outcomes import (
    EXIT_BAD_INPUT,
    EXIT_STOPPED,
    CampaignOutcome,
    HealthyReferences,
    Observer,
    Status,
    TestOutcome,
    provenance,
    record_of,
)
from rig.runner.run_folder import (
    JOURNAL,
    JOURNAL_SCHEMA,
    JUNIT,
    RESULTS,
    Journal,
    JournalState,
    changes_of,
    default_directory,
    fingerprint,
    keep_attempt,
    learn_again,
    prepare_directory,
    recording_names,
    resumable,
    sync,
    write_junit,
    write_results,
)
from rig.supervisor import Onlooker

from .bench import Bench
from .campaign_test_run import Setting, run_test
from .compiled_pieces import Needs
from .compiling import ON_HARDWARE, SIMULATED, compile_for, load
from .control_port import ControlPort
from .operator_requests import Desk, Request
from .pacing import Pace, Pacer
from .phases import CLEANUP_S, Deadline, Phase
from .simulated_bench import SimulatedBench
from .stopping import StopFlag
from .suspending import MOST_SUSPENSIONS, Suspenders

_WRITE_EVERY_S: Final = 1.0
"""Least time between two writings of the results, s: a campaign may have thousands of tests."""
_NAP_S: Final = 0.05
_MOST_REFUSED: Final = 100
"""Refused requests that the journal keeps, so that a flood of requests cannot fill the disk."""
_WANTS_ATTENTION: Final = (Status.FAILED, Status.ERROR, Status.TRIPPED, Status.INTERRUPTED)


def run_campaign(
    campaign: Campaign,
    rig: Rig,
    out: Path | None = None,
    *,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
    detector: DetectorFactory | None = None,
    bench: Bench | None = None,
    command: Sequence[str] = (),
    resume: bool = False,
    desk: Desk | None = None,
    overdue: Callable[[], None] | None = None,
    given: Mapping[str, Any] | None = None,
) -> CampaignOutcome:
    """Run every test of a campaign on a rig, write the results to a folder, and return the outcome.

    The folder gets a journal, `results.json` and `junit.xml`, one recording for each test, and
    `errors.log` if a test crashed. They are written however the run ends. A crash ends one test
    only. After a stop, a trip, or if the rig cannot be armed or homed, the remaining tests have the
    status `not_run`. After a kill, or a power cut, the journal shows how far the run had come.

    Args:
        campaign: the campaign, already checked against the rig.
        rig: the rig.
        out: a new or empty folder, or the folder of an earlier run, whose files are replaced; if
            not given, a new folder below `runs`.
        pace: of a simulated rig: "real" to run at the wall clock, "fast" to run as fast as
            possible; the pace of the rig's file if not given. The results are the same bit for bit.
        observer: its methods are called as the run goes on.
        stop: is looked at after each batch; once a stop is requested on it, the run ends, as with
            `stop_on_signals`. The run itself requests one after a trip.
        detector: makes the detector of each test, in place of the filter's own detector.
        bench: the bench to run the tests on, whose context is not entered yet; if not given, that
            of `rig`.
        command: the command line that repeats the run, for the report; empty if there is none.
        resume: whether to go on with the run in the folder `out`, without repeating its finished
            tests; a new run begins if the folder has no journal.
        desk: takes requests of operators from this process; other processes reach it by the socket
            in the folder.
        overdue: is called from another thread if cleaning up after a test takes more than 60 s. It
            should end the process; the rig's other processes then make the rig safe.
        given: options of the command line that the journal keeps, for resuming; JSON-able.

    Raises:
        DirectoryError: the folder cannot be used; nothing was written.
        JournalError: the run in the folder cannot be resumed, or another process runs it now;
            nothing was written.
        DriverError: a device of the rig is missing, or is not the configured one; nothing moved.
        OSError: the results cannot be written.
    """
    stop, observer, desk = stop or StopFlag(), observer or Observer(), desk or Desk()
    started = datetime.now(UTC)
    directory = out or default_directory(campaign.name, started)
    names = recording_names(test.name for test in campaign.tests)
    if not (resume and (directory / JOURNAL).is_file()):
        prepare_directory(directory, names)
    with Journal(directory, resume=resume) as journal:
        state = JournalState()
        if journal.entries:
            state = resumable(journal.entries, directory, campaign, rig)
        bench = bench or bench_of(
            campaign, rig, directory, observer, stop,
            lambda text: desk.record("driven", what=text),
        )  # fmt: skip
        setting = Setting(
            campaign=campaign,
            rig=rig,
            bench=bench,
            directory=directory,
            pacer=Pacer(pace or rig.pace, stop),
            observer=observer,
            stop=stop,
            references=HealthyReferences(campaign),
            provenance=provenance(campaign, command),
            detector=detector,
            desk=desk,
            suspenders=Suspenders(campaign.conditions, bench.reading),
        )
        run = _CampaignRun(setting, names, state, journal, overdue or (lambda: None))
        try:
            run.run(started, given or {})
        finally:
            desk.close()
            run.write()
    return run.outcome


def bench_of(
    campaign: Campaign,
    rig: Rig,
    directory: Path,
    observer: Observer,
    stop: StopFlag,
    journal: Callable[[str], None] = lambda text: None,
) -> Bench:
    """Compile what a session runs, and return the bench of a rig, whose context is not entered yet.

    Args:
        campaign: the campaign to run.
        rig: simulated, or on hardware.
        directory: folder of the run.
        observer: shows the operator how compiling goes on; follows a session on hardware if it is
            an `Onlooker`, too.
        stop: once a stop is requested on it, compiling ends, and later the session.
        journal: is called on hardware with a sentence when another master drives a device.
    """
    needs = Needs(rig, campaign.filter_name)
    if rig.backend == "simulated":
        compile_for(needs, SIMULATED, observer.rig_tells, stop)
        return SimulatedBench(rig, directory, observer.rig_tells)
    compile_for(needs, ON_HARDWARE, observer.rig_tells, stop)
    # Imported here because a simulation does not need the libraries of its drivers.
    from rig.supervisor import ConnectedRig, Session

    load(needs, ON_HARDWARE)

    onlooker = observer if isinstance(observer, Onlooker) else None
    return Session(
        ConnectedRig(
            rig, campaign.filter_name, campaign.model, directory, stop, observer.rig_tells,
            onlooker, journal,
        )
    )  # fmt: skip


class _CampaignRun:
    """A campaign while it runs; its state is always what its journal says."""

    def __init__(
        self,
        setting: Setting,
        recordings: list[str],
        state: JournalState,
        journal: Journal,
        overdue: Callable[[], None],
    ) -> None:
        self._setting = setting
        self._recordings = recordings
        self._standing = state
        self._journal = journal
        self._overdue = overdue
        self._written_at = 0.0
        self._refused = 0
        self._suspended: Counter[int] = Counter()
        self._present = 0
        self._phase: Phase | None = None
        self._ended_with: int | None = None
        setting.enters = self._enters
        setting.deadline = Deadline(CLEANUP_S, self._is_overdue)

    def run(self, started: datetime, given: Mapping[str, Any]) -> None:
        """Run all tests that are not finished, until the end or a stop."""
        setting = self._setting
        finished = self._standing.finished
        stands = [finished[index] for index in sorted(finished)]
        setting.observer.campaign_begins(setting.campaign, setting.directory, stands)
        setting.desk.on_change(
            lambda pausing, held: setting.observer.campaign_stands(pausing=pausing, held=held)
        )
        setting.desk.open(
            [test.name for test in setting.campaign.tests],
            {index: str(outcome.status) for index, outcome in finished.items()},
            self._keep,
            setting.stop,
        )
        self._begin(started, given)
        # Even if the run is killed now, its folder is recognized as that of a run.
        self.write()
        learn_again(setting.references, self._standing, setting.directory, self._recordings)
        if self._next() is not None:
            with ControlPort(setting.directory, setting.desk, self._refuse):
                self._use_rig()
        reason, exit_code = setting.stop.reason, int(self.outcome.exit_code)
        setting.desk.record("end", reason=reason, exit_code=exit_code)
        setting.observer.campaign_ends(exit_code, reason)

    def _begin(self, started: datetime, given: Mapping[str, Any]) -> None:
        """Write the entry `begin` to a new journal, or `resume` to one that is continued."""
        setting = self._setting
        now = dict(setting.provenance["versions"])
        if self._standing.begun is not None:
            before = self._standing.begun["versions"] or {}
            setting.desk.record("resume", versions_changed=changes_of(before, now), pid=os.getpid())
            return
        setting.desk.record(
            "begin",
            schema=JOURNAL_SCHEMA,
            campaign=setting.campaign.name,
            started=started.isoformat(timespec="seconds"),
            fingerprint=fingerprint(setting.campaign, setting.rig),
            tests=[test.name for test in setting.campaign.tests],
            versions=now,
            given=dict(given),
            pid=os.getpid(),
        )

    def _use_rig(self) -> None:
        """Make the rig ready, run all tests that are not finished, and leave it safe.

        Raises:
            DriverError: a device of the rig is missing, or is not the configured one.
        """
        try:
            with self._setting.bench:
                self._run_tests()
        except DriverError:
            self._ended_with = EXIT_BAD_INPUT
            raise
        except StopRequestedError:
            return
        except TripError as error:
            self._ended_with = EXIT_STOPPED
            self._setting.observer.rig_tells(str(error))
            self._setting.stop.request(f"the rig: {error}")

    def _run_tests(self) -> None:
        while not self._setting.stop.requested:
            self._wait()
            index = self._next()
            if index is None or self._setting.stop.requested:
                return
            if index in self._standing.skipped:
                self._skip(index)
            else:
                self._run_test(index)
            if time.monotonic() - self._written_at > _WRITE_EVERY_S:
                self.write()

    def _next(self) -> int | None:
        """Return the index of the next test to run; None if all are finished."""
        finished = self._standing.finished
        order = self._setting.references.running_order
        return next((index for index in order if index not in finished), None)

    def _wait(self) -> None:
        """Wait while the campaign is paused or a condition is not met, until a stop."""
        setting, desk, suspenders = self._setting, self._setting.desk, self._setting.suspenders
        began, held, paused = time.monotonic(), False, False
        while not setting.stop.requested:
            suspenders.look()
            reasons = suspenders.reasons if self._next() is not None else ()
            desk.held_by(reasons)
            if reasons and not held:
                desk.record("held", reasons=list(reasons))
                setting.observer.rig_tells(f"held: {'; '.join(reasons)}")
            elif desk.paused and not paused:
                setting.observer.rig_tells("paused")
            held, paused = held or bool(reasons), paused or desk.paused
            if not reasons and not desk.paused:
                break
            if suspenders.given_up:
                setting.stop.request(f"what held it for too long: {'; '.join(reasons)}")
            with suppress(StopRequestedError):
                setting.bench.idle()
            time.sleep(_NAP_S)
        if held:
            desk.record("released", after_s=time.monotonic() - began)

    def _skip(self, index: int) -> None:
        test = self._setting.campaign.tests[index]
        message = "skipped by an operator"
        outcome = replace(_not_run(test), status=Status.SKIPPED, message=message)
        self._ends(index, outcome)
        self._setting.observer.test_skipped(outcome)

    def _run_test(self, index: int) -> None:
        setting = self._setting
        test, recording = setting.campaign.tests[index], self._recordings[index]
        attempt = self._standing.number_of(index)
        kept = None
        if attempt > 1:
            kept = keep_attempt(setting.directory / recording, attempt - 1)
        setting.observer.test_begins(setting.references.running_order.index(index) + 1, test)
        setting.desk.begins(index)
        self._present, self._phase = index, Phase.SETUP
        setting.desk.record(
            "phase", test=index, attempt=attempt, phase=Phase.SETUP, kept=kept, durable=False
        )
        outcome = run_test(setting, test, recording)
        if outcome.is_finished and setting.desk.interruption is Request.RETRY:
            message = "an operator has it run again"
            outcome = replace(outcome, status=Status.INTERRUPTED, message=message)
        if outcome.recording is not None:
            # The journal must not report a recording before it is on disk.
            sync(setting.directory / outcome.recording)
            sync(setting.directory)
        self._ends(index, outcome)
        setting.observer.test_ends(outcome)
        self._count_suspensions(index, outcome)

    def _ends(self, index: int, outcome: TestOutcome) -> None:
        desk = self._setting.desk
        desk.record("outcome", test=index, outcome=record_of(outcome))
        desk.ends(index, str(outcome.status), attention=outcome.status in _WANTS_ATTENTION)

    def _count_suspensions(self, index: int, outcome: TestOutcome) -> None:
        if outcome.status is not Status.INTERRUPTED or not self._setting.suspenders.interrupts:
            return
        self._suspended[index] += 1
        if self._suspended[index] == MOST_SUSPENSIONS:
            self._setting.stop.request(f"{MOST_SUSPENSIONS} interruptions of {outcome.name}")

    def _enters(self, phase: Phase, recording: str | None) -> None:
        if phase is self._phase:
            return
        self._phase = phase
        more = {"recording": recording} if recording else {}
        self._setting.desk.enters(phase)
        self._setting.desk.record("phase", test=self._present, phase=phase, durable=False, **more)

    def _keep(self, kind: str, *, durable: bool = True, **details: Any) -> None:
        self._standing.take(self._journal.write(kind, durable=durable, **details))

    def _refuse(self, why: str) -> None:
        self._refused += 1
        if self._refused <= _MOST_REFUSED:
            self._setting.desk.record("refused", why=why, durable=False)

    def _is_overdue(self) -> None:
        # The test may hang on the disk, so the process is ended even if nothing can be written.
        try:
            self._setting.desk.record("overdue")
        finally:
            self._overdue()

    def write(self) -> None:
        """Write `results.json` and `junit.xml` with all outcomes so far."""
        directory = self._setting.directory
        write_results(self.outcome, directory / RESULTS)
        write_junit(self.outcome, directory / JUNIT)
        self._written_at = time.monotonic()

    @property
    def outcome(self) -> CampaignOutcome:
        """The campaign's outcome so far; tests that have not been run have the status `not_run`."""
        campaign, state = self._setting.campaign, self._standing
        begun = state.begun
        return CampaignOutcome(
            name=campaign.name,
            description=campaign.description,
            rig=self._setting.rig.name,
            model=campaign.model.name,
            filter=campaign.filter_name,
            false_alarms_per_day=campaign.false_alarms_per_day,
            started=begun["started"] if begun else "",
            tests=tuple(
                state.outcome(index, _not_run(test)) for index, test in enumerate(campaign.tests)
            ),
            provenance=self._setting.provenance,
            history=tuple(state.history),
            ended_with=self._ended_with,
        )


def _not_run(test: CampaignTest) -> TestOutcome:
    return TestOutcome(test.name, str(test.expect), Status.NOT_RUN, test.seed, test.duration_s)
