"""This module reads which columns of a recording are which channels, in which unit or scale.

A file that a command takes by `--columns` holds nothing else; the model file of a plant that a user
describes has it under the key `channels`.
"""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from rig.configuration.reading import (
    ConfigError,
    Located,
    Problem,
    Sources,
    checked,
    display_path,
    quantity_in,
    unit_factor,
)
from rig.recording import Column, unit_of

TIME: Final = "time_s"
OF_RIG: Final = (
    TIME,
    "command_V",
    "position_m",
    "pressure_1_Pa",
    "pressure_2_Pa",
    "spool_m",
    "supply_pressure_Pa",
)
"""Channels of the servo-hydraulic rig that a file of columns may name."""


def column_in(
    name: str, entry: Located, unit: str, further: Mapping[str, Any] = MappingProxyType({})
) -> tuple[Column, dict[str, Any]]:
    """Return the column that an entry gives a channel, and the values of the entry's keys.

    The entry is the column's name, or a mapping with `column`, and `unit` or `scale`. The values
    are None for keys that are absent or wrong; the mapping of values is empty unless the entry is a
    mapping. Mistakes are recorded as problems.

    Args:
        name: name of the channel, which its column has if the entry gives none.
        entry: the entry.
        unit: SI unit of the channel.
        further: further keys that the entry may have -> type.
    """
    if isinstance(entry.value, str) and entry.value:
        return Column(entry.value), {}
    if not isinstance(entry.value, dict):
        remedy = f"write `{name}: COLUMN`, or `{name}: {{column: COLUMN, unit: UNIT}}`"
        entry.refuse("is neither the name of a column nor a mapping", remedy)
        return Column(name), {}
    fields = {"column": str | None, "unit": str | None, "scale": float | None} | dict(further)
    found = checked(entry, fields)
    factor = 1.0
    if found["unit"] is not None and found["scale"] is not None:
        entry.refuse("is given beside unit", "keep one", found["scale"], "scale")
    elif found["unit"] is not None:
        read = quantity_in(entry.find("unit"), lambda: unit_factor(found["unit"], unit))
        factor = 1.0 if read is None else float(read)
    elif found["scale"] is not None:
        factor = found["scale"]
        if not isfinite(factor) or factor == 0.0:
            limit = f"must be how many {unit or 'SI units'} one unit of the column is"
            entry.refuse(limit, "give a number", key="scale")
    return Column(found["column"] or name, factor), found


def load_columns(path: Path) -> dict[str, Column]:
    """Return channel of the rig -> column of a recording, from a file given by `--columns`.

    Raises:
        ConfigError: lists every problem of the file.
    """
    if not path.is_file():
        limit = "is not a file" if path.exists() else "does not exist"
        remedy = "give a YAML file, as in `position_m: {column: q, unit: mm}`"
        raise ConfigError([Problem("--columns", 0, 0, display_path(path), "", limit, remedy)])
    sources = Sources()
    root = sources.finished(sources.read_yaml(path.resolve()))
    checked(root, dict.fromkeys(OF_RIG, Any))
    columns = {
        name: column_in(name, entry, unit_of(name))[0]
        for name, entry in root.items()
        if name in OF_RIG
    }
    return sources.finished(columns)
