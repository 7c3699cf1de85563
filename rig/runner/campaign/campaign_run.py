"""Runs a campaign, and writes its results to disk however it ends."""

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Final

from estimator.evidence import KeptAccounts
from estimator.leaks import DetectorFactory
from faults import Campaign
from rig.configuration import Rig, unstable_controls
from rig.heap import give_back
from rig.io import DriverError, today
from rig.loop import StopRequestedError, TripError
from rig.runner.counters import RigCounter, counters_path
from rig.runner.leak_test import could_see
from rig.runner.outcomes import (
    EXIT_BAD_INPUT,
    EXIT_STOPPED,
    CampaignOutcome,
    HealthyReferences,
    Observer,
    Status,
    TestOutcome,
    calibrations_used,
    provenance,
    record_of,
)
from rig.runner.run_folder import (
    JOURNAL,
    JOURNAL_SCHEMA,
    JUNIT,
    RESULTS,
    FolderKeeper,
    Journal,
    JournalState,
    changes_of,
    default_directory,
    fingerprint,
    keep_attempt,
    learn_again,
    prepare_directory,
    recording_names,
    require_journal,
    resumable,
    sync,
    write_junit,
    write_results,
)
from rig.supervisor import Onlooker

from .bench import Bench
from .campaign_test_run import not_run, run_test
from .compiled_pieces import Needs
from .compiling import ON_HARDWARE, SIMULATED, compile_for, load
from .control_change import RunningControl
from .control_port import ControlPort
from .operator_requests import Desk, Request
from .pacing import Pace, Pacer
from .setting import Phase, Setting
from .simulated_bench import SimulatedBench
from .stopping import StopFlag
from .suspending import MOST_SUSPENSIONS, Suspenders

_WRITE_EVERY_S: Final = 1.0
"""Least time between two writings of the results, s."""
_WRITE_PART: Final = 0.05
"""Greatest part of the time that writing the results takes: each time all tests are written, and a
campaign may have thousands."""
_NAP_S: Final = 0.05
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
    by: str = "",
    kept: KeptAccounts | None = None,
) -> CampaignOutcome:
    """Run every test of a campaign on a rig, write the results to a folder, and return the outcome.

    The folder gets a journal, `results.json` and `junit.xml`, one recording for each test, and
    `errors.log` if a test crashed. They are written however the run ends. A crash ends one test
    only. After a stop, a trip, or if the rig cannot be armed or homed, the remaining tests have the
    status `not_run`. After a kill, or a power cut, the journal shows how far the run had come.
    If the folder is removed or moved, the run stops, and its files are kept in the outcome's
    `kept_in`.

    Args:
        campaign: the campaign, already checked against the rig.
        rig: the rig.
        out: a new or empty folder, or the folder of an earlier run, whose files are replaced; if
            not given, a new folder below `runs`.
        pace: pace of a simulated rig: "real" to run at the wall clock, "fast" to run as fast as
            possible; that of the rig's file if not given. The results are the same bit for bit.
        observer: its methods are called as the run goes on.
        stop: is looked at after each batch; once a stop is requested on it, the run ends, as with
            `stop_on_signals`. The run itself requests one after a trip.
        detector: makes the detector of each test, in place of the filter's own detector.
        bench: the bench to run the tests on, whose context the caller has entered, and leaves; if
            not given, that of `rig`, whose context is entered here.
        command: the command line that repeats the run, for the report; empty if there is none.
        resume: whether to go on with the run in the folder `out`, without repeating its finished
            tests; a new run begins if the folder has no journal.
        desk: takes requests of operators from this process; other processes reach it by the socket
            in the folder.
        overdue: is called from another thread if cleaning up after a test takes more than 60 s. It
            should end the process; the rig's other processes then make the rig safe.
        given: options of the command line that the journal keeps, for resuming; JSON-able.
        by: name of who starts the run or goes on with it, for the journal; empty if not known.
        kept: keeps the oil accounts of the tests that run, for `rig.report.write_report`.

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
    if resume:
        require_journal(directory, names)
    if not (resume and (directory / JOURNAL).is_file()):
        prepare_directory(directory, names)
    with (
        Journal(directory, resume=resume) as journal,
        FolderKeeper(
            directory,
            lambda: stop.request("the loss of its folder"),
            journal.move_to,
            observer.rig_tells,
        ) as keeper,
        ExitStack() as ends,
    ):
        known = journal.entries
        state = resumable(known, directory, campaign, rig) if known else JournalState()
        ready: AbstractContextManager[object] = nullcontext()
        # It is open while the rig is made ready too, so that who stops it then is known by name.
        desk.prepare(stop)
        ends.enter_context(ControlPort(directory, desk, desk.refuse))
        if bench is None:
            bench = ready = bench_of(
                campaign, rig, directory, observer, stop,
                lambda text: desk.record("driven", what=text),
            )  # fmt: skip
        run = _CampaignRun(
            campaign=campaign,
            rig=rig,
            bench=bench,
            ready=ready,
            heard=ends,
            keeper=keeper,
            pacer=Pacer(pace or rig.pace, stop),
            observer=observer,
            stop=stop,
            references=HealthyReferences(campaign),
            provenance=provenance(campaign, command),
            detector=detector,
            kept=kept,
            desk=desk,
            suspenders=Suspenders(campaign.conditions, bench.reading),
            recordings=names,
            standing=state,
            journal=journal,
            overdue=overdue or (lambda: None),
            counter=RigCounter(
                rig.name,
                counters_path(rig.name) if rig.backend == "hardware" else None,
                observer.rig_tells,
            ),
        )
        try:
            run.run(started, given or {}, by)
        except OSError:
            # The results that can still be written say that this ended the run.
            run.ended_with = EXIT_STOPPED
            raise
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
        rig: the rig, simulated or on hardware.
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
    if any(test.leak_test is not None for test in campaign.tests):
        observer.rig_tells(could_see(rig, campaign.model))
    # Imported here because a simulation does not need the libraries of its drivers.
    from rig.supervisor import ConnectedRig, Session

    load(needs, ON_HARDWARE, stop)
    onlooker = observer if isinstance(observer, Onlooker) else None
    return Session(
        ConnectedRig(
            rig, campaign.filter_name, campaign.model, directory, stop, observer.rig_tells,
            onlooker, journal,
        )
    )  # fmt: skip


@dataclass(kw_only=True)
class _CampaignRun(Setting):
    """A campaign while it runs; its state is always what its journal says.

    Attributes:
        ready: the context in which the bench is ready for tests.
        recordings: file name of each test's recording.
        standing: state of the campaign according to its journal.
        journal: the journal, whose context has been entered.
        heard: the context in which other programs are heard, which ends before the journal does.
        write_from: when the results may be written again, s of the monotonic clock.
        suspended: how often conditions have interrupted each test, by the test's index.
        ended_with: exit code of an event that ended the run outside its tests; None if none.
    """

    ready: AbstractContextManager[object]
    recordings: list[str]
    standing: JournalState
    journal: Journal
    heard: ExitStack
    write_from: float = 0.0
    suspended: Counter[int] = field(default_factory=Counter)
    ended_with: int | None = None

    def run(self, started: datetime, given: Mapping[str, Any], by: str) -> None:
        """Run all tests that are not finished, until the end or a stop, and keep the journal.

        Args:
            started: when the run was begun, or gone on with, UTC.
            given: options of the command line, for the journal.
            by: name of who starts the run or goes on with it; empty if not known.

        Raises:
            DriverError: a device of the rig is missing, or is not the configured one.
        """
        finished = self.standing.finished
        stands = [finished[index] for index in sorted(finished)]
        resumed = self.standing.begun is not None
        self.observer.campaign_begins(
            self.campaign, self.keeper.folder, stands, started, resumed=resumed
        )
        for name, text in unstable_controls(self.campaign, self.rig):
            self.observer.rig_tells(f"warning: {name}: {text}")
        if self.campaign.baseline_doubt:
            self.observer.rig_tells(f"warning: {self.campaign.baseline_doubt}")
        self.desk.open(
            [test.name for test in self.campaign.tests],
            {index: str(outcome.status) for index, outcome in finished.items()},
            self._keep,
            self.stop,
            lambda pausing, held: self.observer.campaign_stands(
                pausing=pausing, held=held, by=self.desk.paused_by
            ),
        )
        self._begin(started, given, by)
        self.desk.begun()
        # Even if the run is killed now, its folder is recognized as that of a run.
        self.write()
        learn_again(self.references, self.standing, self.keeper.folder, self.recordings)
        with self.heard:
            if self._next() is not None:
                self._use_rig()
        reason, exit_code = self.stop.reason, int(self.outcome.exit_code)
        self.desk.record("end", reason=reason, exit_code=exit_code)
        self.observer.campaign_ends(exit_code, reason)

    def _begin(self, started: datetime, given: Mapping[str, Any], by: str) -> None:
        """Write the entry `begin` to a new journal, or `resume` to one that is continued."""
        author = {"by": by} if by else {}
        now = dict(self.provenance["versions"])
        if self.standing.begun is not None:
            before = self.standing.begun["versions"] or {}
            changes = ", ".join(changes_of(before, now))
            self.desk.record(
                "resume",
                started=started.isoformat(timespec="seconds"),
                versions_changed=changes,
                pid=os.getpid(),
                **author,
            )
            return
        self.desk.record(
            "begin",
            schema=JOURNAL_SCHEMA,
            campaign=self.campaign.name,
            started=started.isoformat(timespec="seconds"),
            fingerprint=fingerprint(self.campaign, self.rig),
            tests=[test.name for test in self.campaign.tests],
            versions=now,
            given=dict(given),
            pid=os.getpid(),
            **author,
        )

    def _use_rig(self) -> None:
        """Make the rig ready, run all tests that are not finished, and leave the rig safe.

        A stop, or a trip outside of the tests, ends this without an exception; after such a trip a
        stop of the campaign is requested.

        Raises:
            DriverError: a device of the rig is missing, or is not the configured one.
        """
        try:
            with self.ready:
                self._run_tests()
        except DriverError:
            self.ended_with = EXIT_BAD_INPUT
            raise
        except StopRequestedError:
            return
        except TripError as error:
            self.ended_with = EXIT_STOPPED
            self.observer.rig_tells(str(error))
            self.stop.request(f"the rig: {error}")

    def _run_tests(self) -> None:
        while not self.stop.requested:
            self._wait()
            index = self._next()
            if index is None or self.stop.requested:
                return
            if index in self.standing.skipped:
                self._skip(index)
            else:
                self._run_test(index)
                give_back()
            # After the last test they are written once the rig is left: the run passes only then.
            if time.monotonic() > self.write_from and self._next() is not None:
                self.write()

    def _next(self) -> int | None:
        """Return the index of the next test to run; None if all are finished."""
        order, finished = self.references.running_order, self.standing.finished
        return next((index for index in order if index not in finished), None)

    def _wait(self) -> None:
        """Wait while the campaign is paused, held by a condition, or the next test waits for one.

        Return at once after a stop. If a condition holds the campaign for too long, a stop is
        requested here. Begin and end of a hold are written to the journal.
        """
        desk, suspenders, index = self.desk, self.suspenders, self._next()
        awaited = () if index is None else self.campaign.tests[index].wait_for
        own = Suspenders(awaited, self.bench.reading)
        began, held, paused = time.monotonic(), False, False
        while not self.stop.requested:
            suspenders.look()
            own.look()
            # An operator may have the test skipped, upon which nobody waits for it any more.
            is_awaited = self._next() == index and index not in self.standing.skipped
            waits_for = [f"{each} (awaited)" for each in own.reasons] if is_awaited else []
            reasons = (*suspenders.reasons, *waits_for) if self._next() is not None else ()
            desk.held_by(reasons)
            if reasons and not held:
                desk.record("held", reasons=list(reasons))
                self.observer.rig_tells(f"held: {'; '.join(reasons)}")
            elif desk.paused and not paused:
                self.observer.rig_tells(f"paused, asked for by {desk.paused_by}")
            held, paused = held or bool(reasons), paused or desk.paused
            if not reasons and not desk.paused:
                break
            if suspenders.given_up or (waits_for and own.given_up):
                self.stop.request(f"what held it for too long: {'; '.join(reasons)}")
            with suppress(StopRequestedError):
                self.bench.idle()
            time.sleep(_NAP_S)
        if held:
            desk.record("released", after_s=time.monotonic() - began)

    def _skip(self, index: int) -> None:
        outcome = not_run(self.campaign.tests[index])
        outcome = replace(outcome, status=Status.SKIPPED, message="skipped by an operator")
        self._ends(index, outcome)
        self.observer.test_skipped(outcome)

    def _run_test(self, index: int) -> None:
        test, recording = self.campaign.tests[index], self.recordings[index]
        attempt = self.standing.number_of(index)
        kept = keep_attempt(self.keeper.folder / recording, attempt - 1) if attempt > 1 else None
        self.observer.test_begins(self.references.running_order.index(index) + 1, test)
        self.desk.begins(index, RunningControl(self.rig, test, self.campaign.model))
        self.present, self.phase = index, Phase.SETUP
        self.desk.record(
            "phase", test=index, attempt=attempt, phase=Phase.SETUP, kept=kept, durable=False
        )
        outcome = run_test(self, test, recording)
        for change in self.desk.take_control_changes(0.0):
            # The test had come to its end before the loop could take it.
            self.desk.record("control", test=index, at_s=None, who=change.who, what=str(change))
        self.counter.save()
        if outcome.is_finished and self.desk.interruption is Request.RETRY:
            message = "an operator has it run again"
            outcome = replace(outcome, status=Status.INTERRUPTED, message=message)
        if outcome.recording is not None:
            # The journal must not report a recording before it is on disk.
            sync(self.keeper.folder / outcome.recording)
            sync(self.keeper.folder)
        self._ends(index, outcome)
        self.observer.test_ends(outcome)
        if outcome.status is Status.INTERRUPTED and self.suspenders.interrupts:
            self.suspended[index] += 1
            if self.suspended[index] == MOST_SUSPENSIONS:
                self.stop.request(f"{MOST_SUSPENSIONS} interruptions of {outcome.name}")

    def _ends(self, index: int, outcome: TestOutcome) -> None:
        self.desk.record("outcome", test=index, outcome=record_of(outcome))
        self.desk.ends(index, str(outcome.status), attention=outcome.status in _WANTS_ATTENTION)

    def _keep(self, kind: str, *, durable: bool = True, **details: Any) -> None:
        self.standing.take(self.journal.write(kind, durable=durable, **details))

    def write(self) -> None:
        """Write `results.json` and `junit.xml` with all outcomes so far."""
        began = time.monotonic()
        outcome = self.outcome
        write_junit(outcome, self.keeper.folder / JUNIT)
        # They come last, so that they say of no run that it passed which could not write the rest.
        write_results(outcome, self.keeper.folder / RESULTS)
        ended = time.monotonic()
        self.write_from = ended + max(_WRITE_EVERY_S, (ended - began) / _WRITE_PART)

    @property
    def outcome(self) -> CampaignOutcome:
        """The campaign's outcome so far; tests that have not been run have the status `not_run`."""
        campaign, state = self.campaign, self.standing
        return CampaignOutcome(
            name=campaign.name,
            description=campaign.description,
            rig=self.rig.name,
            model=campaign.model.name,
            filter=campaign.filter_name,
            false_alarms_per_day=campaign.false_alarms_per_day,
            started=state.begun["started"] if state.begun else "",
            tests=tuple(
                state.outcome(index, not_run(test)) for index, test in enumerate(campaign.tests)
            ),
            provenance=self.provenance,
            history=tuple(state.history),
            ended_with=self.ended_with,
            calibrations=calibrations_used(self.rig, self._days),
            uncalibrated=self.rig.uncalibrated,
            kept_in=self.keeper.kept_in,
        )

    @property
    def _days(self) -> tuple[date, ...]:
        """The day on which the campaign was begun, if it was, and today."""
        if not self.standing.begun:
            return (today(),)
        begun = datetime.fromisoformat(self.standing.begun["started"])
        return begun.astimezone().date(), today()
