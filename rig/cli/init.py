"""`rig init` gives a user copies of the shipped configurations to edit."""

from pathlib import Path

import click

from rig.configuration import copy_shipped


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
def command(directory: Path) -> int:
    """Copy the shipped configurations (rigs, campaigns, stream ...) to DIR, a new or empty folder.

    Within DIR, a name means the copy: `rig run quickstart` runs DIR/campaigns/quickstart.yaml.
    """
    for file in copy_shipped(directory):
        click.echo(str(file))
    return 0
