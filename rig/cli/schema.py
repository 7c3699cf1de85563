"""`rig schema` writes the JSON schema of a kind of file, for editors."""

import json

import click

from rig.configuration import EDITED, editor_schema


@click.command()
@click.argument("kind", type=click.Choice(list(EDITED)))
def command(kind: str) -> int:
    """Write the JSON schema of campaign, rig, sweep or transducer files to the standard output.

    \b
    rig schema campaign > campaign.schema.json

    An editor with a YAML language server then completes and checks keys, units and choices in a
    file that begins with `# yaml-language-server: $schema=campaign.schema.json`. What a file means
    on its rig is told by `rig check`.
    """  # noqa: D301 (click wants the character)
    click.echo(json.dumps(editor_schema(kind), indent=1, ensure_ascii=False))
    return 0
