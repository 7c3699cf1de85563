"""Prepares the section of each test: reads its recording, draws its plots and marks its times."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from estimator.evidence import AccountHistory, KeptAccounts
from estimator.filters import DEFAULT_FILTER
from rig.loop import TIMING
from rig.plant import LEAKS, Model
from rig.recording import Event, Recording, RecordingError, read_recording, recover
from rig.report.accounts import account_history
from rig.report.friction import friction
from rig.report.panel import POINTS, Panel, TestData
from rig.report.wording import conditions_of, is_after, label, loop_conditions, story
from rig.runner.outcomes import (
    CampaignOutcome,
    Status,
    TestOutcome,
    account_detector_of,
    assumed_parameters,
    onset_shown,
    with_estimates,
)

from .leaks import compensation, evidence, leak_flows, missing_flow, probability
from .signals import command, innovation, motion, pressures
from .tables import LimitRow, SegmentRow, limit_rows, segment_rows

_ACCOUNT_PANELS: Final = (
    motion, command, compensation, pressures, missing_flow, leak_flows, probability, evidence,
    innovation, friction,
)  # fmt: skip
_PATTERN_PANELS: Final = (
    motion, command, compensation, pressures, innovation, leak_flows, probability,
)  # fmt: skip
_FULL_DETAIL_TESTS: Final = 12
_LEAST_POINTS: Final = 400
_MANY_EVENTS: Final = 40

Flows = dict[str, float]


@dataclass(frozen=True)
class Section:
    """The section of the report about one test.

    Attributes:
        test: the test's outcome.
        story: what happened, in sentences.
        notes: sentences on what is missing in the section, and why.
        conditions: setpoint, load and timing of the loop, as (name, text).
        panels: the plots; empty without a readable recording.
        marks: the times that are marked by a vertical line in every plot, in their order, each with
            its `kind` (`injected`, `removed`, `onset`, `gone` or `detected`), `time` in s, and
            label, `text`.
        spans: the stretches of time that are shaded in every plot, from `start` to `end`, s, with
            what the loop did about a fault then, `text`.
        events: the first events of the recording, 40 at most, without the timing of the loop.
        start_s, end_s: begin and end of the time axis; it reaches to the planned end if the test
            ended early.
        recorded_until_s: time at which the recording ends, s.
        smallest: the smallest leak flows that would have been found, by the kind of leak, m^3/s at
            the leak's reference drop: first for leaks that begin during the test, then for leaks
            that are there from the start. The second is empty if it is not known; None stands for
            both if the first is not known.
        segments: rows of the table of segments, and how many more segments there are.
        limits: rows of the table of limits.
        opened: whether the page shows the section unfolded at first.
    """

    test: TestOutcome
    story: str
    notes: tuple[str, ...]
    conditions: tuple[tuple[str, str], ...] = ()
    panels: tuple[Panel, ...] = ()
    marks: tuple[dict[str, Any], ...] = ()
    spans: tuple[dict[str, Any], ...] = ()
    events: tuple[Event, ...] = ()
    start_s: float = 0.0
    end_s: float = 0.0
    recorded_until_s: float = 0.0
    smallest: tuple[Flows, Flows] | None = None
    opened: bool = False
    segments: tuple[tuple[SegmentRow, ...], int] = ((), 0)
    limits: tuple[LimitRow, ...] = ()

    @property
    def figures(self) -> dict[str, Any]:
        """The data from which the page's script draws the section's plots, JSON-able."""
        return {
            "start": self.start_s,
            "end": self.end_s,
            "recorded": self.recorded_until_s,
            "spans": self.spans,
            "marks": self.marks,
            "panels": {panel.key: panel.figure for panel in self.panels},
        }


def sections_of(
    outcome: CampaignOutcome, directory: Path, kept: KeptAccounts | None = None
) -> list[Section]:
    """Return a section for each test, in the campaign's order.

    Args:
        outcome: the campaign's outcome.
        directory: folder of its recordings.
        kept: the accounts that were kept as the tests ran; None if none were.
    """
    opened = _worth_opening(outcome)
    return [
        _section(outcome, test, directory, kept or KeptAccounts(), opened=index == opened)
        for index, test in enumerate(outcome.tests)
    ]


def _worth_opening(outcome: CampaignOutcome) -> int:
    """Return the index of the test to show unfolded.

    It is the first test that failed or crashed, else the first with an injected fault and a
    recording, else the first.
    """
    tests = outcome.tests
    failed = [i for i, t in enumerate(tests) if t.status in (Status.FAILED, Status.ERROR)]
    leaking = [i for i, t in enumerate(tests) if t.injected and t.recording]
    return (failed + leaking + [0])[0]


def _section(
    outcome: CampaignOutcome,
    test: TestOutcome,
    directory: Path,
    kept: KeptAccounts,
    *,
    opened: bool,
) -> Section:
    recording, notes = _recording(test, directory)
    happened = "" if test.status is Status.NOT_RUN else story(test)
    if recording is None:
        limits = limit_rows(test, {})
        return Section(
            test, happened, notes, smallest=_smallest(test, None), opened=opened, limits=limits
        )
    parameters = assumed_parameters(recording.metadata)
    accounts = None
    if outcome.filter == DEFAULT_FILTER and parameters is not None:
        accounts = _accounts(outcome, test, recording, Model(parameters=parameters), kept)
    if outcome.filter == DEFAULT_FILTER and accounts is None:
        lacking = "Without the filter's estimates, model and baseline no oil account can be drawn."
        notes = (*notes, lacking)
    points = _points(len(outcome.tests))
    data = TestData(test, recording, outcome.filter, parameters, accounts, points)
    draw = _ACCOUNT_PANELS if outcome.filter == DEFAULT_FILTER else _PATTERN_PANELS
    last = float(recording.time_s[-1])
    notes = (*notes, *not_reached(recording.metadata, last))
    return Section(
        test,
        happened,
        notes,
        (*conditions_of(recording.metadata), *_counted(test), *loop_conditions(recording)),
        tuple(panel for drawn in draw if (panel := drawn(data)) is not None),
        _marks(test, last),
        _spans(test, last),
        tuple(event for event in recording.events if event.kind != TIMING)[:_MANY_EVENTS],
        float(recording.time_s[0]),
        last if _is_over_early(test) else max(last, test.duration_s),
        last,
        _smallest(test, accounts),
        opened,
        segment_rows(test, recording),
        limit_rows(test, recording.metadata),
    )


def _accounts(
    outcome: CampaignOutcome,
    test: TestOutcome,
    recording: Recording,
    model: Model,
    kept: KeptAccounts,
) -> AccountHistory | None:
    """Return a test's accounts, as they were kept if it ran to its end, else from its recording.

    Of a test that was stopped, the detector may not have judged the last rows.
    """
    if test.recording is not None and test.status in (Status.PASSED, Status.FAILED):
        history = kept.history(test.recording)
        if history is not None:
            return history
    detector = account_detector_of(recording, model, outcome.false_alarms_per_day)
    return None if detector is None else account_history(recording, detector)


def _is_over_early(test: TestOutcome) -> bool:
    """Return whether a test ran to its end, and earlier than at the latest as segments ended."""
    ended = test.status in (Status.PASSED, Status.FAILED)
    return ended and any(each.ended_early for each in test.segments)


def _counted(test: TestOutcome) -> tuple[tuple[str, str], ...]:
    return () if test.counted is None else (("Done", str(test.counted)),)


def _points(tests: int) -> int:
    """Return the greatest number of points of a trace, for a campaign with some number of tests.

    It is smaller in a large campaign, so that a browser can still open the page.
    """
    pairs = POINTS * _FULL_DETAIL_TESTS // max(tests, _FULL_DETAIL_TESTS) // 2
    return max(_LEAST_POINTS, 2 * pairs)


def _recording(test: TestOutcome, directory: Path) -> tuple[Recording | None, tuple[str, ...]]:
    """Return the readable part of a test's recording, and notes on what cannot be read.

    What the filter estimated is made again where the recording leaves it out.
    The recording is None if there is none, or if nothing of it can be read.
    """
    if test.recording is None:
        missing = "There is no recording of this test."
        has_none = test.status is Status.NOT_RUN or test.leak_test is not None
        return None, () if has_none else (missing,)
    path = directory / test.recording
    try:
        return with_estimates(read_recording(path, required=("time_s",))), ()
    except RecordingError as error:
        problems = "; ".join(f"{p.field}: {p.value}" for p in error.problems)
    note = f"The recording {test.recording} cannot be read ({problems})."
    with TemporaryDirectory() as folder:
        try:
            kept = recover(path, Path(folder) / "kept.mcap")
            recording = read_recording(kept.path_out, required=("time_s",))
        except (RecordingError, OSError):
            return None, (note,)
    shown = f"{kept.first_time_s:.1f} s to {kept.last_time_s:.1f} s"
    return with_estimates(recording), (f"{note} Shown is what could be recovered, {shown}.",)


def not_reached(metadata: Mapping[str, Any], last_s: float) -> Iterator[str]:
    """Yield a note on the faults of a test that were still to come when its recording ended.

    Args:
        metadata: metadata of the recording, which lists the test's faults; an older one may not.
        last_s: time at which the recording ends, s.
    """
    test = metadata.get("test")
    faults = test.get("faults") if isinstance(test, dict) else None
    later = [
        f"{label(fault['kind'])} from {fault['at_s']:.1f} s on"
        for fault in (faults if isinstance(faults, list) else [])
        if isinstance(fault, dict) and {"kind", "at_s"} <= set(fault)
        if isinstance(fault["at_s"], float | int) and is_after(fault["at_s"], last_s)
    ]
    if later:
        yield f"Not reached, as the recording ends at {last_s:.1f} s: {', '.join(later)}."


def _marks(test: TestOutcome, last_s: float) -> tuple[dict[str, Any], ...]:
    """Return the marks of a test whose recording ends at `last_s`, as `Section.marks`.

    The end of a fault is no mark if the recording ended before.
    """
    times: list[tuple[str, str, float | None]] = []
    for fault in test.injected:
        times += [("injected", "injected", fault.at_s)]
        if fault.until_s is not None and not is_after(fault.until_s, last_s):
            times += [("removed", "removed", fault.until_s)]
    if test.decision is not None and test.decision.onset_s is not None:
        times += [("onset", "onset found", onset_shown(test.decision))]
        words = "gone again" if test.decision.returns is None else "last open until"
        times += [("gone", words, test.decision.ended_s)]
    times += [("detected", "detected", test.detected_at_s)]
    marks = (
        {"kind": kind, "time": time_s, "text": f"{words} {time_s:.1f} s"}
        for kind, words, time_s in times
        if time_s is not None
    )
    return tuple(sorted(marks, key=lambda mark: mark["time"]))


def _spans(test: TestOutcome, last_s: float) -> tuple[dict[str, Any], ...]:
    """Return the loop's actions about faults as spans, with `start` and `end` in s, and `text`.

    An action that begins at the end of one of the same kind lengthens its span: a leak that is
    tolerated with a new estimate of its coefficient does not begin a new span.
    An action without an end reaches to `last_s`.
    """
    spans: list[dict[str, Any]] = []
    for action in test.actions:
        end_s = last_s if action.until_s is None else action.until_s
        text = action.what.split(" ", 1)[0]
        if spans and (spans[-1]["text"], spans[-1]["end"]) == (text, action.at_s):
            spans[-1]["end"] = end_s
        else:
            spans.append({"start": action.at_s, "end": end_s, "text": text})
    return tuple(spans)


def _smallest(test: TestOutcome, accounts: AccountHistory | None) -> tuple[Flows, Flows] | None:
    """Return the smallest leaks that would have been found, as `Section.smallest`.

    The final decision has them unless it names a fault; then they come from the last decision
    before that fault, by the oil accounts.
    """
    decided = {} if test.decision is None else test.decision.details
    for details in (decided, {} if accounts is None else accounts.smallest):
        begun, there = (
            {leak: details[key] for leak in LEAKS if (key := f"{kind}_{leak}_m3_per_s") in details}
            for kind in ("smallest", "smallest_from_start")
        )
        if len(begun) == len(LEAKS):
            return begun, there if len(there) == len(LEAKS) else {}
    return None
