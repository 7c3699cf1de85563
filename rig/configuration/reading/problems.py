"""The problems of a configuration are collected from all its files and reported together."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

MOST_FOUND = 1000
"""Most problems that are collected: more than anybody mends at once, and as many as are reported in
a second. A file whose every line is wrong, of 8 MB, would take minutes."""
MOST_REPORTED = 10 * MOST_FOUND
"""Most reports, with repetitions; the mistakes in an alias are reported wherever it is used."""
LONGEST_MESSAGE = 4000
"""Most characters of a problem's line; some hundred names that may be chosen fit into it."""


class Place(NamedTuple):
    """A position in a file; line and column count from 1, and are 0 where there is no line."""

    path: Path
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: its place, the field, the value, the rule that it breaks, and a remedy.

    `limit` is the rule as a phrase that follows the value, such as "is above 3 V". Lines and
    columns count from 1; line 0 means that the mistake is not at a line of a file.
    """

    path: str
    line: int
    column: int
    field: str
    value: str
    limit: str
    remedy: str

    def __str__(self) -> str:
        """Return the problem as one line, `file:line:column field: value limit; remedy`."""
        where = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        what = f"{self.value} {self.limit}".strip()
        text = f"{where} {self.field}: {what}" + (f"; {self.remedy}" if self.remedy else "")
        # A name or a value may be as long as the file, and would hide what is wrong with it.
        line = " ".join((text if len(text) <= LONGEST_MESSAGE else self._shortened()).split())
        # A value may hold any character, and one such as ESC would command the terminal.
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)

    def _shortened(self) -> str:
        """Return the line with its long parts cut, to `LONGEST_MESSAGE` characters or few more."""
        most = LONGEST_MESSAGE // 4
        cut = [
            part if len(part) <= most else f"{part[: most - 3]}..."
            for part in (self.field, self.value, self.limit, self.remedy)
        ]
        where = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        return f"{where} {cut[0]}: {cut[1]} {cut[2]}; {cut[3]}"


class ConfigError(ValueError):
    """The error of a configuration that cannot be used; `problems` lists every mistake found."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: list[Problem] = list(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


@dataclass
class Problems:
    """A collection of the problems of all files of a configuration, each of them once.

    `found` has the problems. `reported` counts them with repetitions, which occur as the tests of a
    matrix share their mistakes; code compares it before and after a step to see whether it failed.
    """

    found: list[Problem] = field(default_factory=list)
    reported: int = 0
    _fields: dict[tuple[str, int, int], set[str]] = field(default_factory=dict, repr=False)
    _known: set[Problem] = field(default_factory=set, repr=False)

    def add(self, place: Place, name: str, value: object, limit: str, remedy: str = "") -> None:
        """Record one mistake, unless the same one is recorded already; count it in any case.

        Raises:
            ConfigError: lists the mistakes so far, as there are more than `MOST_FOUND`, or more
                reports than `MOST_REPORTED`.
        """
        if len(self.found) >= MOST_FOUND or self.reported >= MOST_REPORTED:
            limit = f"has more than the {len(self.found)} mistakes that are listed here"
            more = Problem(display_path(place.path), 0, 0, "file", "", limit, "mend these first")
            raise ConfigError([*self._sorted(), more])
        self.reported += 1
        problem = Problem(
            display_path(place.path), place.line, place.column, name, str(value), limit, remedy
        )
        # A file may have some hundred thousand mistakes, so that the list is not searched for each.
        if problem not in self._known:
            self._known.add(problem)
            self.found.append(problem)
            where = (problem.path, problem.line, problem.column)
            self._fields.setdefault(where, set()).add(name)

    def has_at(self, place: Place, name: str = "") -> bool:
        """Return whether a mistake at a place is recorded already, if `name` is given, of that.

        A mapping and its first key have the same place, which `name` tells apart.
        """
        where = (display_path(place.path), place.line, place.column)
        fields = self._fields.get(where, set())
        return name in fields if name else bool(fields)

    def raise_if_any(self) -> None:
        """Raise an error with all problems, sorted by place, if there are any.

        Raises:
            ConfigError: at least one problem was recorded.
        """
        if self.found:
            raise ConfigError(self._sorted())

    def _sorted(self) -> list[Problem]:
        return sorted(self.found, key=lambda p: (p.path, p.line, p.column))


def display_path(path: Path) -> str:
    """Return a path as text, relative to the working directory if it lies below that."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known name that is closest to a misspelt one; None if none is close.

    Upper and lower case count as the same.
    """
    names = list(known)
    lowered = {name.lower(): name for name in names}
    matches = difflib.get_close_matches(word.lower(), lowered, n=1, cutoff=0.6)
    return lowered[matches[0]] if matches else None


def suggestion(word: str, known: Sequence[str], kind: str) -> str:
    """Return the remedy for a misspelt name: the nearest known name, else a list of all of them.

    `kind` says in the plural what the names are, for the list.
    """
    near = nearest(word, known)
    listing = f"{kind}: {', '.join(known)}" if known else f"there are no {kind}"
    return f"did you mean {near}?" if near else listing
