"""`rig check` validates configurations, and shows what a campaign would do."""

import json

import click

from rig.cli.application import Problems
from rig.configuration import check, report_content


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--rig", "rig_reference", metavar="RIG", help="Check campaigns against this rig.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON list with an object for each file."
)
def command(files: tuple[str, ...], rig_reference: str | None, as_json: bool) -> int:
    """Validate rigs, models, campaigns, sweeps, maps and stream profiles, by file or by name.

    A campaign is dry-run: its duration, commanded motion and faults are shown, and what the rig
    could not follow. Exit code 0 if all are valid, else 2, with every problem of every file on
    stderr.
    """
    problems, valid = Problems(), []
    for file in files:
        with problems.collected():
            report = check(file, rig_reference)
            if as_json:
                valid.append(report_content(report))
            else:
                click.echo(str(report))
    if as_json:
        click.echo(json.dumps(valid, ensure_ascii=False, allow_nan=False))
    return problems.report()
