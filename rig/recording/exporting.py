"""Recordings are written to files here, lossless; a half-written file never has the final name."""

import json
from os import PathLike, fspath
from pathlib import Path
from typing import Final

from . import formats
from .errors import RecordingError, RecordingProblem
from .reading import EXTENSIONS, SIDECAR, extension_of
from .recording import Recording
from .targets import metadata_texts, replace_text, replacing, target_problems

MF4: Final = ".mf4"
"""Extension of MF4, which is not among `EXTENSIONS` as MF4 is written but never read."""


def export(recording: Recording, path: str | PathLike[str]) -> None:
    """Write a recording to .csv, .csv.gz, .parquet, .mcap or .mf4; an existing file is replaced.

    Every float64 reads back bit for bit (a NaN as NaN). Metadata and events are written too: inside
    Parquet, MCAP and MF4, and beside a CSV in `NAME.json`; if there are none, a file of that name
    is deleted. MF4 needs asammdf, and is not read back.

    Raises:
        RecordingError: the extension is unknown, the folder does not exist, a channel name or the
            metadata cannot be written, or asammdf is needed and not installed.
        OSError: a file cannot be written.
    """
    name = fspath(path)
    target = Path(name)
    extension = MF4 if name.lower().endswith(MF4) else extension_of(name)
    _, problems = metadata_texts(name, recording.metadata)
    if extension is None:
        limit = f"recordings are written to {', '.join((*EXTENSIONS, MF4))}"
        value = f"unknown extension {target.suffix!r}"
        problems.append(RecordingProblem(name, "file", value, "choose one of these", limit))
    problems += target_problems(name, may_replace=True)
    if extension == ".mcap":
        problems += formats.channel_problems(name, list(recording.channels))
    if problems:
        raise RecordingError(problems)
    with replacing(target) as partial:
        # `formats` loads a format's module, and with it a library, when its name is first used.
        if extension == ".mcap":
            formats.write_mcap(partial, recording.channels, recording.metadata, recording.events)
        elif extension == ".parquet":
            formats.write_parquet(recording, partial)
        elif extension == MF4:
            formats.write_mf4(recording, partial, name)
        else:
            formats.write_csv(recording, partial, compressed=extension == ".csv.gz")
    if extension in (".csv", ".csv.gz"):
        _write_sidecar(recording, target.with_name(target.name + SIDECAR))


def _write_sidecar(recording: Recording, path: Path) -> None:
    if not recording.metadata and not recording.events:
        path.unlink(missing_ok=True)
        return
    content = {"sha256": recording.content_hash(), "metadata": recording.metadata}
    replace_text(path, json.dumps(content | {"events": recording.events}, indent=1) + "\n")
