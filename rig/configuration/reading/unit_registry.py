"""This module makes pint's registry of units, and keeps what pint read of its own definitions."""

import os
import shutil
from decimal import Decimal
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

from rig.compile_cache import cache_home

if TYPE_CHECKING:
    import pint

DEFINITIONS: Final = (
    # By default pint converts 1 Hz to 1 rad/s, which would make a 100 Hz valve a 16 Hz one.
    "hertz = 2 * pi * radian / second = Hz",
    # pint has the US gallon of 231 cubic inches, but no name for the unit of American flow meters.
    "gallon_per_minute = gallon / minute = gpm",
)
"""Units that pint lacks, or has in another meaning."""


@cache
def unit_registry() -> "pint.UnitRegistry[Any]":
    """Return the registry of all units that may be written, with numbers as `Decimal`."""
    # pint takes a quarter of a second to import, which commands without quantities avoid this way.
    import pint

    folder = cache_home() / f"hydraulic-rig-units/{pint.__version__}"
    registry = _kept(folder) or _made(None)
    for definition in DEFINITIONS:
        registry.define(definition)
    return registry


def _made(folder: Path | None) -> "pint.UnitRegistry[Any]":
    """Make a registry from pint's definitions.

    With a folder, take what pint keeps there of them, or write it there; with None, keep nothing.
    """
    import pint

    return pint.UnitRegistry(non_int_type=Decimal, on_redefinition="ignore", cache_folder=folder)


def _kept(folder: Path) -> "pint.UnitRegistry[Any] | None":
    """Return a registry made from what a folder keeps, which takes a tenth of the time.

    If there is no such folder yet, it is made and filled. As pint writes to its folder without a
    lock, that is done under another name, and the folder is renamed then. Return None if the folder
    cannot be made, or if its content is of no use; it is removed in the latter case.
    """
    try:
        if folder.is_dir():
            return _made(folder)
        folder.parent.mkdir(parents=True, exist_ok=True)
        new = Path(mkdtemp(dir=folder.parent))
    except OSError:
        return None
    except Exception:
        shutil.rmtree(folder, ignore_errors=True)
        return None
    registry = _made(new)
    try:
        os.rename(new, folder)
    except OSError:
        # Another process was faster.
        shutil.rmtree(new, ignore_errors=True)
    return registry
