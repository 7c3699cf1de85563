"""This class collects the problems of several inputs, so that all are reported at once."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from .application import EXIT_BAD_INPUT, is_bad_input


class Problems:
    """A collection of the problems of the inputs read so far; the same line is kept once."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    @property
    def found(self) -> bool:
        """Whether there is any problem."""
        return bool(self._lines)

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect the problems of an input that the block reads; the error ends the block quietly.

        An error that lists no problems of the input is raised on.
        """
        try:
            yield
        except ValueError as error:
            if not is_bad_input(error):
                raise
            self._lines |= dict.fromkeys(str(error).splitlines())

    def add(self, line: str) -> None:
        """Add one problem."""
        self._lines[line] = None

    def report(self) -> int:
        """Write all problems to stderr; return `EXIT_BAD_INPUT`, or 0 if there are none."""
        for line in self._lines:
            click.echo(line, err=True)
        return EXIT_BAD_INPUT if self.found else 0
