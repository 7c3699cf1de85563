"""Removes what a run has written that was refused before anything moved, such as by a busy rig."""

from contextlib import suppress
from pathlib import Path

from .directory import files_of_run
from .journal import JOURNAL, JournalError, is_written, read_journal

_NOTHING_RUN = frozenset({"begin", "refused", "end"})
"""Kinds of the journal's entries of a run of which no test was begun and nobody asked anything."""


def discard_refused(folder: Path, *, existed: bool) -> bool:
    """Remove the files of a refused run, and its folder; return whether that was done.

    Nothing is removed if a test was begun, if an operator asked for something, if the run was
    resumed, or if another process runs in the folder. Files that the run did not write stay.

    Args:
        folder: folder of the run.
        existed: whether the folder was there before the run, so that it stays.
    """
    try:
        entries = read_journal(folder / JOURNAL)
    except JournalError:
        return False
    if not {entry.kind for entry in entries} <= _NOTHING_RUN or is_written(folder):
        return False
    with suppress(OSError):
        for file in files_of_run(folder):
            file.unlink()
        if not existed and not any(folder.iterdir()):
            folder.rmdir()
        return True
    return False
