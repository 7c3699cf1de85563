"""Replaces a rig file by a new text, with a backup, if it reads back as it is meant."""

import os
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from rig.recording import replace_text

from .rig import Rig, load_rig


class NotAsMeantError(Exception):
    """Raised when a new rig file does not describe the rig that it is to describe."""


def rewrite_rig(
    file: Path, out: Path | None, text: str, is_meant: Callable[[Rig], bool], begun: datetime
) -> list[str]:
    """Write a new text into a rig file, or to a new file; return what was written, in lines.

    Before a rig file is replaced, it is copied to FILE.TIME.bak. The new text is read back from a
    file of its own, which takes the rig file's place only if it is as meant: not even a kill leaves
    one that is not.

    Args:
        file: the rig file from which the text was made.
        out: the new file; None to replace `file`.
        text: the new text.
        is_meant: whether a rig is what the text is to describe.
        begun: the time in the backup's name, UTC.

    Raises:
        ConfigError: the written file is unusable.
        NotAsMeantError: it describes another rig.
        OSError: a file cannot be written.
    """
    target, lines, old = out or file, [], file.read_text(encoding="utf-8")
    if out is None:
        backup = file.with_name(f"{file.name}.{begun:%Y%m%dT%H%M%SZ}.bak")
        replace_text(backup, old)
        lines.append(f"backup: {backup}")
    # Beside the target, as paths in it count from its folder.
    candidate = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        replace_text(candidate, text)
        if not is_meant(load_rig(candidate)):
            raise NotAsMeantError(f"{target}: does not read back as written")
        os.replace(candidate, target)
    finally:
        candidate.unlink(missing_ok=True)
    return [*lines, f"rig file: {target}"]
