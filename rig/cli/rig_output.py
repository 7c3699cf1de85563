"""The option --out of commands that write a rig file, and what is refused of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from rig.configuration import find_rig, shipped_config_dir

from .application import Problems

RIG_OUT: Final[Callable[[Callable[..., Any]], Callable[..., Any]]] = click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the rig to this new file, and leave RIG as it is.",
)
"""Decorator that adds the option --out to a command which changes the rig file RIG."""


def refuse_output(problems: Problems, out: Path | None) -> None:
    """Add a problem for each reason why no rig file can be written to `out`, if it is given."""
    if out is None:
        return
    if out.exists():
        problems.add(f"--out: {out} exists; name a new file")
    if out.suffix not in (".yaml", ".yml"):
        problems.add(f"--out: {out} does not end in .yaml, as the path of a rig file does")
    if not out.parent.is_dir():
        problems.add(f"--out: {out.parent} is no folder; make it first")


def refuse_shipped(problems: Problems, reference: str, out: Path | None) -> None:
    """Add a problem if the rig file would be changed in place, but is one that is shipped.

    Args:
        problems: the problems found so far.
        reference: path or name of a rig file that can be read.
        out: the new file that is written instead; None if the rig file itself is changed.
    """
    if out is None and find_rig(reference).is_relative_to(shipped_config_dir()):
        problems.add(f"{reference}: is a shipped rig; give --out FILE, or copy it: rig init DIR")
