"""Campaigns run one after the other on a rig that is armed once for all of them."""

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from control import Setpoint
from estimator.filters import DEFAULT_FILTER, FilterMemory, FilterRun
from estimator.leaks import Decision, Samples
from faults import Campaign, CampaignTest, Verdict
from rig.configuration import Rig
from rig.plant import Model
from rig.recording import Recording, read_recording
from rig.runner.campaign import Bench, Loop, Pace, StopFlag, Writer, run_campaign
from rig.runner.outcomes import EXIT_STOPPED, CampaignOutcome, Observer, Status


def part_test(
    name: str, setpoint: Setpoint, duration_s: float, start: float, settle_s: float, seed: int = 0
) -> CampaignTest:
    """Return a healthy test of an experiment, from which no verdict is expected.

    Args:
        name: of the test.
        setpoint: what it asks of the ram.
        duration_s: how long it takes.
        start: where the ram is brought before, m.
        settle_s: how long the ram may take to settle there.
        seed: of a simulated rig's noise.
    """
    return CampaignTest(
        name=name,
        test_name=name,
        duration_s=duration_s,
        start_position_m=start,
        settle_s=settle_s,
        setpoint=setpoint,
        load=None,
        faults=(),
        expect=Verdict.INCONCLUSIVE,
        repeat=1,
        seed=seed,
    )


def part_campaign(
    name: str, description: str, rig: Rig, assumed: Model, tests: Iterable[CampaignTest]
) -> Campaign:
    """Return the campaign of one part of an experiment.

    Args:
        name: of the campaign, and of its folder.
        description: in a line.
        rig: that it is run on.
        assumed: what the filter of its recordings assumes.
        tests: in their order.
    """
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
    """The experiment came to no end; its recordings so far are on disk.

    Attributes:
        exit_code: what the command exits with.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class Parts:
    """Runs the campaigns that an experiment consists of, one after the other.

    Args:
        rig: they are run on.
        directory: an existing folder; each campaign gets a folder in it.
        bench: entered and left by the caller.
        pace: as of `run_campaign`.
        observer: likewise.
        stop: likewise.

    Attributes:
        recordings: files so far, within the directory.
    """

    def __init__(
        self,
        rig: Rig,
        directory: Path,
        bench: Bench,
        pace: Pace | None,
        observer: Observer,
        stop: StopFlag,
    ) -> None:
        self._rig, self._directory, self._bench = rig, directory, _Kept(bench)
        self._pace: Pace | None = pace
        self._observer, self._stop = observer, stop
        self.recordings: list[str] = []

    def run(self, campaign: Campaign) -> dict[str, Recording]:
        """Run a campaign to its end and return the recording of each test, by its name.

        Raises:
            ExperimentStoppedError: it tripped, was stopped, or a test crashed.
        """
        return {name: read_recording(path) for name, path in self.record(campaign).items()}

    def record(self, campaign: Campaign) -> dict[str, Path]:
        """Run a campaign to its end and return the file of each test, by its name.

        Raises:
            ExperimentStoppedError: it tripped, was stopped, or a test crashed.
        """
        folder = self._directory / campaign.name
        outcome = run_campaign(
            campaign, self._rig, folder, pace=self._pace, observer=self._observer,
            stop=self._stop, detector=_Undecided, bench=self._bench,
        )  # fmt: skip
        _require_complete(outcome)
        found = {}
        for test in outcome.tests:
            file = folder / str(test.recording)
            self.recordings.append(str(file.relative_to(self._directory)))
            found[test.name] = file
            self._bench.idle()
        return found


def _require_complete(outcome: CampaignOutcome) -> None:
    for test in outcome.tests:
        if test.status in (Status.PASSED, Status.FAILED):
            continue
        message = f"{test.name}: {test.status}; {test.message or 'nothing was identified'}"
        crashed = test.status == Status.ERROR
        raise ExperimentStoppedError(message, 1 if crashed else EXIT_STOPPED)


class _Undecided:
    """A detector that holds nothing: the experiment looks for no leak."""

    def __init__(self, model: Model) -> None:
        self._decision = Decision(Verdict.INCONCLUSIVE)

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take no note."""

    def decide(self) -> Decision:
        """Return that nothing can be said."""
        return self._decision


class _Kept:
    """A bench that is entered and left by someone else, so that several campaigns share it."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.live = bench.live

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> Loop:
        return self._bench.loop(test, memory, assumed)

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> AbstractContextManager[Writer]:
        return self._bench.writer(path, channels, metadata)

    def reading(self, channel: str) -> float | None:
        return self._bench.reading(channel)

    def idle(self) -> None:
        self._bench.idle()

    def __enter__(self) -> "_Kept":
        return self

    def __exit__(self, *_: object) -> None:
        pass
