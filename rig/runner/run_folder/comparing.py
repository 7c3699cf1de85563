"""Compares two runs figure by figure: which moved beyond its tolerance, and which is missing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import hypot, inf
from typing import Any, Final

from .archive import Run


@dataclass(frozen=True)
class Tolerance:
    """The tolerance of a figure: it may differ by the sum of three parts.

    Attributes:
        absolute: first part, in the figure's unit.
        relative: second part, as a share of the reference's absolute value.
        sigmas: third part, as a multiple of the standard error of the difference; the part is zero
            if a figure's standard error is not known.
    """

    absolute: float = 0.0
    relative: float = 0.0
    sigmas: float = 0.0

    def of(self, reference: float, error: float) -> float:
        """Return the greatest tolerated difference, in the figure's unit.

        Args:
            reference: value of the reference.
            error: standard error of the difference; 0 if it is not known.
        """
        return self.absolute + self.relative * abs(reference) + self.sigmas * error


TOLERANCES: Final[Mapping[str, Tolerance]] = {
    "leak": Tolerance(absolute=0.01, relative=0.05, sigmas=3.0),
    "onset": Tolerance(absolute=0.5),
    "latency": Tolerance(absolute=1.0, relative=0.25),
    "residual": Tolerance(relative=0.1, sigmas=3.0),
    "friction": Tolerance(relative=0.1, sigmas=4.0),
    "bulk_modulus": Tolerance(relative=0.05, sigmas=3.0),
    "loop_missed": Tolerance(absolute=1e-3),
    "loop": Tolerance(absolute=1e-4, relative=1.0),
}
"""Default tolerances, by a figure's name or the beginning of it; the longest fitting one is used.

Leaks (L/min) may differ by their 99.7 % interval and 5 %; residuals by 10 %; friction, which is
identified from some twenty strokes, by 4 standard errors; times of the loop by a factor of two, as
machines stall."""

ANYTHING: Final = Tolerance(absolute=inf)
"""Tolerance of a figure that may differ by any amount, or be missing."""


class Change(StrEnum):
    """The result of comparing a figure of two runs."""

    SAME = "same"
    MOVED = "moved"
    """The figure differs by more than its tolerance, or the candidate lacks it; a text differs."""
    NEW = "new"
    """Only the candidate has the figure."""


@dataclass(frozen=True)
class Compared:
    """A figure of a test, compared in two runs.

    Attributes:
        test: name of the test.
        figure: name of the figure.
        reference: its value in the reference, a text if it is a status or a verdict; None if the
            reference lacks it.
        candidate: its value in the candidate, likewise.
        standing: the result of the comparison.
        tolerated: greatest tolerated difference; None for texts, or if a run lacks the figure.
        unit: unit of the values, as it is printed.
    """

    test: str
    figure: str
    reference: float | str | None
    candidate: float | str | None
    standing: Change
    tolerated: float | None = None
    unit: str = ""

    @property
    def difference(self) -> float | None:
        """Value of the candidate less that of the reference; None unless both are numbers."""
        if isinstance(self.reference, str) or isinstance(self.candidate, str):
            return None
        if self.reference is None or self.candidate is None:
            return None
        return self.candidate - self.reference


@dataclass(frozen=True)
class Comparison:
    """The result of comparing two runs.

    Attributes:
        reference: the run that is taken as right.
        candidate: the run that is compared with it.
        figures: all compared figures, in the order of the reference's tests; then the status of
            each test that only the candidate has.
        changed: differences of campaign, rig, model, filter and software versions, in words.
    """

    reference: Run
    candidate: Run
    figures: tuple[Compared, ...]
    changed: tuple[str, ...] = field(default=())

    @property
    def moved(self) -> list[Compared]:
        """The figures that moved beyond their tolerance, or that the candidate lacks."""
        return [each for each in self.figures if each.standing is Change.MOVED]


def tolerance_of(figure: str, tolerances: Mapping[str, Tolerance]) -> Tolerance:
    """Return the tolerance under a figure's name, or under the longest beginning of it.

    A name is a beginning if `_` follows it. Without any, the tolerance is zero.
    """
    fitting = [name for name in tolerances if figure == name or figure.startswith(f"{name}_")]
    return tolerances[max(fitting, key=len)] if fitting else Tolerance()


def compare(
    reference: Run, candidate: Run, tolerances: Mapping[str, Tolerance] | None = None
) -> Comparison:
    """Return the comparison of a run with another that is taken as right.

    Args:
        reference: the run that is taken as right.
        candidate: the run that is compared with it.
        tolerances: by the name of a figure; they take precedence over `TOLERANCES`.
    """
    known = {**TOLERANCES, **(tolerances or {})}
    ours = {str(test["name"]): test for test in candidate.tests}
    theirs = {str(test["name"]): test for test in reference.tests}
    figures: list[Compared] = []
    for name, test in theirs.items():
        figures += _compare_tests(name, test, ours.get(name), known)
    figures += (
        Compared(name, "status", None, str(test["status"]), Change.NEW)
        for name, test in ours.items()
        if name not in theirs
    )
    return Comparison(reference, candidate, tuple(figures), tuple(_changes(reference, candidate)))


def _compare_tests(
    name: str,
    reference: Mapping[str, Any],
    candidate: Mapping[str, Any] | None,
    tolerances: Mapping[str, Tolerance],
) -> Iterator[Compared]:
    words = {"status": str(reference["status"]), "verdict": _verdict(reference)}
    for figure, value in words.items():
        other = None
        if candidate is not None:
            other = str(candidate["status"]) if figure == "status" else _verdict(candidate)
        alike = value == other or tolerance_of(figure, tolerances) == ANYTHING
        yield Compared(name, figure, value, other, Change.SAME if alike else Change.MOVED)
    if candidate is None:
        return
    theirs, ours = _numbers(reference), _numbers(candidate)
    for figure in dict.fromkeys([*theirs, *ours]):
        tolerance = tolerance_of(figure, tolerances)
        yield _compared(name, figure, theirs.get(figure), ours.get(figure), tolerance)


def _compared(
    test: str,
    figure: str,
    reference: tuple[float, float | None, str] | None,
    candidate: tuple[float, float | None, str] | None,
    tolerance: Tolerance,
) -> Compared:
    if reference is None or candidate is None:
        known = reference or candidate
        assert known is not None
        gone = candidate is None and tolerance != ANYTHING
        change = Change.NEW if reference is None else Change.SAME
        return Compared(
            test, figure, reference and reference[0], candidate and candidate[0],
            Change.MOVED if gone else change, None, known[2],
        )  # fmt: skip
    error = 0.0
    if reference[1] is not None and candidate[1] is not None:
        error = hypot(reference[1], candidate[1])
    tolerated = tolerance.of(reference[0], error)
    moved = not abs(candidate[0] - reference[0]) <= tolerated
    change = Change.MOVED if moved else Change.SAME
    return Compared(test, figure, reference[0], candidate[0], change, tolerated, reference[2])


def _verdict(test: Mapping[str, Any]) -> str:
    return str(test["found"]["verdict"]) if test["found"] else "none"


def _numbers(test: Mapping[str, Any]) -> dict[str, tuple[float, float | None, str]]:
    """Return the value, standard error (None if unknown) and unit of a test's figures, by name."""
    found: dict[str, tuple[float, float | None, str]] = {}
    for figure, key in (("onset", "onset_s"), ("latency", "latency_s")):
        value = test["found"][key] if test["found"] else None
        if value is not None:
            found[figure] = (float(value), None, "s")
    for name, figure in (test.get("figures") or {}).items():
        if figure["value"] is not None:
            error = figure["standard_error"]
            value = float(figure["value"])
            found[str(name)] = (value, None if error is None else float(error), figure["unit"])
    return found


def _changes(reference: Run, candidate: Run) -> Iterator[str]:
    for what in ("name", "rig", "model", "filter"):
        old, new = reference.results.get(what), candidate.results.get(what)
        if old != new:
            yield f"{'campaign' if what == 'name' else what} {old} -> {new}"
    before, after = (run.results.get("provenance") or {} for run in (reference, candidate))
    if before.get("model_sha256") != after.get("model_sha256"):
        yield "the model's parameters"
    for name, version in (after.get("versions") or {}).items():
        old = (before.get("versions") or {}).get(name)
        if old != version:
            yield f"{name} {old} -> {version}"
