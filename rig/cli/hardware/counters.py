"""`rig counters` shows what a rig has done, for its maintenance."""

import click

from rig.cli.option_types import text
from rig.configuration import load_rig
from rig.runner.counters import CounterError, counters_path, note_maintenance, read_counters


@click.command()
@click.argument("reference", metavar="RIG")
@click.option(
    "--maintained",
    type=text,
    metavar="TEXT",
    help="Note that the rig was maintained now, and count from here beside the totals.",
)
def command(reference: str, maintained: str | None) -> int:
    """Show the cycles, metres and hours of a hardware rig, in all and since its maintenance.

    They are counted in every test of a campaign, also in those that were killed or run again, and
    kept in a file of this user, which is named. Exit code: 0, or 2 on bad input.
    """
    rig = load_rig(reference)
    if rig.backend != "hardware":
        raise click.BadParameter(
            f"{rig.name} is simulated, and does not wear; results.json has what its tests did",
            param_hint="RIG",
        )
    try:
        found = (
            read_counters(rig.name)
            if maintained is None
            else note_maintenance(rig.name, maintained)
        )
    except (CounterError, OSError) as error:
        raise click.ClickException(str(error)) from None
    click.echo("\n".join(found.lines()))
    click.echo(f"  kept in {counters_path(rig.name)}")
    return 0
