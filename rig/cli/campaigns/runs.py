"""`rig runs` finds, shows, compares and prunes past runs, by the files in their folders."""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import click

from rig.cli.screen import Screen
from rig.recording import (
    EXTENSIONS,
    Recording,
    RecordingError,
    RecordingProblem,
    read_recording,
    replace_text,
)
from rig.runner.run_folder import (
    JOURNAL,
    RUNS,
    JournalError,
    Run,
    RunError,
    acknowledged,
    check_journal,
    is_plain,
    read_run,
    run_named,
    runs_below,
)

_AGE: Final = re.compile(r"(\d{1,5}) ?(min|h|d|w)")
_AT_LINE: Final = re.compile(r"(?:(\d+):)? ?(.*)", re.DOTALL)
"""What an error says of a file: perhaps a line, and what is wrong."""
_UNITS: Final = {"min": "minutes", "h": "hours", "d": "days", "w": "weeks"}

_below = click.option(
    "--runs",
    "below",
    type=click.Path(path_type=Path),
    default=RUNS,
    show_default=True,
    metavar="DIR",
    help="Where the runs are.",
)


def _date(ctx: click.Context, param: click.Parameter, value: str | None) -> datetime | None:
    """Return the time that an option gives as a date, a date and time, or an age (`7 d`).

    A time without a zone is UTC; an age is subtracted from now. Return None if the option is not
    given.

    Raises:
        click.BadParameter: the value is neither a date nor an age.
    """
    if value is None:
        return None
    if (age := _age(value)) is not None:
        return datetime.now(UTC) - age
    try:
        given = datetime.fromisoformat(value)
    except ValueError:
        write = "write 2026-11-22, 2026-11-22T14:30, or 7 d (ago)"
        raise click.BadParameter(f"{value!r} is no date: {write}") from None
    return given if given.tzinfo else given.replace(tzinfo=UTC)


def _span(ctx: click.Context, param: click.Parameter, value: str | None) -> timedelta | None:
    """Return the time span that an option gives, such as `30 d`; None if it is not given.

    Raises:
        click.BadParameter: the value is no time span.
    """
    if value is None:
        return None
    span = _age(value)
    if span is None:
        raise click.BadParameter(f"{value!r} is no time span: write 30 d, 12 h or 6 w")
    return span


def _age(text: str) -> timedelta | None:
    """Return the time span of a text such as `7 d`; None if the text is not a time span."""
    age = _AGE.fullmatch(text)
    return None if age is None else timedelta(**{_UNITS[age[2]]: int(age[1])})


@click.group()
def command() -> None:
    """Find, show, compare and prune past runs by their folders; no server is needed.

    A RUN is the name of a folder below --runs, or the path of a folder.
    """


@command.command("list")
@_below
@click.option("--since", callback=_date, help="Begun then or later: 2026-11-22, or 7 d (ago).")
@click.option("--until", callback=_date, help="Begun before then.")
@click.option("--campaign", help="Of the campaign of this name.")
@click.option("--rig", help="On the rig of this name.")
@click.option("--verdict", help="In which some test came to this verdict.")
@click.option("--state", type=click.Choice(["ended", "running", "unfinished"]))
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
def list_runs(below: Path, as_json: bool, **wanted: Any) -> int:
    """List the runs that meet every given option, oldest first."""
    found = [run for run in runs_below(below) if _is_wanted(run, wanted)]
    if as_json:
        for run in found:
            click.echo(json.dumps(_document(run), ensure_ascii=False))
        return 0
    screen = Screen()
    headings = ("run", "begun (UTC)", "campaign", "rig", "state", "tests", "found")
    rows = []
    for run in found:
        name, begun = str(run.folder.relative_to(below)), f"{run.started:%Y-%m-%d %H:%M}"
        counts = ", ".join(f"{n} {status}" for status, n in run.counts.items()).replace("_", " ")
        verdicts = ", ".join(sorted(run.verdicts))
        rows.append((name, begun, run.campaign, run.rig, run.state, counts, verdicts))
    screen.print_table(headings, rows, fold=headings)
    screen.print(f"{len(found)} runs below {below}")
    return 0


@command.command()
@click.argument("run")
@_below
@click.option("--json", "as_json", is_flag=True, help="As one JSON object.")
@click.option(
    "--verify", is_flag=True, help="Read its recordings, and exports of them, by their checksums."
)
def show(run: str, below: Path, as_json: bool, verify: bool) -> int:
    """Show a run: its folder, state, size, tests with their verdicts, and events outside the tests.

    RUN is the name of a folder below --runs, or a path. With --verify the exit code is 2 if a
    recording of the run, or an export in its folder, is damaged or holds other values, if a
    recording is gone, or if the journal is damaged, empty, gone or no campaign's; each is then
    named on stderr.
    """
    found = _run(run, below)
    if verify:
        _verify(found)
    if as_json:
        click.echo(json.dumps(_document(found) | {"results": found.results}, ensure_ascii=False))
        return 0
    screen = Screen()
    for line in _lines(found):
        screen.print(line, soft_wrap=True)
    return 0


@command.command()
@click.argument("reference")
@click.argument("candidate")
@_below
@click.option(
    "--tolerances",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="YAML: figure to {absolute, relative, sigmas} or ignore; others keep their defaults.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE.html", help="Write the page there."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a figure.")
def compare(
    reference: str, candidate: str, below: Path, tolerances: Path | None, out: Path | None,
    as_json: bool,
) -> int:  # fmt: skip
    """Compare the run CANDIDATE with the run REFERENCE, figure by figure.

    Exit code: 0 if every figure is within its tolerance, 1 if a figure moved beyond its tolerance
    or a test or figure is gone, 2 on bad input. docs/ci.md shows it as a gate of a CI.
    """
    from rig.configuration import load_tolerances
    from rig.runner.run_folder import ANYTHING, Change, Tolerance, compare as compared

    given = load_tolerances(tolerances) if tolerances is not None else {}
    chosen = {
        name: ANYTHING if file is None else Tolerance(**file.model_dump())
        for name, file in given.items()
    }
    comparison = compared(_run(reference, below), _run(candidate, below), chosen)
    if out is not None:
        from rig.report.campaign import comparison_page

        with _writing(out):
            replace_text(out, comparison_page(comparison))
    if as_json:
        for each in comparison.figures:
            click.echo(json.dumps(asdict(each) | {"difference": each.difference}))
    else:
        screen = Screen()
        headings = ("test", "figure", "reference", "candidate", "tolerated", "unit")
        rows = []
        for each in comparison.moved:
            sizes = (each.reference, each.candidate, each.tolerated)
            rows.append((each.test, each.figure, *map(_number, sizes), each.unit))
        if comparison.moved:
            screen.print_table(headings, rows, fold=headings)
        for line in comparison.changed:
            screen.print(f"not the same: {line}", soft_wrap=True)
        new = sum(each.standing is Change.NEW for each in comparison.figures)
        screen.print(
            f"{len(comparison.moved)} of {len(comparison.figures)} figures moved, {new} new"
        )
        if out is not None:
            screen.print(f"page: {out}", soft_wrap=True)
    return 1 if comparison.moved else 0


@command.command()
@_below
@click.option("--keep", type=click.IntRange(0), default=10, show_default=True, metavar="N",
              help="Of each campaign on each rig, the newest N stay.")  # fmt: skip
@click.option("--older-than", callback=_span, metavar="AGE", help="Younger ones stay: 30 d, 12 h.")
@click.option("--campaign", help="Only runs of this campaign.")
@click.option("--delete", is_flag=True, help="Do it; without, it is only shown what would go.")
def prune(
    below: Path, keep: int, older_than: timedelta | None, campaign: str | None, delete: bool
) -> int:
    """Remove old runs; without --delete, only show which.

    Only files that a run wrote are removed. A run that is going on or could be resumed stays.
    """
    from rig.runner.run_folder import prunable, remove

    runs = (run for run in runs_below(below) if campaign in (None, run.campaign))
    going = prunable(runs, keep=keep, older_than=older_than, now=datetime.now(UTC))
    size = 0
    for run in going:
        size += run.size
        click.echo(f"{'removed' if delete else 'would remove'} {run.folder}: {run.campaign}, "
                   f"{run.started:%Y-%m-%d %H:%M}, {run.size / 1e6:.1f} MB")  # fmt: skip
        if not delete:
            continue
        with _writing(run.folder):
            left = remove(run)
        if left:
            click.echo(f"{run.folder}: left what no run wrote: {', '.join(left)}", err=True)
    word = "removed" if delete else "would be removed; with --delete they are"
    click.echo(f"{len(going)} runs, {size / 1e6:.1f} MB, {word}")
    return 0


def _run(given: str, below: Path) -> Run:
    if is_plain(given) and (below / given).is_dir():
        return run_named(given, below)
    return read_run(Path(given))


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn an error of the block, which writes to `path`, into bad input.

    Raises:
        RunError: the block raised an OSError.
    """
    try:
        yield
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror or error}") from None


def _verify(run: Run) -> None:
    """Read a run's recordings, their exports in the run's folder, and its journal; tell how many.

    An export has its recording's name with the extension of another format.

    Raises:
        RecordingError: some are damaged or gone, or an export has other values than its recording.
    """
    problems = _journal_problems(run)
    problems += [
        RecordingProblem(str(path), "file", "is gone", "put it back from a copy of the run")
        for path in run.missing_recordings
    ]
    exported = 0
    for recording in run.recordings:
        others = [recording.with_name(f"{recording.stem}{end}") for end in EXTENSIONS]
        exports = [path for path in others if path != recording and path.is_file()]
        exported += len(exports)
        original: Recording | None = None
        for path in (recording, *exports):
            try:
                content = read_recording(path, required=())
            except RecordingError as error:
                problems += error.problems
                continue
            if path == recording:
                original = content
            elif original is not None and not _alike(original, content):
                value = f"has other names or values than {recording.name}"
                problems.append(RecordingProblem(str(path), "file", value, "export it again"))
    if problems:
        raise RecordingError(problems)
    click.echo(f"{len(run.recordings)} recordings and {exported} exports are undamaged")


def _journal_problems(run: Run) -> list[RecordingProblem]:
    """Return a problem if a run's journal is such that the run could not be resumed."""
    path = run.folder / JOURNAL
    try:
        check_journal(run.folder)
    except JournalError as error:
        said, _, remedy = str(error).partition("; ")
        found = _AT_LINE.fullmatch(said.removeprefix(f"{path}:"))
        where, value = found.groups() if found else (None, said)
        line = None if where is None else int(where)
        return [RecordingProblem(str(path), "journal", value, remedy, line=line)]
    return []


def _alike(recording: Recording, export: Recording) -> bool:
    """Return whether an export has the values of its recording, and perhaps what a replay adds."""
    if set(recording.replayed) & set(export.channels):
        # Only a replay needs the compiler.
        from rig.runner.outcomes import with_estimates

        recording = with_estimates(recording)
    return recording.content_hash() == export.content_hash()


def _is_wanted(run: Run, wanted: Mapping[str, Any]) -> bool:
    """Return whether a run meets all options of `rig runs list`.

    Every run meets an option that is None.
    """
    since, until, verdict = (wanted[option] for option in ("since", "until", "verdict"))
    return (
        (since is None or run.started >= since)
        and (until is None or run.started < until)
        and (verdict is None or verdict in run.verdicts)
        and all(wanted[of] in (None, getattr(run, of)) for of in ("campaign", "rig", "state"))
    )


def _document(run: Run) -> dict[str, Any]:
    return {
        "folder": str(run.folder),
        "campaign": run.campaign,
        "rig": run.rig,
        "started": run.started.isoformat(),
        "state": run.state,
        "exit_code": run.results.get("exit_code"),
        "counts": dict(run.counts),
        "verdicts": sorted(run.verdicts),
    }


def _lines(run: Run) -> Iterator[str]:
    yield f"{run.folder}: {run.campaign} on the rig {run.rig}, {run.state}"
    yield f"begun {run.started:%Y-%m-%d %H:%M:%S} UTC, {run.size / 1e6:.1f} MB"
    if run.state == "unfinished":
        yield f"go on: rig run --resume {run.folder}"
    for test in run.tests:
        found = test["found"]
        verdict = f", {found['verdict']}" if found else ""
        leak = (found or {}).get("leak_L_per_min")
        flow = "" if leak is None else f" {leak:.3f} L/min"
        again = f"; attempts before: {len(test['attempts'])}" if test.get("attempts") else ""
        why = f"; {test['message']}" if test.get("message") else ""
        yield f"  {test['name']}: {test['status']}{verdict}{flow}{again}{why}"
    for each in run.results.get("history") or []:
        yield f"  {each['at'][:19]} {each['who']}: {each['what']}"
    for seen in acknowledged(run.folder):
        yield f"  {seen.at[:19]} {seen.who}: {seen.what}"


def _number(value: float | str | None) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.5g}"
