"""Trials that take hours are kept as each ends: a study that was cut off goes on from there."""

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
    """Yield the fields of each trial that a file holds; a line cut off at its end is none."""
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            continue


def run_and_keep(
    file: Path, title: str, run: Callable[..., Found], left: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Found]:
    """Yield what each trial found as it ends, once it is kept in a file as a line of JSON.

    Args:
        file: is appended to.
        title: stands beside the bar that shows progress.
        run: runs a trial; returns a dataclass. Another process must be able to import it.
        left: its arguments, for each trial that is not kept yet.
        jobs: processes; 1 runs all in this one.
    """
    with file.open("a", encoding="utf-8") as lines:
        # A line that was cut off must not swallow the next one.
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
