"""Requests that cannot be granted: what was asked for, what the limit is and what to do."""

from collections.abc import Sequence
from typing import NamedTuple


class RequestProblem(NamedTuple):
    """One value that cannot be granted."""

    where: str
    """What the value belongs to: a setpoint, a valve, a fault, or file:line."""
    field: str
    value: object
    limit: str
    """The rule that the value breaks, as the end of a sentence: "is not above 0"."""
    remedy: str

    def __str__(self) -> str:
        return f"{self.where} {self.field}: {self.value} {self.limit}; {self.remedy}"


class RequestError(ValueError):
    """Everything wrong with one request, one line a problem.

    Attributes:
        problems: the problems, never empty.
    """

    def __init__(self, problems: Sequence[RequestProblem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[type["RequestError"], tuple[tuple[RequestProblem, ...]]]:
        # Workers of a sweep hand errors back pickled; the default would pass the message instead.
        return type(self), (self.problems,)


class Checks:
    """Collects the problems of one request, so that all are reported at once."""

    def __init__(self, where: str, error: type[RequestError]) -> None:
        self.where = where
        self.error = error
        self.problems: list[RequestProblem] = []

    def require(self, granted: bool, field: str, value: object, limit: str, remedy: str) -> None:
        """Note a problem with `field` unless it is granted."""
        if not granted:
            self.problems.append(RequestProblem(self.where, field, value, limit, remedy))

    def finish(self) -> None:
        """Raise the error if any problem was noted."""
        if self.problems:
            raise self.error(self.problems)
