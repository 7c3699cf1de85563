"""The terminal; a file in its place gets the same words, without colours and live lines."""

import os
import sys
from collections.abc import Callable, Collection, Iterable
from typing import Final

from rich import box
from rich.console import Console
from rich.table import Table

_PLAIN_WIDTH: Final = 240
"""Width in columns where there is no terminal, so that tables in a log do not wrap."""


class Screen(Console):
    """Standard output, without markup: names may hold brackets.

    Args:
        on_closed: called when nobody reads the output any more (`rig run ... | head`), instead of
            rich's leaving the program there and then.
    """

    def __init__(self, on_closed: Callable[[], None] | None = None) -> None:
        self._on_closed = on_closed
        terminal = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
        super().__init__(
            file=sys.stdout,
            force_terminal=terminal,
            no_color=None if terminal else True,
            width=None if terminal else _PLAIN_WIDTH,
            highlight=False,
            markup=False,
            emoji=False,
        )

    def on_broken_pipe(self) -> None:
        """Call `on_closed` and go on in silence; without one leave the program, as rich does."""
        if self._on_closed is None:
            super().on_broken_pipe()
            return
        self.quiet = True
        # What is left in the stream's buffer would raise again when it is flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        self._on_closed()


def table_of(
    headings: Iterable[str],
    *,
    plain: bool,
    right: Collection[str] = (),
    fold: bool = False,
    title: str | None = None,
) -> Table:
    """Return a table without rows.

    Args:
        headings: of the columns.
        plain: whether the table is drawn with ASCII.
        right: headings of the columns that are aligned to the right.
        fold: whether long cells are wrapped anywhere, rather than cut off.
        title: above the table, if there is one.
    """
    table = Table(box=box.ASCII2 if plain else box.ROUNDED, title=title)
    for heading in headings:
        table.add_column(
            heading,
            justify="right" if heading in right else "left",
            overflow="fold" if fold else "ellipsis",
        )
    return table
