"""Errors of requests that cannot be granted: the value, the rule that it breaks, and a remedy."""

from collections.abc import Sequence
from typing import NamedTuple, Self


class RequestProblem(NamedTuple):
    """One value of a request that cannot be granted, with the reason and a remedy."""

    where: str
    """What the value belongs to: a setpoint, a valve, a fault, or file:line."""
    field: str
    """Name of the field that has the value."""
    value: object
    """The value as it is shown to the user."""
    limit: str
    """The rule that the value breaks, as the end of a sentence: "is not above 0"."""
    remedy: str
    """What the user should do instead, as an imperative."""

    def __str__(self) -> str:
        return f"{self.where} {self.field}: {self.value} {self.limit}; {self.remedy}"


class RequestError(ValueError):
    """The error of one request with all its problems; its message has a line for each.

    Attributes:
        problems: the problems, at least one.
    """

    def __init__(self, problems: Sequence[RequestProblem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[type["RequestError"], tuple[tuple[RequestProblem, ...]]]:
        # Worker processes of a sweep return errors pickled. By default the message, not the
        # problems, would be passed to the constructor.
        return type(self), (self.problems,)


class Checks:
    """A collection of the problems of one request, so that all are reported at once.

    `require` notes a problem, and `finish` raises one error with all of them. A `with` block calls
    `finish` at its end, unless another error ends it.

    Args:
        where: what the checked values belong to (`RequestProblem.where`).
        error: class of the error that `finish` raises.
        of: object that has the checked values as attributes; None if every call of `require` gives
            the value.
    """

    def __init__(self, where: str, error: type[RequestError], of: object = None) -> None:
        self.where, self.error, self.of = where, error, of
        self.problems: list[RequestProblem] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()

    def require(
        self, granted: bool, field: str, limit: str, remedy: str, value: object = None
    ) -> None:
        """Note a problem with `field` if `granted` is false; `finish` raises it later.

        Args:
            granted: whether the value can be granted.
            field: name of the value (`RequestProblem.field`).
            limit: the rule, as the end of a sentence: "is not above 0".
            remedy: what the user should do instead, as an imperative.
            value: the value to show; if None, the attribute `field` of the object `of` is shown.
        """
        if not granted:
            shown = getattr(self.of, field) if value is None else value
            self.problems.append(RequestProblem(self.where, field, shown, limit, remedy))

    def finish(self) -> None:
        """Raise the error with all problems noted so far, if there are any."""
        if self.problems:
            raise self.error(self.problems)
