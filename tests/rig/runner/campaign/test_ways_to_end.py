"""Whatever ends a campaign, its exit code, results and journal say the same of it."""

import errno
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from junitparser import JUnitXml

from rig.configuration.rigs.rig import Rig
from rig.io.driver import DriverError
from rig.loop.interlocks.trip import StopRequestedError, TripError
from rig.loop.simulated_loop import SimulatedLoop
from rig.recording import McapWriter
from rig.runner import CampaignOutcome, Observer, Status, StopFlag, run_campaign
from rig.runner.campaign.operator_requests import Desk
from rig.runner.campaign.simulated_bench import SimulatedBench
from tests.rig.runner.conftest import MakeCampaign, MakeTest

OPEN = "the emergency stop is open: make the rig safe and release its button"
NOBODY = DriverError("daq", "nobody answers at 127.0.0.1", "switch it on")


class Ending(SimulatedBench):
    """A simulated rig on which something ends the campaign outside of its tests."""

    def __init__(self, rig: Rig, directory: Path, way: "Way", stop: StopFlag) -> None:
        super().__init__(rig, directory)
        self._way, self._stop = way, stop

    def _raise(self, error: Exception | None) -> None:
        if isinstance(error, StopRequestedError):
            self._stop.request("SIGINT")
        if error is not None:
            raise error

    def __enter__(self) -> "Ending":
        self._raise(self._way.on_entering)
        return self

    def idle(self) -> None:
        self._raise(self._way.between)

    def __exit__(self, *_: object) -> None:
        self._raise(self._way.on_leaving)


@dataclass(frozen=True)
class Way:
    """How a campaign of two tests ends.

    Attributes:
        what: ends it.
        exit_code: that is promised.
        statuses: of its tests.
        says: what the operator reads of it, in the journal, if it is noted there.
        on_entering, between, on_leaving: what the rig raises then; `between` while it is paused.
        in_test: what the first test meets.
    """

    what: str
    exit_code: int
    statuses: tuple[Status, Status]
    says: str = ""
    on_entering: Exception | None = None
    between: Exception | None = None
    on_leaving: Exception | None = None
    in_test: Exception | None = None
    expect: dict[str, Any] = field(default_factory=dict)


PASSED, NOT_RUN = (Status.PASSED, Status.PASSED), (Status.NOT_RUN, Status.NOT_RUN)
TRIPPED = (Status.TRIPPED, Status.NOT_RUN)
FULL_DISK = OSError(errno.ENOSPC, "No space left on device")

WAYS = [
    Way("all as expected", 0, PASSED),
    Way(
        "a verdict that was not expected", 1, (Status.FAILED, Status.FAILED),
        expect={"expect": "internal_leakage"},
    ),
    Way(
        "a crash of a test", 1, (Status.ERROR, Status.ERROR), in_test=ZeroDivisionError("no lag")
    ),
    Way("a device that is not there", 2, NOT_RUN, on_entering=NOBODY),
    Way("an emergency stop that is open at the start", 3, NOT_RUN, OPEN, TripError(OPEN)),
    Way("a trip while the rig is armed", 3, NOT_RUN, "tripped: x", TripError("tripped: x")),
    Way("a stop while the rig is armed", 3, NOT_RUN, "SIGINT", StopRequestedError("SIGINT")),
    Way("a trip in a test", 3, TRIPPED, "a trip", in_test=TripError("tripped: x")),
    Way("a stop in a test", 3, (Status.ABORTED, Status.NOT_RUN), in_test=StopRequestedError("x")),
    Way("a full disk in a test", 3, TRIPPED, "a full disk", in_test=FULL_DISK),
    Way("a trip between two tests", 3, NOT_RUN, "tripped: x", between=TripError("tripped: x")),
    Way("a stop between two tests", 3, NOT_RUN, "SIGINT", between=StopRequestedError("x")),
    Way("a trip on the way out", 3, PASSED, "tripped: x", on_leaving=TripError("tripped: x")),
]  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """What is left of a campaign."""

    outcome: CampaignOutcome | None
    told: list[str]
    folder: Path

    @property
    def results(self) -> dict[str, Any]:
        return dict(json.loads((self.folder / "results.json").read_text()))

    @property
    def journal(self) -> list[dict[str, Any]]:
        return [
            json.loads(line) for line in (self.folder / "journal.jsonl").read_text().splitlines()
        ]


class Listener(Observer):
    """Keeps what the operator is shown."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def rig_tells(self, text: str) -> None:
        self.told.append(text)


@pytest.fixture
def end(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[[Way], Ended]:
    """Run a campaign of two tests to its end."""

    def run(way: Way) -> Ended:
        stop, listener = StopFlag(), Listener()

        def position(_: SimulatedLoop) -> None:
            if isinstance(way.in_test, StopRequestedError):
                stop.request("SIGTERM")
            if way.in_test is not None:
                raise way.in_test

        with monkeypatch.context() as patch:
            bench = Ending(rig, tmp_path, way, stop)
            patch.setattr("rig.runner.campaign.campaign_run.bench_of", lambda *_: bench)
            if isinstance(way.in_test, OSError):
                patch.setattr(McapWriter, "write", lambda *_: position(None))  # type: ignore[arg-type]
            elif way.in_test is not None:
                patch.setattr(SimulatedLoop, "position", position)
            desk = Desk()
            desk.paused = way.between is not None
            campaign = make_campaign(
                make_test(duration_s=9.0, **way.expect),
                make_test("second", duration_s=9.0, **way.expect),
            )
            outcome = None
            with suppress(DriverError):
                outcome = run_campaign(
                    campaign, rig, tmp_path, observer=listener, stop=stop, desk=desk
                )
        return Ended(outcome, listener.told, tmp_path)

    return run


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.what)
def test_a_campaign_ends_with_the_exit_code_that_is_promised(
    end: Callable[[Way], Ended], way: Way
) -> None:
    ended = end(way)
    results = ended.results
    assert results["exit_code"] == way.exit_code
    assert [test["status"] for test in results["tests"]] == list(way.statuses)
    assert len(next(iter(JUnitXml.fromfile(str(ended.folder / "junit.xml"))))) == 2
    if ended.outcome is None:
        assert way.on_entering is NOBODY
        return
    assert ended.outcome.exit_code == way.exit_code
    last = ended.journal[-1]
    assert (last["kind"], last["exit_code"]) == ("end", way.exit_code)
    assert way.says in last["reason"]
    for error in (way.on_entering, way.between, way.on_leaving):
        if error is not None and not isinstance(error, StopRequestedError):
            assert str(error) in ended.told


def test_a_full_disk_is_named_with_its_remedy(end: Callable[[Way], Ended]) -> None:
    (full,) = (way for way in WAYS if way.in_test is FULL_DISK)
    first, _ = end(full).results["tests"]
    assert first["message"] == (
        "the recording cannot be written: the disk is full; "
        "free space, or have it written to another disk"
    )
