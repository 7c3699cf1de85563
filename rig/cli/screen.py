"""The terminal, or a file in its place, which gets the same words without colours or bars."""

import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Final

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from rig.plain_output import PlainOutput, shown

_PLAIN_WIDTH: Final = 240
"""Width in columns of an output that is no terminal; it is large so that tables do not wrap."""


class Screen(Console):
    """A console on standard output that takes no markup, as names may hold brackets.

    Args:
        on_closed: called when nobody reads the output any more (`rig run ... | head`), or when it
            cannot be written, as to a full disk. Without it, rich ends the program at that moment,
            or the error is raised.
    """

    def __init__(self, on_closed: Callable[[], None] | None = None) -> None:
        self._on_closed = on_closed
        terminal = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
        out: object = sys.stdout
        super().__init__(
            # Its own colours and moves of the cursor must arrive; `render` makes the texts plain.
            file=out.unfiltered if isinstance(out, PlainOutput) else sys.stdout,
            force_terminal=terminal,
            no_color=None if terminal else True,
            width=None if terminal else _PLAIN_WIDTH,
            highlight=False,
            markup=False,
            emoji=False,
        )

    def on_broken_pipe(self) -> None:
        """Call `on_closed` and write nothing more; without `on_closed`, end the program."""
        if self._on_closed is None:
            super().on_broken_pipe()
            return
        self.quiet = True
        # Otherwise the flush of the stream's buffer at exit would raise again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        self._on_closed()

    def _write_buffer(self) -> None:
        # What the system says of the output would otherwise be taken for an error of other files.
        try:
            super()._write_buffer()
        except OSError:
            if self._on_closed is None:
                raise
            self._buffer.clear()
            self.on_broken_pipe()

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """Yield the pieces of what is printed; control characters in their texts are shown."""
        for piece in super().render(renderable, options):
            yield piece if piece.control else piece._replace(text=shown(piece.text))

    def print_table(
        self,
        headings: Collection[str],
        rows: Iterable[Iterable[str | Text]],
        *,
        right: Collection[str] = (),
        fold: Collection[str] = (),
        title: str | None = None,
    ) -> None:
        """Print a table, drawn with ASCII where the output is no terminal.

        Args:
            headings: one heading for each column.
            rows: the cells of each row; a row without cells draws a line.
            right: headings of the columns that are aligned to the right.
            fold: headings of the columns whose long cells are wrapped at any character, rather than
                cut off.
            title: title above the table; None for none.
        """
        table = Table(box=box.ROUNDED if self.is_terminal else box.ASCII2, title=title)
        for heading in headings:
            table.add_column(
                heading,
                justify="right" if heading in right else "left",
                overflow="fold" if heading in fold else "ellipsis",
            )
        for row in rows:
            # Before the columns are laid out, as what is shown in its place is wider.
            cells = tuple(shown(cell) if isinstance(cell, str) else cell for cell in row)
            table.add_row(*cells) if cells else table.add_section()
        self.print(table)
