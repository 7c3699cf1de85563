"""Compares two runs figure by figure: which moved beyond its tolerance, and which is missing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import hypot, inf
from typing import Any, Final

from rig.runner.outcomes import Figure

from .archive import Run, RunError
from .directory import RESULTS
from .resuming import changes_of


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
    "loop_missed": Tolerance(absolute=1e-3, sigmas=3.0),
    "loop": Tolerance(absolute=1e-4, relative=1.0),
}
"""Default tolerances, by a figure's name or the beginning of it; the longest fitting one is used.

Leaks (L/min) may differ by their 99.7 % interval and 5 %; residuals by 10 %; friction, which is
identified from some twenty strokes, by 4 standard errors; times of the loop by a factor of two, as
machines stall. How many ticks a run misses is the luck of its machine: the share may differ by the
99.7 % interval that follows from how many stalls there were and how long each lasted, and by one
tick in a thousand, which no figure of a test notices."""

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
        candidate: its value in the candidate, a text or a number likewise; None if the candidate
            lacks it.
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
        if isinstance(self.reference, str | None) or isinstance(self.candidate, str | None):
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
        """The figures that have the standing `MOVED`: beyond the tolerance, or missing."""
        return [each for each in self.figures if each.standing is Change.MOVED]


def tolerance_of(figure: str, tolerances: Mapping[str, Tolerance]) -> Tolerance:
    """Return the tolerance under a figure's name, or under the longest beginning of the name.

    A key is a beginning of the name if `_` follows it there. If no key fits, the tolerance is zero.
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
        tolerances: tolerances by a figure's name or the beginning of it; one of them replaces that
            of the same key in `TOLERANCES`.

    Raises:
        RunError: a run's results lack something that is compared.
    """
    for run in (reference, candidate):
        _require_figures(run)
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


def _require_figures(run: Run) -> None:
    """Raise `RunError` unless a run's results have what is compared, as all do that a run wrote."""
    try:
        list(_changes(run, run))
        for test in run.tests:
            _word(test, "verdict")
            _numbers(test)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RunError(
            f"{run.folder / RESULTS}: is damaged ({type(error).__name__}: {error}); "
            "restore the file, or run anew"
        ) from None


def _compare_tests(
    name: str,
    reference: Mapping[str, Any],
    candidate: Mapping[str, Any] | None,
    tolerances: Mapping[str, Tolerance],
) -> Iterator[Compared]:
    for figure in ("status", "verdict"):
        value, other = _word(reference, figure), _word(candidate, figure)
        alike = value == other or tolerance_of(figure, tolerances) == ANYTHING
        yield Compared(name, figure, value, other, Change.SAME if alike else Change.MOVED)
    if candidate is None:
        return
    theirs, ours = _numbers(reference), _numbers(candidate)
    for figure, known in {**theirs, **ours, **theirs}.items():
        old, new, tolerated = theirs.get(figure), ours.get(figure), None
        tolerance = tolerance_of(figure, tolerances)
        if old is None:
            change = Change.NEW
        elif new is None:
            change = Change.SAME if tolerance == ANYTHING else Change.MOVED
        else:
            tolerated = tolerance.of(old.value, _error(old, new))
            alike = abs(new.value - old.value) <= tolerated
            change = Change.SAME if alike else Change.MOVED
        before = None if old is None else old.value
        after = None if new is None else new.value
        yield Compared(name, figure, before, after, change, tolerated, known.unit)


def _error(old: Figure, new: Figure) -> float:
    """Return the standard error of the difference of two figures; 0 if it is not known."""
    if old.standard_error is None or new.standard_error is None:
        return 0.0
    return hypot(old.standard_error, new.standard_error)


def _word(test: Mapping[str, Any] | None, figure: str) -> str | None:
    """Return the status of a test, or its verdict; None without a test.

    The verdict of a test without a decision is "none". `figure` is "status" or "verdict".
    """
    if test is None:
        return None
    if figure == "status":
        return str(test["status"])
    return str(test["found"]["verdict"]) if test["found"] else "none"


def _numbers(test: Mapping[str, Any]) -> dict[str, Figure]:
    """Return a test's figures by name, with onset and latency in s; without those that are None."""
    found: dict[str, Figure] = {}
    for name, key in (("onset", "onset_s"), ("latency", "latency_s")):
        value = test["found"][key] if test["found"] else None
        if value is not None:
            found[name] = Figure(float(value), None, "s")
    for name, figure in (test.get("figures") or {}).items():
        if figure["value"] is not None:
            error = figure["standard_error"]
            known = None if error is None else float(error)
            found[str(name)] = Figure(float(figure["value"]), known, figure["unit"])
    return found


def _changes(reference: Run, candidate: Run) -> Iterator[str]:
    keys = {"campaign": "name", "rig": "rig", "model": "model", "filter": "filter"}
    theirs, ours = (
        {what: run.results.get(key) for what, key in keys.items()} for run in (reference, candidate)
    )
    yield from changes_of(theirs, ours)
    before, after = (run.results.get("provenance") or {} for run in (reference, candidate))
    if before.get("model_sha256") != after.get("model_sha256"):
        yield "the model's parameters"
    yield from changes_of(before.get("versions") or {}, after.get("versions") or {})
