"""Writes a campaign's report, one HTML file that needs no other file and no network.

Its first part is the table of verdicts, and how sure the verdicts are.
"""

import shlex
from dataclasses import dataclass
from math import ceil, floor, isfinite, log10
from pathlib import Path
from typing import Final

from estimator.evidence import KeptAccounts
from estimator.filters import DEFAULT_FILTER
from estimator.leaks import LEARNING_S
from faults import to_litres_per_minute
from rig.plant import LEAKS
from rig.recording import replace_text
from rig.report import wording
from rig.report.calibrations import calibration_rows
from rig.report.leak_test import HEADINGS, leak_rows, leak_sentences, soak_rows
from rig.report.templating import rendered
from rig.runner.outcomes import CampaignOutcome, Status, TestOutcome, chance, onset_shown, reaction
from rig.runner.run_folder import REPORT

from .sections import Section, sections_of

DAY_S: Final = 86400.0


def write_report(
    outcome: CampaignOutcome, directory: Path, kept: KeptAccounts | None = None
) -> Path:
    """Write `report.html` to a run's folder, and return its path.

    If a recording is missing or cannot be read, the report has a note in place of its plots.

    Args:
        outcome: the campaign's outcome, complete or not.
        directory: the run's folder, with the recordings that the outcome names.
        kept: the accounts that were kept as the tests ran; those of other tests are made anew.

    Raises:
        OSError: the folder cannot be written to.
    """
    path = directory / REPORT
    replace_text(path, render(outcome, directory, kept))
    return path


def render(outcome: CampaignOutcome, directory: Path, kept: KeptAccounts | None = None) -> str:
    """Return the report of a campaign as HTML.

    If a recording is missing or cannot be read, the report has a note in place of its plots.

    Args:
        outcome: the campaign's outcome, complete or not.
        directory: the run's folder, with the recordings that the outcome names.
        kept: as for `write_report`.
    """
    sections, scale = sections_of(outcome, directory, kept), full_scale(outcome)
    rows = [row_of(section, scale) for section in sections]
    return rendered(
        "report.html.j2",
        "report.js",
        outcome=outcome,
        started=wording.when(outcome.started),
        headline=wording.headline(outcome),
        summary=wording.detection_summary(outcome),
        labels=wording.STATUS_LABELS,
        words=wording,
        reaction=reaction,
        good=all(test.status is Status.PASSED for test in outcome.tests),
        rows=rows,
        full_scale=scale,
        sections=sections,
        attempted=[test for test in outcome.tests if test.attempts],
        false_alarms=false_alarm_words(outcome),
        smallest=smallest_rows(sections),
        intervals=any(row.chart["lower"] is not None for row in rows),
        command=_rerun(outcome),
        leak_headings=HEADINGS,
        leak_rows=leak_rows,
        leak_sentences=leak_sentences,
        soak_rows=soak_rows,
        calibrations=calibration_rows(outcome.calibrations, outcome.uncalibrated),
    )


def _rerun(outcome: CampaignOutcome) -> str:
    """Return the command that repeats a campaign: the recorded one, else `rig run` with its file.

    If no file is recorded either, the command has the campaign's name.
    """
    recorded = outcome.provenance.get("command")
    if isinstance(recorded, str):
        return recorded
    if isinstance(recorded, list | tuple):
        return shlex.join(str(word) for word in recorded)
    files_read = outcome.provenance.get("source_files") or {}
    return shlex.join(["rig", "run", str(next(iter(files_read), outcome.name))])


@dataclass(frozen=True)
class Row:
    """One row of the table of verdicts: a test's section, texts to print, and a small chart.

    A text is empty where there is nothing to show.

    Attributes:
        section: the section of the page about the test, which has the test's outcome.
        found: the verdict in words, `no verdict` if there is none; empty if the test was not run.
        chance: the verdict's probability.
        flow: leak flow found, with its interval, L/min.
        onset: estimated onset, s.
        chart: the flows on the small chart, each as a position in percent of the chart's width;
            one beyond the end of the chart is shown at its end, and one that is not there is None.
            `injected` is the recorded mean flow of the injected leaks that the verdict names, or of
            all if it names no leak; `found` the mean flow found; `lower` and `upper` are the ends
            of its 95 % interval.
    """

    section: Section
    found: str
    chance: str
    flow: str
    onset: str
    chart: dict[str, float | None]


def full_scale(outcome: CampaignOutcome) -> float:
    """Return the flow in L/min at the end of the small charts: 1, 2 or 5 times a power of ten.

    No recorded mean flow, and no upper end of an interval, is larger; without any flow it is 1.
    """
    flows = [fault.mean_flow_m3_per_s or 0.0 for test in outcome.tests for fault in test.injected]
    decisions = [test.decision for test in outcome.tests if test.decision is not None]
    intervals = [decision.interval_m3_per_s for decision in decisions]
    flows += [interval[1] for interval in intervals if interval is not None]
    largest = to_litres_per_minute(max(flows, default=0.0))
    if not isfinite(largest) or largest <= 0.0:
        return 1.0
    decade = 10.0 ** floor(log10(largest))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= largest)


def row_of(section: Section, scale: float) -> Row:
    """Return a test's row in the table of verdicts; its chart ends at the flow `scale`, L/min."""
    test, decision = section.test, section.test.decision
    chart, began = _chart(test, scale), test.status is not Status.NOT_RUN
    if decision is None:
        return Row(section, "no verdict" if began else "", "", "", "", chart)
    found = wording.found_names(decision) if began else ""
    onset_s = onset_shown(decision)
    onset = "" if onset_s is None else wording.seconds(onset_s)
    return Row(section, found, chance(decision), wording.found_flow(decision), onset, chart)


def _chart(test: TestOutcome, scale: float) -> dict[str, float | None]:
    decision, concerned = test.decision, test.injected
    if decision is not None and (kinds := wording.leaks_found(decision)):
        concerned = tuple(fault for fault in test.injected if fault.kind in kinds)
    if decision is not None and decision.verdict == test.expect and test.truth is not None:
        # A leak that goes from size to size is one leak, with its mean over all its time.
        concerned = (test.truth,)
    flows = [flow for fault in concerned if (flow := fault.mean_flow_m3_per_s) is not None]
    interval = None if decision is None else decision.interval_m3_per_s
    lower, upper = interval or (None, None)
    drawn = {
        "injected": sum(flows) if flows else None,
        "found": None if decision is None else decision.leak_m3_per_s,
        "lower": lower,
        "upper": upper,
    }
    return {
        name: None
        if m3_per_s is None or not isfinite(m3_per_s)
        else min(max(100.0 * to_litres_per_minute(m3_per_s) / scale, 0.0), 100.0)
        for name, m3_per_s in drawn.items()
    }


def false_alarm_words(outcome: CampaignOutcome) -> str:
    """Return sentences on what the campaign's rate of false alarms means for its verdicts."""
    rate = outcome.false_alarms_per_day
    judged = sum(
        test.recorded_s or test.duration_s for test in outcome.tests if test.decision is not None
    )
    chance = rate * judged / DAY_S
    often = "once" if rate == 1.0 else f"{rate:g} times"
    text = (
        f"The thresholds are set so that a healthy rig is called faulty at most {often} in a day "
        "of continuous running."
    )
    if 0.0 < chance < 0.5:
        text += (
            f" The detector judged {judged:.0f} s here, so the chance that any verdict here is a "
            f"false alarm is at most 1 in {floor(1.0 / chance):,}."
        )
    if outcome.filter == DEFAULT_FILTER:
        text += (
            " It is an upper bound: the rate is shared out over every fault and onset looked for."
        )
    else:
        text += (
            " The thresholds are learnt from healthy running: from a healthy test with the same "
            f"setpoint and load, else from the first {LEARNING_S:g} s of each test."
        )
    return text


def smallest_rows(sections: list[Section]) -> list[tuple[str, list[str], list[str]]]:
    """Return for each test the smallest leaks that would have been found, in L/min as text.

    A row has the test's name, the flows of leaks that begin in the test, and those of leaks that
    are there from the start, each in the order of `LEAKS`, or empty if not known. A flow is rounded
    up; it is "none" if the motion shows no leak of any size, or if the verdict is inconclusive.
    Tests without these figures are left out.
    """
    rows = []
    for section in sections:
        if section.smallest is None:
            continue
        decision = section.test.decision
        blind = decision is not None and decision.verdict == "inconclusive"
        begun, there = (
            [_claim(flows[leak], blind) for leak in LEAKS] if flows else []
            for flows in section.smallest
        )
        rows.append((section.test.name, begun, there))
    return rows


def _claim(m3_per_s: float, blind: bool) -> str:
    # Rounded up to 0.001 L/min, so that the claim is never better than the test.
    return wording.flow(ceil(m3_per_s * 6e7) / 6e7) if isfinite(m3_per_s) and not blind else "none"
