"""The terminal, or the file in its place: the same words, without colours and live lines."""

import os
import sys
from collections.abc import Callable
from typing import Final

from rich.console import Console

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
        """Go on in silence if somebody asked to be told, else leave the program, as rich does."""
        if self._on_closed is None:
            super().on_broken_pipe()
            return
        self.quiet = True
        # What is left in the stream's buffer would raise again when it is flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        self._on_closed()
