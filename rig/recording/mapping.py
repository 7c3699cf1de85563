"""Columns of a file may have other names or units than the channels that are read from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .errors import RecordingProblem
from .table import Table


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a file: its name, and the factor from its unit to the channel's SI unit."""

    name: str
    factor: float = 1.0


def mapped(table: Table, columns: Mapping[str, Column], needed: Sequence[str]) -> set[str]:
    """Rename and scale a table's columns to channels, in place; return the needed ones it lacks.

    For each of the latter a problem is added to the table. A needed channel that `columns` does not
    name is not looked for.

    Args:
        table: the table, which is changed.
        columns: channel -> column of the file.
        needed: channels that the table must have.
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
                    "name the column of this file where the columns are named",
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
