"""Writes a campaign's report, one HTML file that needs no other file and no network."""

import shlex
from pathlib import Path

from rig.recording import replace_text
from rig.report import wording
from rig.report.templating import rendered
from rig.runner.outcomes import CampaignOutcome, Status, reaction
from rig.runner.run_folder import REPORT

from .sections import sections_of
from .summary import false_alarm_words, full_scale, row_of, smallest_rows


def write_report(outcome: CampaignOutcome, directory: Path) -> Path:
    """Write `report.html` to a run's folder, and return its path.

    If a recording is missing or cannot be read, the report has a note in place of its plots.

    Args:
        outcome: the campaign's outcome, complete or not.
        directory: the run's folder, with the recordings that the outcome names.

    Raises:
        OSError: the folder cannot be written to.
    """
    path = directory / REPORT
    replace_text(path, render(outcome, directory))
    return path


def render(outcome: CampaignOutcome, directory: Path) -> str:
    """Return the report of a campaign as HTML; see `write_report`."""
    sections, scale = sections_of(outcome, directory), full_scale(outcome)
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
    )


def _rerun(outcome: CampaignOutcome) -> str:
    """Return the command that repeats a campaign: the recorded one, else one with its file."""
    recorded = outcome.provenance.get("command")
    if isinstance(recorded, str):
        return recorded
    if isinstance(recorded, list | tuple):
        return shlex.join(str(word) for word in recorded)
    files_read = outcome.provenance.get("source_files") or {}
    return shlex.join(["rig", "run", str(next(iter(files_read), outcome.name))])
