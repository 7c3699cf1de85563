"""`rig control` sends a request to a running campaign."""

import json
from pathlib import Path

import click

from rig.cli.application import EXIT_BAD_INPUT
from rig.cli.option_types import text
from rig.control_socket import ControlError, ask, own_name
from rig.runner.campaign import Request
from rig.runner.run_folder import JOURNAL, acknowledge_ended, is_written


@click.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("request", type=click.Choice([str(each) for each in Request]))
@click.argument("text", nargs=-1, type=text)
@click.option("--test", default="", type=text, metavar="NAME", help="The test to skip or to retry.")
@click.option("--by", default="", type=text, metavar="NAME", help="Who asks, for the journal.")
def command(directory: Path, request: str, text: tuple[str, ...], test: str, by: str) -> int:
    """Ask the campaign that runs in the folder DIR for something.

    \b
    pause        wait once the present test has come to its end
    resume       go on after a pause
    abort        end the campaign now, as Ctrl-C does
    skip         do not run a test, or end it: --test, else the present one
    retry        run a test again: --test, else the present one, else the last
    note TEXT    keep a text in journal, recording and report
    set KEY=VALUE ...
                 change the control of the present test without a bump
    acknowledge  record that somebody saw all that wants attention; TEXT may say more. A run
                 that has ended, such as by a trip, takes this one too
    status       show the state of the campaign, as JSON

    KEY is any key of a section `control`, VALUE as a rig file has it: set gain=80V/m
    "integral_time=0.5 s"; integral_time=none takes a key back, and the one word `proportional`
    all of them but the gain. What leaves less than 6 dB or 30 degrees by the model is refused. The
    next test, and this one if it is run again, begins with the control of its file.

    Anybody who may write to the folder as the campaign's user may ask. TEXT may go with any request
    and is recorded with it. Exit code: 0 if the request was accepted, 2 if no campaign runs there
    or it refuses, with the reason.
    """  # noqa: D301 (click wants the character)
    if test and request not in (Request.SKIP, Request.RETRY):
        click.echo(f"--test {test}: goes with skip or retry; leave it out", err=True)
        return EXIT_BAD_INPUT
    between = ", " if request == Request.SET else " "
    said = between.join(text)
    try:
        answer = ask(directory, Request(request), said, test, person=by)
    except ControlError:
        # A run that has ended has no socket, but its journal.
        if request != Request.ACKNOWLEDGE or not _has_ended(directory):
            raise
        answer = {"reply": acknowledge_ended(directory, own_name(), said, by)}
    if "status" in answer:
        click.echo(json.dumps(answer["status"], indent=1, ensure_ascii=False))
    else:
        click.echo(answer["reply"])
    return 0


def _has_ended(folder: Path) -> bool:
    """Return whether a folder holds a run's journal that no process writes any more."""
    return (folder / JOURNAL).is_file() and not is_written(folder)
