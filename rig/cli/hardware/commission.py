"""`rig commission` finds how a new rig is wired and what it is like, and writes that down."""

import json
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import click

from rig.cli.application import EXIT_STOPPED, Problems
from rig.cli.campaigns import MotionProgress
from rig.cli.live_stream import motion_streamed, session_streamed, stream_of
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.rig_output import RIG_OUT, refuse_output, refuse_shipped
from rig.cli.screen import Screen
from rig.configuration import NotAsMeantError, Rig, find_rig, load_model, load_rig
from rig.loop import TripError
from rig.recording import replace_text
from rig.report.commissioning import commissioning_page, finding_rows
from rig.runner import Observer, StopFlag, stop_on_signals
from rig.runner.commissioning import (
    SCHEMA,
    SKIPPABLE,
    Commissioning,
    DeclinedError,
    NotFoundError,
    Operator,
    Seen,
    Yes,
    findings_figures,
    write_rig_file,
)
from rig.runner.experiments import ExperimentStoppedError
from rig.runner.run_folder import default_directory, make_empty

EXIT_NOT_FOUND: Final = 1
_LOOK_S: Final = 0.2
"""Time in s between two looks for an answer; the rig is looked after between them."""
_WAYS: Final = {"out": 1, "o": 1, "in": -1, "i": -1, "": 0}


class Terminal:
    """The operator at the terminal; at the end of its input he agrees to nothing.

    Args:
        screen: shows what he is asked.
    """

    sees = True

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def agrees(self, motion: str, alive: Callable[[], None]) -> bool:
        """Ask for his word; see `Operator`."""
        self._screen.print(f"\n{motion}.", soft_wrap=True)
        return self._asked("Go on? [y/N] ", alive).lower() in ("y", "yes")

    def way(self, alive: Callable[[], None]) -> int:
        """Ask which way the rod moved, until the answer can be understood; see `Operator`."""
        question = "Which way did the rod move: out, in, or Enter if you did not see it? "
        while True:
            answer = self._asked(question, alive).lower()
            if answer in _WAYS:
                return _WAYS[answer]

    def _asked(self, question: str, alive: Callable[[], None]) -> str:
        self._screen.print(question, end="")
        while not select.select([sys.stdin], [], [], _LOOK_S)[0]:
            alive()
        return sys.stdin.readline().strip()


@click.command()
@click.argument("rig_reference", metavar="RIG")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--yes", is_flag=True, help="Ask nobody before a motion: for an emulated rig, or a test."
)
@click.option(
    "--skip",
    type=click.Choice(SKIPPABLE),
    multiple=True,
    help="Leave a step out; may be repeated. They take 9 and 4 minutes.",
)
@RIG_OUT
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="A new or empty folder for page and recordings; runs/commission-RIG-TIME if not given.",
)
@STREAMED
@click.option("--json", "as_json", is_flag=True, help="One object instead of tables; needs --yes.")
def command(
    rig_reference: str,
    model: str,
    yes: bool,
    skip: tuple[str, ...],
    out: Path | None,
    folder: Path | None,
    profile: str | None,
    as_json: bool,
) -> int:
    """Commission RIG, the file of a new rig: find how it is wired and what it is like.

    Asks for the operator's word before each motion. First small commands in open loop find which
    way valve, encoder, spool sensor and pressure lines count, and the valve's null; then the ram is
    homed and held (noise of each sensor), goes to its other stop (stroke), and friction and a first
    baseline are measured.

    What differs is written into the rig file at the end, and the old file is kept beside it as
    FILE.TIME.bak; a shipped rig, given by name, needs --out. Also writes commissioning.html and
    commissioning.json, and model and baseline for campaigns. If it ends early, the valve is at null
    and the rig file as it was.
    Exit code: 0 all was found, 1 something was not, 2 bad input, 3 stopped, declined or tripped.
    """
    problems = Problems()
    with problems.collected():
        rig = load_rig(rig_reference)
    with problems.collected():
        assumed = load_model(model)
    with problems.collected():
        settings = stream_of(profile, paced=True)
    refuse_output(problems, out)
    if as_json and not yes:
        problems.add("--json: nobody can be asked; give --yes too")
    if not yes and not sys.stdin.isatty():
        problems.add(
            "rig commission: there is no terminal in which to ask before each motion; run it in "
            "one, or give --yes if nobody is near the rig, as with an emulated one"
        )
    if problems.found:
        return problems.report()
    if rig.backend != "hardware" or rig.homing is None:
        problems.add(
            f"{rig.name}: cannot be commissioned; give a rig with `backend: hardware` and `homing`"
        )
    refuse_shipped(problems, rig_reference, out)
    if problems.found:
        return problems.report()
    file = find_rig(rig_reference)
    begun = datetime.now(UTC)
    directory = folder or default_directory(f"commission-{rig.name}", begun)
    make_empty(directory)
    screen, stop = Screen(), StopFlag()
    screen.quiet = as_json
    operator: Operator = Yes() if yes else Terminal(screen)
    with stop_on_signals(stop), failures_reported():

        @contextmanager
        def watched(part: str) -> Iterator[Observer]:
            activity = f"commissioning: {part}"
            with (
                MotionProgress(screen, paced=True) as progress,
                motion_streamed(progress, settings, rig, directory, stop, activity) as observer,
            ):
                yield observer

        def seen(part: str) -> AbstractContextManager[Seen]:
            activity = f"commissioning: {part}"
            return session_streamed(settings, rig, directory, stop, activity, _say(screen))

        work = Commissioning(
            rig, assumed, directory, operator,
            skip=skip, say=_say(screen), stop=stop, watched=watched, seen=seen,
        )  # fmt: skip
        ended, code = "", 0
        written: list[str] = []
        try:
            work.run()
            if work.changes.any:
                written = write_rig_file(file, out, rig, work.changes, begun)
        except (NotFoundError, DeclinedError, TripError, ExperimentStoppedError) as error:
            ended = str(error)
            code = EXIT_NOT_FOUND if isinstance(error, NotFoundError) else EXIT_STOPPED
        except NotAsMeantError as error:
            raise click.ClickException(str(error)) from error
        _keep(directory, rig, begun, work, written, ended)
    code = code or (0 if work.complete else EXIT_NOT_FOUND)
    if as_json:
        click.echo(json.dumps(_figures(rig, begun, work, written, ended), allow_nan=False))
        return code
    if work.findings:
        screen.print_table(("what", "found", "in the file", ""), finding_rows(work.findings))
    for each in work.findings:
        if each.standing == "not found":
            screen.print(f"not found: {each.subject}: {each.remark}", soft_wrap=True)
    for line in [*written, *(f"{name}: {path}" for name, path in work.files.items())]:
        screen.print(line, soft_wrap=True)
    if not written:
        screen.print("rig file: unchanged")
    screen.print(f"page: {directory / 'commissioning.html'}", soft_wrap=True)
    if ended:
        click.echo(f"rig: {ended}", err=True)
    return code


def _say(screen: Screen) -> Callable[[str], None]:
    return lambda text: screen.print(text, soft_wrap=True)


def _figures(
    rig: Rig, begun: datetime, work: Commissioning, written: list[str], ended: str
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "rig": rig.name,
        "started": f"{begun:%Y-%m-%dT%H:%M:%SZ}",
        "complete": work.complete and not ended,
        "ended_early": ended or None,
        "findings": findings_figures(work.findings),
        "files": {name: str(path) for name, path in work.files.items()},
        "written": written,
    }


def _keep(
    directory: Path, rig: Rig, begun: datetime, work: Commissioning, written: list[str], ended: str
) -> None:
    """Write page and figures into the folder."""
    figures = json.dumps(_figures(rig, begun, work, written, ended), indent=1, allow_nan=False)
    replace_text(directory / "commissioning.json", figures + "\n")
    started = f"{begun:%Y-%m-%d %H:%M}"
    lines = [*written, *(f"{name}: {path}" for name, path in work.files.items())]
    page = commissioning_page(rig.name, started, work.findings, lines, work.signs, ended)
    replace_text(directory / "commissioning.html", page)
