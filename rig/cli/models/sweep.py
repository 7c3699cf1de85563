"""`rig sweep` runs thousands of cases drawn at random, on all cores or on a cluster."""

import json
import os
import shlex
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import click
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from rig.cli.application import EXIT_CRASHED, EXIT_STOPPED, ending, one_line
from rig.cli.screen import Screen
from rig.configuration import Sweep, load_sweep
from rig.recording import replace_text
from rig.runner.campaign import StopFlag, stop_on_signals
from rig.runner.run_folder import default_directory
from rig.sweep import (
    PAGE,
    SUMMARY,
    TABLE,
    Runner,
    SweepError,
    SweepFolder,
    Timing,
    chunks_of,
    is_complete,
    read_identity,
    run_sweep,
    unfinished_folder,
)


@click.command()
@click.argument("sweep")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for the results: new, empty, or of an earlier sweep, which is replaced. "
    "Default: runs/SWEEP-TIME.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    help="Processes. Default: one for each core; 1 runs all in this one.",
)
@click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Run on the Dask cluster whose scheduler is there, such as tcp://127.0.0.1:8786.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with the sweep in --out (else the newest unfinished one below runs): no case that "
    "it finished is run again. SWEEP may then be its folder.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
def command(
    sweep: str,
    out: Path | None,
    jobs: int | None,
    cluster: str | None,
    resume: bool,
    as_json: bool,
) -> int:
    """Run the Monte-Carlo sweep SWEEP, a file or a shipped name.

    Writes sweep.parquet with one row per case, sweep.html with ROC, confusion and the smallest leak
    found, and summary.json. The table does not depend on where, or by how many processes, the sweep
    is run. Ctrl-C ends it and keeps the cases that are done; stopped or killed, it goes on with
    --resume. Exit code: 0 done, 1 a case could not be run or no report could be made, 2 bad input,
    3 stopped before the end, or the disk was full.
    """
    if resume and Path(sweep).is_dir():
        out = out or Path(sweep)
        sweep = str((read_identity(Path(sweep)) or {}).get("file", sweep))
    loaded = load_sweep(sweep)
    if resume and out is None:
        out = unfinished_folder(loaded, Path("runs"))
    path = out or default_directory(loaded.name, datetime.now(UTC))
    stop = StopFlag()
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    screen.quiet = as_json
    say: Callable[[str], Any] = partial(screen.print, soft_wrap=True)
    if as_json:
        say = partial(click.echo, err=True)
    with stop_on_signals(stop), ExitStack() as stack:
        runner = _runner(jobs or os.cpu_count() or 1, cluster, stack, stop, say)
        if runner is None:
            say(f"stopped by {stop.reason}: no scheduler had answered")
            return EXIT_STOPPED
        folder = stack.enter_context(SweepFolder(path, loaded, resume=resume))
        most = "at most " if loaded.adaptive else ""
        say(f"{loaded.name}: {most}{loaded.cases} cases of {loaded.duration_s:g} s, judged by "
            f"{loaded.filter_name}, in {path}")  # fmt: skip
        try:
            with ending(EXIT_CRASHED, SweepError, before="rig: "):
                timing = _run(loaded, folder, runner, stop, screen)
            if not is_complete(loaded, folder):
                done = sum(folder.done(chunks_of(loaded)).values())
                again = shlex.join(["rig", "sweep", str(path), "--resume"])
                say(f"stopped by {stop.reason}: {done} of {loaded.cases} cases are done; {again}")
                return EXIT_STOPPED
            return _finish(loaded, folder, timing, say, as_json=as_json)
        except OSError as error:
            state = f"results cannot be written to {path}: {error.strerror or error}"
            click.echo(f"rig: {state}; free space, and go on with --resume", err=True)
            return EXIT_STOPPED


def _runner(
    jobs: int, cluster: str | None, stack: ExitStack, stop: StopFlag, say: Callable[[str], Any]
) -> Runner | None:
    """Return what runs the cases; None if a stop was asked for before the cluster answered."""
    from rig.sweep import ClusterError, connected, run_cluster, run_here, run_pool

    if cluster is not None:
        try:
            client = stack.enter_context(connected(cluster, lambda: stop.requested))
        except ClusterError:
            if stop.requested:
                return None
            raise
        return lambda chunks, setting, stopped: run_cluster(chunks, setting, client, stopped, say)
    if jobs == 1:
        return run_here
    return lambda chunks, setting, stopped: run_pool(chunks, setting, jobs, stopped)


def _run(
    sweep: Sweep, folder: SweepFolder, runner: Runner, stop: StopFlag, screen: Screen
) -> Timing:
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.completed:.0f} of {task.total:.0f} cases"),
        TimeRemainingColumn(),
        console=screen,
        disable=not screen.is_terminal,
        transient=True,
    ) as progress:
        bar = progress.add_task("starting", total=sweep.cases)
        # The first cases are those that were finished before.
        words = chain(["starting"], repeat("running"))

        def advanced(cases: int) -> None:
            progress.update(bar, advance=cases, description=next(words))

        return run_sweep(sweep, folder, runner, lambda: stop.requested, advanced)


def _finish(
    sweep: Sweep, folder: SweepFolder, timing: Timing, say: Callable[[str], Any], *, as_json: bool
) -> int:
    """Write table, summary and page of a finished sweep, and show the results.

    Return the exit code: 0, or `EXIT_CRASHED` if the page could not be made.
    """
    from rig.report.sweep import asked_lines, lines_of
    from rig.sweep import power_curves, study_of, study_of_asked

    table = folder.finish()
    study, asked = study_of(table), study_of_asked(sweep, table)
    if sweep.adaptive is not None:
        study = replace(study, power=power_curves(sweep, table))
    summary = {
        "name": sweep.name,
        "filter": sweep.filter_name,
        "false_alarms_per_day": sweep.false_alarms_per_day,
        "table": str(folder.path / TABLE),
        **study.plain(),
        **({} if asked is None else {"asked": asked.plain()}),
        "timing": timing.plain(),
    }
    replace_text(folder.path / SUMMARY, json.dumps(summary, indent=2) + "\n")
    for line in lines_of(sweep.filter_name, study, timing):
        say(line)
    for line in () if asked is None else asked_lines(asked):
        say(line)
    page = folder.path / PAGE
    code = 0
    try:
        from rig.report.sweep import sweep_page

        replace_text(page, sweep_page(sweep, table, study, asked))
        say(f"report: {page}")
    except Exception as error:  # the results are written already, so a missing page loses none
        click.echo(f"rig: no report: {one_line(error)}", err=True)
        code = EXIT_CRASHED
    if as_json:
        click.echo(json.dumps(summary, ensure_ascii=False))
    return code
