"""Collects what is wrong with several inputs, so that all of it is reported at once."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from .application import EXIT_BAD_INPUT, is_bad_input


class Problems:
    """What is wrong with the inputs seen so far, each line once."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    @property
    def found(self) -> bool:
        """Whether anything is wrong."""
        return bool(self._lines)

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Note what is wrong with the input that the block reads, which ends the block."""
        try:
            yield
        except ValueError as error:
            if not is_bad_input(error):
                raise
            self._lines |= dict.fromkeys(str(error).splitlines())

    def add(self, line: str) -> None:
        """Take note of one problem."""
        self._lines[line] = None

    def report(self) -> int:
        """Write all problems to stderr; return the exit code, 0 if there are none."""
        for line in self._lines:
            click.echo(line, err=True)
        return EXIT_BAD_INPUT if self.found else 0
