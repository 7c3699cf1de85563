"""The terminal, or the file in its place: the same words, colours and live lines on a terminal only."""

import os
import sys
from collections.abc import Callable
from typing import Final

from rich.console import Console

from .application import discard_output

_PLAIN_WIDTH: Final = 240
"""Columns where there is no terminal: a table in a log need not wrap."""


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
        """Go on in silence, or raise `BrokenPipeError` if nobody asked to be told."""
        self.quiet = True
        discard_output()
        if self._on_closed is None:
            raise BrokenPipeError
        self._on_closed()
