"""Columns that a recording has under other names, or in other units, than a channel's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .errors import RecordingProblem
from .table import Table


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a file: its name, and how many SI units one of its units is."""

    name: str
    factor: float = 1.0


def mapped(table: Table, columns: Mapping[str, Column], needed: Sequence[str]) -> set[str]:
    """Give a table's columns the names and units of channels; return the needed ones it lacks.

    A problem is added for each of these.
    """
    found = {}
    lacking = set()
    for channel, column in columns.items():
        if column.name in table.columns:
            found[channel] = table.columns[column.name] * column.factor
        elif channel in needed:
            lacking.add(channel)
            table.problems.append(
                RecordingProblem(
                    table.path, None, column.name, f"missing column, which is to be {channel}",
                    f"columns present: {', '.join(table.columns)}",
                    "name the column of this file in the model file, under channels",
                )
            )  # fmt: skip
    unread = {
        channel: table.unreadable[columns[channel].name]
        for channel in found
        if columns[channel].name in table.unreadable
    }
    taken = {column.name for column in columns.values()} | lacking
    table.columns = {name: v for name, v in table.columns.items() if name not in taken} | found
    table.unreadable = {
        name: v for name, v in table.unreadable.items() if name not in taken
    } | unread
    return lacking
