"""A command that compiles for this machine says so, as it is then silent for a minute."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import click

from rig.compile_cache import COMPILED_ONCE, marks_folder


@contextmanager
def first_compiling(what: str, *, silent: bool = False, err: bool = False) -> Iterator[None]:
    """Say in a line that the block compiles, unless it has come to its end once before.

    Args:
        what: what is compiled, in words; an empty file of this name marks that it was.
        silent: whether nothing is said.
        err: whether the line goes to standard error.
    """
    folder = marks_folder()
    mark = None if folder is None else folder / what.replace(" ", "_")
    if not silent and (mark is None or not mark.exists()):
        click.echo(f"compiling for this machine, {COMPILED_ONCE}: {what}", err=err)
    yield
    if mark is not None:
        with suppress(OSError):
            mark.touch()
