"""Runs the campaigns of an experiment one after the other, with a rig that is armed only once."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from control import ControlSettings
from estimator.filters import DEFAULT_FILTER, FilterRun
from estimator.leaks import Decision, Samples
from faults import Campaign, CampaignTest, Verdict
from rig.configuration import Rig
from rig.plant import Model
from rig.recording import Recording, read_recording
from rig.runner.campaign import Bench, Pace, StopFlag, bench_of, run_campaign
from rig.runner.outcomes import EXIT_STOPPED, Observer, Status

MARGIN_M: Final = 0.02
"""Distance of the motions from the limits of the stroke, m; the ram overshoots by less."""


def stroke_of(rig: Rig) -> tuple[float, float]:
    """Return the lowest and the highest position, m, to which an experiment may move a ram."""
    return rig.limits.position_min_m + MARGIN_M, rig.limits.position_max_m - MARGIN_M


def part_campaign(
    name: str, description: str, rig: Rig, assumed: Model, tests: Iterable[CampaignTest]
) -> Campaign:
    """Return the campaign of one part of an experiment.

    Its tests run under the proportional loop with the rig's `position_gain`, by which experiments
    plan their motions, whatever control the rig has, unless a test has a control of its own.

    Args:
        name: name of the campaign, and of its folder.
        description: one line for the reports.
        rig: the rig that it is run on.
        assumed: the model that the filter assumes.
        tests: the tests in the order of running.
    """
    if rig.control != ControlSettings():
        plainly = ControlSettings()
        tests = [each if each.control else replace(each, control=plainly) for each in tests]
    return Campaign(
        name=name,
        description=description,
        rig_name=rig.name,
        model=assumed,
        filter_name=DEFAULT_FILTER,
        false_alarms_per_day=1.0,
        tests=tuple(tests),
    )


class ExperimentStoppedError(Exception):
    """Raised if an experiment ends early; its recordings so far are on disk.

    Attributes:
        exit_code: exit code for the command that ran the experiment: 1 after a crash, else 3.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


@dataclass
class Parts:
    """Runs the campaigns that an experiment consists of, one after the other.

    Attributes:
        rig: the rig that the campaigns are run on.
        directory: an existing folder; each campaign gets a folder in it.
        bench: the bench of the rig, whose context the caller enters and leaves.
        pace: pace of a simulated rig, "real" or "fast"; None for the pace of the rig's file.
        observer: its methods are called as the campaigns go on.
        stop: once a stop is requested on it, the campaign ends after the present batch.
        recordings: paths of all recordings so far, relative to `directory`.
    """

    rig: Rig
    directory: Path
    bench: Bench
    pace: Pace | None
    observer: Observer
    stop: StopFlag
    recordings: list[str] = field(default_factory=list)

    def run(self, campaign: Campaign) -> dict[str, Recording]:
        """Run a campaign and return the recording of each test, by the test's name.

        Raises:
            ExperimentStoppedError: a test was not run to its end: the rig tripped, the campaign was
                stopped, an operator had the test skipped, or it crashed.
            DirectoryError: the campaign's folder cannot be used.
            TripError: the rig tripped, or was stopped, after the last test.
            OSError: the results cannot be written.
            RecordingError: a recording cannot be read.
        """
        return {name: read_recording(path) for name, path in self.record(campaign).items()}

    def record(self, campaign: Campaign) -> dict[str, Path]:
        """Run a campaign and return the path of each test's recording, by the test's name.

        Raises:
            ExperimentStoppedError: a test was not run to its end: the rig tripped, the campaign was
                stopped, an operator had the test skipped, or it crashed.
            DirectoryError: the campaign's folder cannot be used.
            TripError: the rig tripped, or was stopped, after the last test.
            OSError: the results cannot be written.
        """
        folder = self.directory / campaign.name
        outcome = run_campaign(
            campaign, self.rig, folder, pace=self.pace, observer=self.observer, stop=self.stop,
            detector=lambda model: _Undecided(), bench=self.bench,
        )  # fmt: skip
        for test in outcome.tests:
            if test.status not in (Status.PASSED, Status.FAILED):
                message = f"{test.name}: {test.status}; {test.message or 'nothing was identified'}"
                crashed = test.status == Status.ERROR
                raise ExperimentStoppedError(message, 1 if crashed else EXIT_STOPPED)
        found = {}
        for test in outcome.tests:
            file = folder / str(test.recording)
            self.recordings.append(str(file.relative_to(self.directory)))
            found[test.name] = file
            self.bench.idle()
        return found


@contextmanager
def connected_parts(
    first: Campaign,
    rig: Rig,
    directory: Path,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
) -> Iterator[Parts]:
    """Connect a rig, yield what runs an experiment's campaigns on it, and leave the rig at the end.

    Args:
        first: the campaign that is run first.
        rig: a simulated rig, or one on hardware.
        directory: an existing folder; each campaign gets a folder in it.
        pace: as `Parts.pace`.
        observer: as `Parts.observer`; nobody is told if it is not given.
        stop: as `Parts.stop`; nobody stops the experiment if it is not given.

    Raises:
        DriverError: a device of the rig is missing, or is not the configured one.
        TripError: the rig tripped before the first test.
    """
    stop, observer = stop or StopFlag(), observer or Observer()
    with bench_of(first, rig, directory, observer, stop) as bench:
        yield Parts(rig, directory, bench, pace, observer, stop)


class _Undecided:
    """A detector that always decides "inconclusive", as an experiment looks for no leak."""

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Do nothing with the samples."""

    def decide(self) -> Decision:
        """Return the decision "inconclusive"."""
        return Decision(Verdict.INCONCLUSIVE)
