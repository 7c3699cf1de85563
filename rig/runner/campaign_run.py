"""Runs a campaign, and leaves its results on disk whatever ends it."""

import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from estimator.replay import DetectorFactory
from faults.campaign import Campaign, CampaignTest
from rig.configuration.rig import Rig

from .bench import Bench
from .directory import JUNIT, RESULTS, default_directory, prepare_directory, recording_names
from .junit import write_junit
from .observer import Observer
from .outcome import CampaignOutcome, Status, TestOutcome
from .pacing import Pace, Pacer
from .provenance import provenance
from .rehearsal import rehearse
from .results import write_results
from .simulated_bench import SimulatedBench
from .single_test import Setting, run_test
from .stopping import StopFlag
from .thresholds import HealthyReferences

_WRITE_EVERY_S: Final = 1.0
"""How far behind results may be: with thousands of tests, not each of them rewrites them."""


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
) -> CampaignOutcome:
    """Run every test of a campaign on a rig and write what comes of it to a folder.

    The folder gets `results.json` and `junit.xml`, a recording a test, and `errors.log` if a test
    crashed. They are written whatever ends the run: a test that crashes is an outcome, a stop
    leaves the rest of the tests as not run.

    Args:
        campaign: checked against the rig.
        rig: the rig.
        out: a new or empty folder, or that of an earlier run, which is replaced; if not given, a
            new one below `runs`.
        pace: "real" for the wall clock, "fast" for as fast as it can; the rig's own if not given.
            The results are the same bit for bit.
        observer: is told how the run goes on.
        stop: ends the run after the present batch; see `stop_on_signals`.
        detector: makes the detector of each test instead of the filter's own.
        bench: what the tests are run on, not entered yet; the rig itself if not given.
        command: the command line that runs it again, for the report; none if not given.

    Raises:
        DirectoryError: the folder cannot be used; nothing was written.
        DriverError: a device of the rig is not there, or not what was configured; nothing moved.
        TripError: the rig could not be made ready for the first test.
        OSError: the results cannot be written.
    """
    stop = stop or StopFlag()
    started = datetime.now(UTC)
    directory = out or default_directory(campaign.name, started)
    names = recording_names(test.name for test in campaign.tests)
    prepare_directory(directory, names)
    setting = Setting(
        campaign=campaign,
        rig=rig,
        bench=bench or _bench_of(campaign, rig, directory, observer or Observer(), stop),
        directory=directory,
        pacer=Pacer(pace or rig.pace, stop),
        observer=observer or Observer(),
        stop=stop,
        references=HealthyReferences(campaign),
        provenance=provenance(campaign, command),
        detector=detector,
    )
    run = _CampaignRun(setting, names, started)
    try:
        with setting.bench:
            run.run()
    finally:
        run.write()
    return run.outcome


def _bench_of(
    campaign: Campaign, rig: Rig, directory: Path, observer: Observer, stop: StopFlag
) -> Bench:
    if rig.backend == "simulated":
        return SimulatedBench(rig, directory)
    # Its drivers' libraries are of no use to a simulation.
    from rig.supervisor.session import Session

    rehearse(campaign, rig)

    return Session(rig, campaign.filter_name, campaign.model, directory, stop, observer.rig_tells)


class _CampaignRun:
    """A campaign while it runs."""

    def __init__(self, setting: Setting, recordings: list[str], started: datetime) -> None:
        self._setting = setting
        self._recordings = recordings
        self._started = started
        self._outcomes = [_not_run(test) for test in setting.campaign.tests]
        self._written_at = 0.0

    def run(self) -> None:
        """Run all tests, up to a stop."""
        setting = self._setting
        setting.observer.campaign_begins(setting.campaign, setting.directory)
        # A run that is killed leaves a folder that is known for a run's.
        self.write()
        for number, index in enumerate(setting.references.running_order, start=1):
            if setting.stop.requested:
                return
            test = setting.campaign.tests[index]
            setting.observer.test_begins(number, test)
            self._outcomes[index] = run_test(setting, test, self._recordings[index])
            setting.observer.test_ends(self._outcomes[index])
            if time.monotonic() - self._written_at > _WRITE_EVERY_S:
                self.write()

    def write(self) -> None:
        """Write the results as far as they have come."""
        directory = self._setting.directory
        write_results(self.outcome, directory / RESULTS)
        write_junit(self.outcome, directory / JUNIT)
        self._written_at = time.monotonic()

    @property
    def outcome(self) -> CampaignOutcome:
        """What has come of the campaign so far."""
        campaign = self._setting.campaign
        return CampaignOutcome(
            name=campaign.name,
            description=campaign.description,
            rig=self._setting.rig.name,
            model=campaign.model.name,
            filter=campaign.filter_name,
            false_alarms_per_day=campaign.false_alarms_per_day,
            started=self._started.isoformat(timespec="seconds"),
            tests=tuple(self._outcomes),
            provenance=self._setting.provenance,
        )


def _not_run(test: CampaignTest) -> TestOutcome:
    return TestOutcome(test.name, str(test.expect), Status.NOT_RUN, test.seed, test.duration_s)
