"""These functions check path and metadata of a new file, and replace a file in one step."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import RecordingProblem


def target_problems(path: str, *, may_replace: bool) -> list[RecordingProblem]:
    """Return the problem that prevents a file from being made at path, if any, in a list.

    The folder must exist; the file must not, unless it may be replaced.
    """
    target = Path(path)
    if not target.parent.is_dir():
        value = f"folder {target.parent} does not exist"
        return [RecordingProblem(path, "file", value, "make it first")]
    if target.exists() and not may_replace:
        remedy = "delete it or choose another name"
        return [RecordingProblem(path, "file", "exists already", remedy)]
    return []


def metadata_texts(
    path: str, metadata: Mapping[str, Any]
) -> tuple[dict[str, str], list[RecordingProblem]]:
    """Return a JSON text for each key, and a problem for each value that JSON cannot hold."""
    texts: dict[str, str] = {}
    problems = []
    limit = "JSON has texts, finite numbers, lists, objects, true, false and null"
    for key, value in metadata.items():
        try:
            texts[key] = json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            remedy, field = "convert the value before it is recorded", f"metadata {key!r}"
            problems.append(RecordingProblem(path, field, str(error), remedy, limit))
    return texts, problems


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the block a temporary path; move the file written there to `path` after the block.

    If an error ends the block, the temporary file is removed and `path` is unchanged.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield partial
        os.replace(partial, path)
    except BaseException:
        # What ended the block is told, not that the rest of it could not be removed either.
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def replace_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file in one step; a reader finds either the old or the whole new file.

    That is so after a power cut, too.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
