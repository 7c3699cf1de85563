"""The problems of a recording are reported together, each of them with its remedy."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Self

MAX_PROBLEMS: Final = 20
"""Most problems that are listed for one file; further ones are only counted."""


@dataclass(frozen=True, slots=True)
class RecordingProblem:
    """One problem: its place, the value found, the remedy, and the limit that the value breaks.

    `line` is the line of a (decompressed) CSV file, where the header is line 1. In other formats it
    is the row, where the first sample is row 1. It is None if the problem is of the whole file.
    """

    path: str
    field: str
    value: str
    remedy: str
    limit: str = ""
    line: int | None = None

    def __str__(self) -> str:
        """Return the problem as one line, `file:line: field: value (limit); remedy`."""
        where = self.path if self.line is None else f"{self.path}:{self.line}"
        limit = f" ({self.limit})" if self.limit else ""
        return f"{where}: {self.field}: {self.value}{limit}; {self.remedy}"


class RecordingError(ValueError):
    """The error of a recording that cannot be read, written or recovered.

    Attributes:
        problems: the problems in the given order, at most MAX_PROBLEMS for each file.
        omitted: path -> number of further problems, for files that have more.
    """

    def __init__(self, problems: Iterable[RecordingProblem]) -> None:
        found = list(problems)
        super().__init__(found)
        self.problems: list[RecordingProblem] = []
        seen: Counter[str] = Counter()
        for problem in found:
            seen[problem.path] += 1
            if seen[problem.path] <= MAX_PROBLEMS:
                self.problems.append(problem)
        self.omitted: dict[str, int] = {
            path: count - MAX_PROBLEMS for path, count in seen.items() if count > MAX_PROBLEMS
        }

    @classmethod
    def of_file(cls, path: str, value: str, remedy: str, limit: str = "") -> Self:
        """Return the error with a single problem, which concerns the whole file."""
        return cls([RecordingProblem(path, "file", value, remedy, limit)])

    def __str__(self) -> str:
        """Return one line for each problem, then one for each file that has further problems."""
        lines = [str(problem) for problem in self.problems]
        lines += [f"{path}: ... and {count} more problems" for path, count in self.omitted.items()]
        return "\n".join(lines)
