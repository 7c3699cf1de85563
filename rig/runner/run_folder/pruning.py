"""Which past runs may go, and their removal: files that a run wrote, and nothing else."""

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
    """Return the runs that may go, oldest first.

    The newest `keep` of each campaign on each rig stay, and whatever is younger than `older_than`,
    runs at present, or has tests that `--resume` would still run.
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
    """Remove a run's files, and its folder if nothing else is in it; return what else is.

    Raises:
        OSError: a file cannot be removed; those before it are gone.
    """
    if is_written(run.folder):
        return [f"{run.folder}: is running"]
    for file in files_of_run(run.folder):
        file.unlink()
    with suppress(OSError):
        run.folder.rmdir()
    return sorted(path.name for path in run.folder.iterdir()) if run.folder.exists() else []
