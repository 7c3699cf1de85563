"""Where a file is to be written: the folder is there, and nothing of value is in the way."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import RecordingProblem


def target_problems(path: str, *, may_replace: bool) -> list[RecordingProblem]:
    """Return what keeps a file from being made at path."""
    target = Path(path)
    if not target.parent.is_dir():
        value = f"folder {target.parent} does not exist"
        return [RecordingProblem(path, None, "file", value, "", "make it first")]
    if target.exists() and not may_replace:
        remedy = "delete it or choose another name"
        return [RecordingProblem(path, None, "file", "exists already", "", remedy)]
    return []


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` that takes its place, unless an error ends the block."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8, in one step: a reader finds the old file or the whole new one.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
