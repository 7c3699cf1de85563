"""What is wrong with a recording: every problem of a file together, each with its remedy."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Self

MAX_PROBLEMS: Final = 20
"""Problems listed for one file; the rest is counted."""


@dataclass(frozen=True, slots=True)
class RecordingProblem:
    """One thing wrong: where, what it is, what it should be, and what to do about it.

    `line` is the line of the (decompressed) CSV, header = 1; in other formats the row, first
    sample = 1; None where the problem is the whole file's.
    """

    path: str
    line: int | None
    field: str
    value: str
    limit: str
    remedy: str

    def __str__(self) -> str:
        """Return `file:line: field: value (limit); remedy`, on one line."""
        where = self.path if self.line is None else f"{self.path}:{self.line}"
        limit = f" ({self.limit})" if self.limit else ""
        return f"{where}: {self.field}: {self.value}{limit}; {self.remedy}"


class RecordingError(ValueError):
    """A recording cannot be read, written or recovered.

    Attributes:
        problems: at most MAX_PROBLEMS a file, in the order given.
        omitted: how many more there are, by path.
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
        """Return the error of a single problem, which is the whole file's."""
        return cls([RecordingProblem(path, None, "file", value, limit, remedy)])

    def __str__(self) -> str:
        """Return one line a problem, then one line for each file that has more."""
        lines = [str(problem) for problem in self.problems]
        lines += [f"{path}: ... and {count} more problems" for path, count in self.omitted.items()]
        return "\n".join(lines)
