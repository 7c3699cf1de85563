"""`rig export`: writes a recording to another format."""

import click

from rig.recording import export, read_recording
from rig.recording.errors import Problem, RecordingError


@click.command()
@click.argument("recording")
@click.argument("out")
def command(recording: str, out: str) -> int:
    """Write RECORDING to OUT: .csv, .csv.gz, .parquet or .mcap, lossless; OUT is replaced.

    Metadata and events go along: inside Parquet and MCAP, beside a CSV in OUT.json.
    """
    content = read_recording(recording, required=())
    try:
        export(content, out)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError(
            [Problem(out, None, "file", reason, "cannot be written", "choose another folder")]
        ) from error
    click.echo(f"{out}: {len(content)} samples of {len(content.channels)} channels")
    return 0
