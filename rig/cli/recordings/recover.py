"""`rig recover` saves what is left of a recording that was cut off or damaged."""

import click

from rig.recording import RecordingError, recover


@click.command()
@click.argument("file")
@click.argument("out")
def command(file: str, out: str) -> int:
    """Write the longest unbroken stretch of the damaged MCAP recording FILE to OUT, a new file.

    Shows how much was saved and how much was lost. FILE is not changed.
    """
    try:
        summary = recover(file, out)
    except OSError as error:
        path, reason = error.filename or out, error.strerror or str(error)
        raise RecordingError.of_file(str(path), reason, "check the path") from error
    click.echo(str(summary))
    return 0
