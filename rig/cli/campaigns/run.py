"""`rig run` runs a campaign, shows its progress, and writes its report."""

import errno
import os
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path

import click

from estimator.evidence import KeptAccounts
from rig.cli.application import EXIT_BAD_INPUT, EXIT_CRASHED, EXIT_STOPPED, ending, one_line
from rig.cli.live_stream import obeyed_by, stream_of, streamed
from rig.cli.option_types import STREAMED, paced, text
from rig.cli.rig_failures import require_possible_pace
from rig.cli.screen import Screen
from rig.configuration import load_campaign
from rig.control_socket import own_name
from rig.io import DriverError
from rig.reserves import refusal, remedy_for
from rig.runner import CampaignOutcome, Observer, StopFlag, run_campaign, stop_on_signals
from rig.runner.campaign import Desk, Pace
from rig.runner.run_folder import (
    begun_in,
    default_directory,
    discard_refused,
    log_error,
    unfinished_run,
)

from .progress import HEADINGS, CampaignProgress, cells_of, summary


@click.command()
@click.argument("campaign")
@click.option("--rig", "rig_reference", metavar="RIG", help="Run on this rig, not the campaign's.")
@paced("At", " Same results.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for the results: new, empty, or of an earlier run, which is replaced. "
    "Default: runs/CAMPAIGN-TIME.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with the run in --out (else the newest unfinished one below runs): no test that "
    "it finished is run again. CAMPAIGN may then be the run's folder itself.",
)
@STREAMED
@click.option(
    "--by",
    default="",
    type=text,
    metavar="NAME",
    help="Who starts the run, or goes on with it, for its journal, report and page; your user if "
    "not given.",
)
def command(
    campaign: str,
    rig_reference: str | None,
    pace: Pace | None,
    out: Path | None,
    resume: bool,
    profile: str | None,
    by: str,
) -> int:
    """Run the fault-injection campaign CAMPAIGN, a file or a shipped name.

    Writes report.html, results.json, junit.xml, a journal, and a recording of each test. Ctrl-C
    ends the campaign and reports the tests so far; `rig control` asks it for a pause and more. A
    campaign that was stopped or killed goes on with --resume. Exit code: 0 all as expected, 1 a
    test failed or was skipped or no report could be made, 2 bad input or a device that is not
    there or is in use, of which no folder is left, 3 tripped, not ready, stopped, or its disk full.
    """
    given: dict[str, str | None] = {
        "reference": campaign, "rig": rig_reference, "pace": pace, "folder": str(Path.cwd()),
        "stream": profile,
    }  # fmt: skip
    if resume and Path(campaign).is_dir():
        out = out or Path(campaign)
        given |= begun_in(Path(campaign))["given"] or {}
        pace = pace or ("fast" if given["pace"] == "fast" else None)
    reference, on_rig = str(given["reference"]), rig_reference or given["rig"]
    loaded, rig = load_campaign(reference, on_rig, Path(str(given["folder"])))
    require_possible_pace(rig, pace)
    if resume and out is None:
        out = unfinished_run(loaded.name, Path("runs"))
    paced = (pace or rig.pace) == "real"
    settings = stream_of(profile or given.get("stream"), paced=paced)
    again = ["rig", "run", reference, *([] if on_rig is None else ["--rig", on_rig])]
    desk = Desk()
    by = by or own_name()
    directory = out or default_directory(loaded.name, datetime.now(UTC))
    # A supervisor of real devices has no time to spare for the report while a test runs.
    kept = KeptAccounts() if rig.backend == "simulated" else None
    stop = StopFlag()
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    progress = CampaignProgress(screen, paced=paced)
    stream: AbstractContextManager[Observer] = nullcontext(progress)
    if settings is not None:
        stream = streamed(progress, settings, rig, directory, obeyed_by(desk), by=by, paced=paced)
    with stop_on_signals(stop, directory):
        started = time.perf_counter()
        with (
            ending(EXIT_BAD_INPUT, DriverError),
            _leaving_nothing(directory),
            progress,
            stream as observer,
        ):
            try:
                outcome = run_campaign(
                    loaded,
                    rig,
                    directory,
                    pace=pace,
                    observer=observer,
                    stop=stop,
                    command=again,
                    resume=resume,
                    overdue=_give_up,
                    given=given,
                    desk=desk,
                    by=by,
                    kept=kept,
                )
            except OSError as error:
                elsewhere = error.filename and not _is_below(directory, error.filename)
                if elsewhere or error.errno in (errno.EAGAIN, errno.ENOMEM):
                    click.echo(f"rig: {refusal(error)}", err=True)
                    return EXIT_STOPPED
                state = f"results cannot be written to {directory}: {error.strerror or error}"
                click.echo(f"rig: {state}; {remedy_for(error)}", err=True)
                return EXIT_STOPPED
        wall_s = time.perf_counter() - started
        rows = map(cells_of, outcome.tests)
        screen.print_table(HEADINGS, rows, right=("onset", "latency"))
        for line in summary(outcome, wall_s, live=paced):
            screen.print(line, soft_wrap=True)
        report = _report(outcome, outcome.kept_in or directory, kept)
    if report is not None:
        screen.print(f"report: {report}", soft_wrap=True)
    return outcome.exit_code if report is not None else max(outcome.exit_code, EXIT_CRASHED)


def _is_below(directory: Path, file: str | bytes) -> bool:
    """Return whether a file that could not be used is one of the run's, or its folder."""
    return Path(os.fsdecode(file)).absolute().is_relative_to(directory.absolute())


def _give_up() -> None:
    """End this process, whose cleaning up hangs, at once with a message and `EXIT_STOPPED`.

    The session's other processes, which then miss the beat of this one, and the devices' watchdogs
    make the rig safe.
    """
    os.write(2, b"rig: cleaning up takes too long; ended. Go on with rig run --resume\n")
    os._exit(EXIT_STOPPED)


def _report(outcome: CampaignOutcome, directory: Path, kept: KeptAccounts | None) -> Path | None:
    """Write the report and return its path; None, with a message on stderr, if that fails."""
    try:
        from rig.report import write_report

        return write_report(outcome, directory, kept)
    except OSError as error:
        again = f"then write it: rig run --resume {directory}"
        click.echo(f"rig: no report: {refusal(error)}; {again}", err=True)
        return None
    except Exception as error:
        log = log_error(directory, "report")
        click.echo(f"rig: no report: {one_line(error)}; traceback in {log}", err=True)
        return None


@contextmanager
def _leaving_nothing(directory: Path) -> Iterator[None]:
    """Leave no folder of a run that a DriverError of the block refuses before anything moved."""
    existed = directory.exists()
    try:
        yield
    except DriverError:
        discard_refused(directory, existed=existed)
        raise
