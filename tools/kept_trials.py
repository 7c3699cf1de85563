"""Runs the trials of a study and keeps each in a file as it ends.

A study takes hours. If it is interrupted, its next run does only the trials that are not in the
file yet.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import track

Found = TypeVar("Found")


def kept_trials(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the fields of each trial that `file` holds, in the order of its lines.

    A line that is empty or no JSON, because a kill cut it off, is skipped. A missing file holds no
    trials.
    """
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            continue


def run_and_keep(
    file: Path, title: str, run: Callable[..., Found], left: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Found]:
    """Run trials and yield the result of each as it ends, after appending it to `file`.

    Nothing is run before the first result is asked for. An error in a trial is raised here and ends
    the iteration. The folder of `file` must exist.

    Args:
        file: each result is appended to it as a line of JSON.
        title: text beside the bar that shows progress.
        run: runs one trial and returns a dataclass. Another process must be able to import it.
        left: the arguments of `run`, for each trial that is not kept yet.
        jobs: number of processes; with 1, all trials run in this process.
    """
    with file.open("a", encoding="utf-8") as lines:
        # Without a new line here, a line that a kill cut off would swallow the next one.
        lines.write("\n" if lines.tell() else "")
        for found in track(
            _run_all(run, left, jobs), description=title, total=len(left), transient=True
        ):
            lines.write(json.dumps(asdict(found)) + "\n")  # type: ignore[call-overload]
            lines.flush()
            yield found


def _run_all(
    run: Callable[..., Found], left: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Found]:
    if jobs == 1:
        yield from (run(*each) for each in left)
    elif left:
        with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
            futures = [pool.submit(run, *each) for each in left]
            yield from (future.result() for future in as_completed(futures))
