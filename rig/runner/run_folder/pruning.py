"""Selects past runs that may be removed, and removes the files that they wrote, and no others."""

from collections import defaultdict
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime, timedelta

from .archive import Run
from .directory import files_of_run
from .journal import is_written


def prunable(
    runs: Iterable[Run], *, keep: int, older_than: timedelta | None, now: datetime
) -> list[Run]:
    """Return the runs that may be removed, oldest first.

    A run that is running or unfinished is never returned.

    Args:
        runs: all runs.
        keep: how many of the newest runs of each campaign on each rig stay, also counting runs that
            are running or unfinished.
        older_than: a run stays unless it began longer ago than this; None for no limit.
        now: the present time, UTC.
    """
    by_kind: dict[tuple[str, str], list[Run]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: run.started):
        by_kind[run.campaign, run.rig].append(run)
    old = [run for kind in by_kind.values() for run in kind[: max(len(kind) - keep, 0)]]
    return [
        run
        for run in sorted(old, key=lambda run: run.started)
        if run.state == "ended" and (older_than is None or now - run.started > older_than)
    ]


def remove(run: Run) -> list[str]:
    """Remove the files that a run wrote, and its folder if it is empty then.

    A run that is running is not removed; a message that says so is returned.

    Returns:
        The names of other files in the folder, which stay; empty if the folder was removed.

    Raises:
        OSError: a file cannot be removed; some files may have been removed before.
    """
    if is_written(run.folder):
        return [f"{run.folder}: is running"]
    for file in files_of_run(run.folder):
        file.unlink()
    with suppress(OSError):
        run.folder.rmdir()
    return sorted(path.name for path in run.folder.iterdir()) if run.folder.exists() else []
