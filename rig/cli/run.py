"""`rig run`: runs a campaign, shows it, and reports it."""

import time
from datetime import UTC, datetime
from pathlib import Path

import click

from rig.configuration.campaign import load_campaign
from rig.io.driver import DriverError
from rig.loop.trip import TripError
from rig.runner import CampaignOutcome, StopFlag, run_campaign, stop_on_signals
from rig.runner.directory import default_directory, log_error
from rig.runner.pacing import Pace

from .application import EXIT_BAD_INPUT, EXIT_CRASHED, EXIT_STOPPED, one_line
from .progress import CampaignProgress
from .screen import Screen
from .verdicts import summary, verdict_table


@click.command()
@click.argument("campaign")
@click.option("--rig", "rig_reference", metavar="RIG", help="Run on this rig, not the campaign's.")
@click.option(
    "--pace",
    type=click.Choice(["real", "fast"]),
    help="At the wall clock, or as fast as it can; the rig's own if not given. Same results.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for the results: new, empty, or of an earlier run, which is replaced. "
    "Default: runs/CAMPAIGN-TIME.",
)
def command(campaign: str, rig_reference: str | None, pace: Pace | None, out: Path | None) -> int:
    """Run the fault-injection campaign CAMPAIGN, a file or a shipped name.

    Writes report.html, results.json, junit.xml and a recording a test. Ctrl-C ends it with what
    there is. Exit code: 0 all as expected, 1 a test failed, 2 bad input, 3 stopped before the end.
    """
    loaded, rig = load_campaign(campaign, rig_reference)
    if rig.backend == "hardware" and pace == "fast":
        limit = f"the rig {rig.name} is hardware, which runs at the wall clock"
        click.echo(f"--pace fast: {limit}; leave the option out", err=True)
        return EXIT_BAD_INPUT
    directory = out or default_directory(loaded.name, datetime.now(UTC))
    stop = StopFlag()
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    with stop_on_signals(stop):
        started = time.perf_counter()
        paced = (pace or rig.pace) == "real"
        with CampaignProgress(screen, paced=paced) as progress:
            try:
                outcome = run_campaign(
                    loaded,
                    rig,
                    directory,
                    pace=pace,
                    observer=progress,
                    stop=stop,
                    command=_again(campaign, rig_reference),
                )
            except DriverError as error:
                click.echo(str(error), err=True)
                return EXIT_BAD_INPUT
            except TripError as error:
                click.echo(f"rig: {error}", err=True)
                return EXIT_STOPPED
            except OSError as error:
                state = f"results cannot be written to {directory}: {error.strerror or error}"
                click.echo(f"rig: {state}; free space, or give another --out", err=True)
                return EXIT_CRASHED
        wall_s = time.perf_counter() - started
        screen.print(verdict_table(outcome, plain=not screen.is_terminal))
        for line in summary(outcome, wall_s, live=paced):
            screen.print(line, soft_wrap=True)
        report = _report(outcome, directory)
    if report is not None:
        screen.print(f"report: {report}", soft_wrap=True)
    return outcome.exit_code if report is not None else max(outcome.exit_code, EXIT_CRASHED)


def _again(campaign: str, rig_reference: str | None) -> list[str]:
    """Return the command that runs a campaign again: on the same rig, into a new folder."""
    on_rig = [] if rig_reference is None else ["--rig", rig_reference]
    return ["rig", "run", campaign, *on_rig]


def _report(outcome: CampaignOutcome, directory: Path) -> Path | None:
    """Return the report; None, with a message, if it cannot be made: the results are there."""
    try:
        from rig.report import write_report

        return write_report(outcome, directory)
    except Exception as error:
        log = log_error(directory, "report")
        click.echo(f"rig: no report: {one_line(error)}; traceback in {log}", err=True)
        return None
