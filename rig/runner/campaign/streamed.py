"""Sends what a campaign's run reports, and the rows of its tests, to the live stream."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from estimator.leaks import Decision
from faults import Campaign, CampaignTest
from rig.loop import Board
from rig.runner.outcomes import (
    EXIT_BAD_INPUT,
    EXIT_STOPPED,
    Array,
    Observer,
    Status,
    TestOutcome,
    grows,
    named,
)
from rig.supervisor import Errand, Onlooker, RowFeed, Stream, trips_told

PROGRESS_S: Final = 0.1
"""Shortest time between two messages about the progress of a test, s."""
CAMPAIGN_S: Final = 0.5
"""Shortest time between two messages that list all tests, s; important changes are sent at once."""


class StreamedRun(Observer, Onlooker):
    """An observer that sends what a run reports to a stream, and passes it on to another observer.

    Args:
        stream: the live stream of the rig, which `ends` closes.
        inner: the other observer.
        simulated: whether the rig is simulated, so that this observer sends the rows that the
            runner reports. On hardware the stream reads the rows from the loop's ring.
        live: whether the run is paced by the wall clock.
        by: name of who started the run, or went on with it; empty if that is not known.
        activity: what is done with the rig, such as "homing"; empty if it is only a campaign.
        idle: whether it is a station that only reads, so that nothing drives the rig.
    """

    def __init__(
        self,
        stream: Stream,
        inner: Observer,
        *,
        simulated: bool,
        live: bool,
        by: str = "",
        activity: str = "",
        idle: bool = False,
    ) -> None:
        self.stream = stream
        self._idle = idle
        self._live = live
        self._by = by
        self._activity = activity
        self._inner = inner
        self._simulated = simulated
        self._feed: RowFeed | None = None
        self._state: dict[str, Any] = {}
        """The content of the last message `state`, without what is compiled in that state."""
        self._campaign: dict[str, Any] = {}
        self._tests: dict[str, dict[str, Any]] = {}
        self._number = 0
        self._channels: tuple[str, ...] = ()
        self._test: CampaignTest | None = None
        self._decision: Decision | None = None
        self._decided: Mapping[str, Any] = {}
        """The content of the last message `decision`."""
        self._board: Board | None = None
        self._last: Mapping[str, Any] = {}
        self._progress_at = self._listed_at = 0.0
        self._unlisted = False
        self._lock = threading.Lock()
        """Locked while the list of tests changes, which operators change from other threads."""

    def ends(
        self, failed: str = "", tell: Callable[[Mapping[str, Any]], None] | None = None
    ) -> None:
        """Send the message that all has ended, if anything was begun, and close the stream.

        Args:
            failed: why it ended before its end; a campaign that came to tests says by
                `campaign_ends` how it ended, and otherwise its rig was refused.
            tell: is told how it ended before the stream is closed, by the last `campaign`,
                `decision` and `trips` (of `health`) as docs/stream.md describes them.
        """
        if self._campaign:
            self._campaign["status"] = "ended"
            if failed and self._activity:
                self._campaign |= {"exit_code": EXIT_STOPPED, "reason": failed}
            elif failed and "exit_code" not in self._campaign:
                self._campaign |= {"exit_code": EXIT_BAD_INPUT, "reason": failed}
            self._list_tests(last=True)
            if tell is not None:
                trips = {} if self._board is None else trips_told(self._board)
                campaign = {**self._campaign, "tests": [*self._tests.values()]}
                tell({"campaign": campaign, "decision": self._decided, "trips": trips})
        self.stream.close()
        if self._feed is not None:
            self._feed.close()

    @property
    def errand(self) -> Errand:
        """What is done with the rig, and who asked for it."""
        name = self._activity or str(self._campaign.get("name", ""))
        return Errand(name, self._by, self._idle)

    def connects(self, board: Board, channels: tuple[str, ...]) -> None:
        """Let the stream publish the rows of a session on hardware from its board.

        The stream takes commands from then on, before any device is open.

        Args:
            board: the session's board, with the ring of rows.
            channels: names of the rows' columns.
        """
        self._board = board
        self.stream.attach(board, channels)
        if self._activity and not self._campaign:
            self._campaign = {"name": self._activity, "exit_code": 0, "reason": "", **self._said()}
            self._list_tests(last=True)

    def _said(self) -> dict[str, Any]:
        """Return what is said of a campaign and of any other activity when it begins."""
        return {
            "status": "idle" if self._idle else "running",
            "activity": self._activity,
            "begun_by": self._by,
            "begun_ns": time.time_ns(),
            "pausing": False,
            "paused_by": "",
            "held": [],
            **({"last": dict(self._last)} if self._last else {}),
        }

    def came_to(self, state: str) -> None:
        """Send the state that the session on hardware has come to, and the one before."""
        before = self._state.get("state", "")
        self._state = {"state": state, "since_ns": time.time_ns(), "before": before}
        self.stream.send("state", self._state)

    def compiles(self, what: str) -> None:
        """Send what is compiled, and since when; or, with an empty text, that it is compiled."""
        told = {"compiles": what, "compiles_since_ns": time.time_ns()} if what else {}
        self.stream.send("state", {**self._state, **told})

    def moves(self, motion: str, moved: str) -> None:
        """Send which motion by hand has begun, and how the one before it ended."""
        self._campaign |= {"motion": motion, "moved": moved}
        self._list_tests(last=True)

    def came_before(self, last: Mapping[str, Any]) -> None:
        """Send what drove the rig last and how that ended; a station does this."""
        self._last = last
        if self._campaign:
            self._campaign["last"] = dict(last)
            self._list_tests(last=True)

    def hands_over(self, to: str) -> None:
        """Send to whom a station leaves the rig; nobody reads it until that one has connected."""
        self._campaign["hands_over"] = to
        self._list_tests(last=True)

    def ends_for(self, reason: str) -> None:
        """Keep why a station ends this stream and begins another; `ends` sends it."""
        self._campaign |= {"exit_code": 0, "reason": reason}

    def campaign_begins(
        self,
        campaign: Campaign,
        directory: Path,
        finished: Sequence[TestOutcome],
        started: datetime,
        *,
        resumed: bool,
    ) -> None:
        """Send the campaign with all its tests, and the outcomes of the finished ones."""
        self._inner.campaign_begins(campaign, directory, finished, started, resumed=resumed)
        self._campaign = {
            **self._said(),
            "begun_ns": round(1e9 * started.timestamp()),
            "resumed": resumed,
            **named(campaign, "name", "description", rig="rig_name"),
            "model": campaign.model.name,
            "filter": campaign.filter_name,
            "false_alarms_per_day": campaign.false_alarms_per_day,
            "directory": directory.name,
            "rig_time_s": campaign.rig_time_s,
        }
        self._tests = {
            test.name: {
                "name": test.name,
                "expect": self._expected(test),
                "duration_s": test.duration_s,
                "status": "",
                "verdict": "",
            }
            for test in campaign.tests
        }
        for outcome in finished:
            self._note(outcome)
        self._list_tests(last=True)

    def campaign_stands(self, *, pausing: bool, held: Sequence[str], by: str = "") -> None:
        """Send whether a pause is requested, and the reasons why conditions hold the campaign."""
        self._inner.campaign_stands(pausing=pausing, held=held, by=by)
        with self._lock:
            self._campaign |= {"pausing": pausing, "paused_by": by, "held": list(held)}
        self._list_tests(last=True)

    def campaign_ends(self, exit_code: int, reason: str) -> None:
        """Keep the exit code and the reason of the end, which `ends` sends once the rig is safe."""
        self._inner.campaign_ends(exit_code, reason)
        with self._lock:
            self._campaign |= {"exit_code": exit_code, "reason": reason}

    def rig_tells(self, text: str) -> None:
        """Send a line that is shown to the operator."""
        self._inner.rig_tells(text)
        self.stream.event("rig", "told", text)

    def test_begins(self, number: int, test: CampaignTest) -> None:
        """Send the progress of a test that begins, and the tests' list, in which it is running.

        `number` is the test's place in the order of running, from 1.
        """
        self._inner.test_begins(number, test)
        self._number, self._test, self._decision = number, test, None
        with self._lock:
            self._tests.setdefault(test.name, {"name": test.name})["status"] = "running"
        self._list_tests(last=False)
        self._send_progress(0.0)

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        """Send the detector's decision on a test if it is new, and the test's progress.

        The progress is sent at most every 0.1 s; `time_s` is the time of the last row, s.
        """
        self._inner.test_advances(time_s, decision)
        if decision is not None and decision is not self._decision:
            self._decision = decision
            interval = decision.interval_m3_per_s
            returns = decision.returns
            # The list of openings is not sent: it would make each message some ten times longer.
            content = asdict(replace(decision, returns=None, drift=None, growth=None)) | {
                "time_s": time_s,
                "test": self._number,
                "name": self._test.name if self._test else "",
                "interval_m3_per_s": None if interval is None else list(interval),
                "suspected": decision.suspected,
                "could_also_be": ", ".join(decision.could_also_be),
                "intermittent": returns is not None,
                "duty": None if returns is None else returns.duty,
                "openings": 0 if returns is None else returns.openings,
            }
            del content["returns"], content["drift"]
            content["growth"] = "" if decision.growth is None else grows(decision.growth)
            self._decided = content
            self.stream.send("decision", content)
        if time.monotonic() - self._progress_at >= PROGRESS_S:
            self._send_progress(time_s)
            if self._unlisted:
                self._list_tests(last=False)

    def test_ends(self, outcome: TestOutcome) -> None:
        """Send the outcome of a test that has ended."""
        self._inner.test_ends(outcome)
        self._note(outcome)
        self._send_progress(outcome.recorded_s)
        self._list_tests(last=False)

    def test_skipped(self, outcome: TestOutcome) -> None:
        """Send the list of tests, in which this one is left out."""
        self._inner.test_skipped(outcome)
        self._note(outcome)
        self._list_tests(last=False)

    def test_runs(self, channels: tuple[str, ...], segment: int | None) -> None:
        """Give the stream the names of the columns of the present test's rows, before any row.

        Args:
            channels: names of the columns.
            segment: number of the loop's segment on hardware, None on a simulated rig.
        """
        self._inner.test_runs(channels, segment)
        self._channels = channels
        # On hardware each test is a segment of the loop; simulated rows carry the test's number.
        self.stream.columns(self._number if segment is None else segment, channels, self._number)

    def test_rows(self, rows: Array) -> None:
        """Send rows of the present test, (n, channels), if the rig is simulated.

        On hardware the stream reads the rows from the loop's ring.
        """
        self._inner.test_rows(rows)
        if self._simulated:
            if self._feed is None:
                self._feed = RowFeed(self.stream, self._channels, live=self._live)
            self._feed.add(rows, self._number)

    def test_event(self, time_s: float, kind: str, text: str) -> None:
        """Send an event of the present test; `time_s` counts from the test's first sample."""
        self._inner.test_event(time_s, kind, text)
        self.stream.event("test", kind, text, time_s)

    def _expected(self, test: CampaignTest | None) -> str:
        """Return the verdict that is expected of a test; "" of a motion, which has no verdict."""
        return "" if test is None or self._activity else str(test.expect)

    def _note(self, outcome: TestOutcome) -> None:
        status, verdict = outcome.status, outcome.decision.verdict if outcome.decision else ""
        if self._activity:
            # A motion has no verdict that could be wrong.
            status, verdict = Status.PASSED if status == Status.FAILED else status, ""
        with self._lock:
            self._tests.setdefault(outcome.name, {"name": outcome.name}).update(
                status=str(status),
                verdict=verdict,
                message=outcome.message,
            )

    def _send_progress(self, time_s: float) -> None:
        self._progress_at = time.monotonic()
        test = self._test
        self.stream.send(
            "progress",
            {
                "number": self._number,
                "count": len(self._tests),
                "name": test.name if test else "",
                "expect": self._expected(test),
                "time_s": time_s,
                "duration_s": test.duration_s if test else 0.0,
                "verdict": self._decision.verdict if self._decision else "",
            },
        )

    def _list_tests(self, *, last: bool) -> None:
        now = time.monotonic()
        self._unlisted = True
        if last or now - self._listed_at >= CAMPAIGN_S:
            self._listed_at, self._unlisted = now, False
            with self._lock:
                tests = [dict(test) for test in self._tests.values()]
                self.stream.send("campaign", {**self._campaign, "tests": tests})
