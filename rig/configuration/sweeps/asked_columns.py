"""Names of the table's columns for what a sweep asks of its cases; two meanings share none.

A column's name is made of a label, in which each space becomes an underscore, so that different
labels can make one name. Such a pair is refused when the sweep is read, because one of the two
would overwrite the other in the table.
"""

from collections.abc import Hashable, Iterable, Iterator, Sequence
from math import inf
from typing import NamedTuple

from faults import Criterion, OwnFigure, TestLimit
from rig.configuration.campaigns import criterion_in_words
from rig.configuration.reading import Located


def asked_column(kind: str, label: str) -> str:
    """Return the name of a column: its kind, and the label of a figure or limit."""
    return f"{kind}_{label.replace(' ', '_')}"


def limit_label(limit: TestLimit) -> str:
    """Return the name under which a limit is counted: what it watches, and in which segment."""
    return f"{limit.watched} in {limit.during}" if limit.during else limit.watched


def figures_judged_twice(motions: Iterable[Sequence[Criterion]]) -> frozenset[str]:
    """Return the labels of the figures for which some motion has several different criteria.

    Args:
        motions: the criteria of each motion of a sweep.
    """
    labels = [[each.label for each in set(criteria)] for criteria in motions]
    return frozenset(label for each in labels for label in each if each.count(label) > 1)


def met_column(criterion: Criterion, judged_twice: frozenset[str]) -> str:
    """Return the name of the column that tells whether a criterion was met.

    It is `met_LABEL`. For a figure with several criteria it ends with the limits, as in
    `met_rms_error_at_most_3_mm`, so that each criterion has a column of its own.

    Args:
        criterion: the criterion.
        judged_twice: labels as `figures_judged_twice` returns them for the whole sweep.
    """
    label = criterion.label
    return asked_column("met", criterion_in_words(criterion) if label in judged_twice else label)


class _Claim(NamedTuple):
    """A column that something in the file needs.

    Attributes:
        column: name of the column.
        figure: the figure and where it is taken, or what a limit watches and where.
        ends: the limits of a criterion whose figure has several; empty for other claims.
        words: what needs it, for a message.
        item: the place in the file.
        key: the key of `item` at which a problem is placed; empty for `item` itself.
    """

    column: str
    figure: Hashable
    ends: tuple[float, ...]
    words: str
    item: Located
    key: str

    @property
    def meaning(self) -> Hashable:
        """What the column tells; two claims with the same meaning share it."""
        return self.figure, self.ends


class AskedColumns:
    """Collects the columns that a sweep needs, and refuses those with two meanings.

    Attributes:
        own: the sweep's own figures, each with its place in the file.
        criteria: the criteria of each motion, each with its place.
        limits: the limits of each motion, each with its place.
    """

    def __init__(self) -> None:
        self.own: list[tuple[Located, OwnFigure]] = []
        self.criteria: list[list[tuple[Located, Criterion]]] = []
        self.limits: list[list[tuple[Located, TestLimit]]] = []

    def check(self) -> None:
        """Record a problem for each two meanings of one column, at the place of the second."""
        first: dict[str, _Claim] = {}
        refused = set()
        for claim in self._claims():
            known = first.setdefault(claim.column, claim)
            pair = known.figure, claim.figure
            if known.meaning == claim.meaning or pair in refused:
                continue
            refused.add(pair)
            limit = (
                f"makes the column {claim.column} of the table, as {known.words} "
                f"of line {known.item.place.line} does"
            )
            remedy = "rename one of them, so that more than a space and an underscore differs"
            if known.words == claim.words:
                remedy = "leave one of them out"
            claim.item.refuse(limit, remedy, claim.words, claim.key)

    def _claims(self) -> Iterator[_Claim]:
        for item, own in self.own:
            if own.expression.is_number:
                figure: Hashable = (own.name, "", (0.0, inf))
                words = f"the sweep's own figure {own.name}"
                yield _Claim(asked_column("figure", own.name), figure, (), words, item, "")
        twice = figures_judged_twice([each for _, each in pairs] for pairs in self.criteria)
        for item, criterion in (pair for pairs in self.criteria for pair in pairs):
            figure, label = _figure(criterion), criterion.label
            yield _Claim(asked_column("figure", label), figure, (), label, item, "figure")
            ends: tuple[float, ...] = ()
            words = label
            if label in twice:
                ends = criterion.low, criterion.high
                words = criterion_in_words(criterion)
            yield _Claim(met_column(criterion, twice), figure, ends, words, item, "figure")
        for item, limit in (pair for pairs in self.limits for pair in pairs):
            label, key = limit_label(limit), watched_key(item)
            for band in limit.bands:
                column = asked_column(band.name, label)
                yield _Claim(column, (limit.watched, limit.during), (), label, item, key)


def watched_key(item: Located) -> str:
    """Return the key with which a limit of the file names what it watches."""
    return "channel" if item.get("channel") is not None and item.get("figure") is None else "figure"


def _figure(criterion: Criterion) -> Hashable:
    """Return what a criterion's figure is, equal for equal figures of the same stretch.

    A segment of one name may lie at another time in each motion, so that only its name counts.
    """
    stretch = (criterion.from_s, criterion.until_s)
    return criterion.figure, criterion.channel, criterion.during or stretch
