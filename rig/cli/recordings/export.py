"""`rig export` writes a recording, or all recordings of a run, in another format."""

from pathlib import Path
from typing import Final

import click

from rig.recording import Recording, RecordingError, RecordingProblem, export, read_recording

NO_CHECKSUM: Final = (
    "a CSV has no checksum: damage to its values is not noticed when it is read, and only warned "
    "of if the file .json lies beside it; .parquet, .mcap and .csv.gz have checksums"
)
"""Note on a CSV that was written. The hash in its `.json` only warns, as people edit a CSV."""
_FORMATS: Final = ("mf4", "parquet", "csv", "csv.gz", "mcap")


@click.command()
@click.argument("source", metavar="RECORDING|RUN")
@click.argument("out")
@click.option(
    "--format",
    "extension",
    type=click.Choice(_FORMATS),
    help="Of a run's recordings; Parquet if not given.",
)
def command(source: str, out: str, extension: str | None) -> int:
    """Write RECORDING to OUT: .mf4, .csv, .csv.gz, .parquet or .mcap, lossless; OUT is replaced.

    What the filter estimated in every sample is in OUT too: a replay makes it again, bit for bit.
    With the folder of a RUN, every recording of its tests is written to the folder OUT. Units,
    metadata and events are written too: inside MF4, Parquet and MCAP, beside a CSV in OUT.json. MF4
    needs asammdf: pip install 'hydraulic-rig[mf4]'. Parquet, MCAP and CSV.gz have checksums, by
    which damage is noticed when they are read; a plain CSV cannot have any.
    """
    if Path(source).is_dir():
        return _export_run(Path(source), Path(out), extension or "parquet")
    if extension is not None and not out.lower().endswith(f".{extension}"):
        limit = f"does not end with .{extension}"
        raise RecordingError.of_file(out, "", "leave --format out", limit)
    _export(_whole(read_recording(source, required=())), out)
    return 0


def _export_run(run: Path, out: Path, extension: str) -> int:
    from rig.runner.run_folder import read_run

    recordings = read_run(run).recordings
    if not recordings:
        raise RecordingError([RecordingProblem(str(run), "run", "has no recording", "")])
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(str(out), error) from error
    problems: list[RecordingProblem] = []
    for recording in recordings:
        try:
            content = _whole(read_recording(recording, required=()))
        except RecordingError as error:
            # A recording that a kill has cut off does not prevent the export of the others.
            problems += error.problems
            continue
        _export(content, str(out / f"{recording.stem}.{extension}"))
    if problems:
        raise RecordingError(problems)
    return 0


def _whole(content: Recording) -> Recording:
    """Return a recording with the filter's estimates, which recordings of tests leave out."""
    if not content.replayed:
        return content
    # Only a replay needs the compiler.
    from rig.runner.outcomes import with_estimates

    return with_estimates(content)


def _export(content: Recording, out: str) -> None:
    """Write a recording to a file, and say how much it has."""
    try:
        export(content, out)
    except OSError as error:
        raise _unwritable(out, error) from error
    click.echo(f"{out}: {len(content)} samples of {len(content.channels)} channels")
    if out.lower().endswith(".csv"):
        click.echo(f"{out}: {NO_CHECKSUM}", err=True)


def _unwritable(out: str, error: OSError) -> RecordingError:
    reason = error.strerror or str(error)
    return RecordingError.of_file(out, reason, "choose another folder", "cannot be written")
