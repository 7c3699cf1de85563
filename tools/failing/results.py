"""Keeps what came of each failure in a file, so that a play of hours goes on after a break."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from .trying import Tried


class Results:
    """What came of the failures that were tried so far, by rig and name.

    The names hold lines of the sources, so that a file is of use for as long as these stay.

    Args:
        path: file with a line of JSON for each of them, which need not exist; None to keep nothing.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._known: dict[tuple[str, str], Tried | None] = {}
        if path is None or not path.exists():
            return
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):
            # A last line that a kill cut off is removed, so that the next one begins anew.
            path.write_text("".join(lines[:-1]), encoding="utf-8")
            del lines[-1]
        for line in lines:
            rig, name, came = json.loads(line)
            self._known[rig, name] = came and Tried(**came | {"problems": tuple(came["problems"])})

    def of(self, rig: str, name: str, trial: Callable[[], Tried | None]) -> Tried | None:
        """Return what came of a failure, as it is known; if it is not, try it and add it.

        Args:
            rig: the rig on which it is tried.
            name: its name.
            trial: tries it, and returns None if it was not reached; that is kept, too.
        """
        if (rig, name) not in self._known:
            came = self._known[rig, name] = trial()
            if self._path is not None:
                row = rig, name, came and asdict(came)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
        return self._known[rig, name]
