"""`rig check` validates configurations, and shows what a campaign would do."""

import click

from rig.cli.application import Problems
from rig.configuration import check


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--rig", "rig_reference", metavar="RIG", help="Check campaigns against this rig.")
def command(files: tuple[str, ...], rig_reference: str | None) -> int:
    """Validate rigs, models, campaigns, sweeps, maps and stream profiles, by file or by name.

    A campaign is dry-run: its duration, commanded motion and faults are shown, and what the rig
    could not follow. Exit code 0 if all are valid, else 2, with every problem of every file on
    stderr.
    """
    problems = Problems()
    for file in files:
        with problems.collected():
            report = check(file, rig_reference)
            click.echo(str(report))
    return problems.report()
