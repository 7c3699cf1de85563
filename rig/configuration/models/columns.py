"""This module reads which columns of a recording are which channels, in which unit or scale.

The file of `--columns` has this alone; the model file of a plant from outside has it under
`channels`.
"""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, Final

from pydantic import create_model

from rig.configuration.reading import (
    ConfigError,
    Located,
    Problem,
    Problems,
    Schema,
    Sources,
    display_path,
    quantity_in,
    read_mapping,
    shown,
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


def checked(
    item: Located,
    fields: Mapping[str, Any],
    problems: Problems,
    hints: dict[str, str] | None = None,
) -> dict[str, Any]:
    """Return the values of a mapping for the keys of `fields`; None where absent or wrong.

    `fields` gives the type of each key's value, `hints` the remedy for misplaced keys. Mistakes are
    added to the problems.
    """
    definitions: dict[str, Any] = {key: (kind, None) for key, kind in fields.items()}
    made = create_model("Section", __base__=Schema, **definitions)
    file = read_mapping(made, item, problems, hints)
    return {key: getattr(file, key, None) for key in fields}


def column_in(
    name: str, entry: Located, unit: str, problems: Problems, further: Mapping[str, Any]
) -> tuple[Column, dict[str, Any]]:
    """Return the column that an entry gives a channel, and the values of its further keys.

    The entry is the column's name, or a mapping with `column`, and `unit` or `scale`. Mistakes are
    added to the problems.

    Args:
        name: name of the channel, which its column has if the entry gives none.
        entry: the entry.
        unit: SI unit of the channel.
        problems: where problems are added.
        further: further keys that the entry may have -> type.
    """
    if isinstance(entry.value, str) and entry.value:
        return Column(entry.value), {}
    if not isinstance(entry.value, dict):
        limit = "is neither the name of a column nor a mapping"
        remedy = f"write `{name}: COLUMN`, or `{name}: {{column: COLUMN, unit: UNIT}}`"
        problems.add(entry.place, name, shown(entry), limit, remedy)
        return Column(name), {}
    fields = {"column": str | None, "unit": str | None, "scale": float | None} | dict(further)
    found = checked(entry, fields, problems)
    factor = 1.0
    if found["unit"] is not None and found["scale"] is not None:
        place = entry.find(("scale",)).place
        problems.add(place, "scale", found["scale"], "is given beside unit", "keep one")
    elif found["unit"] is not None:
        item = entry.find(("unit",))
        read = quantity_in(item, lambda: unit_factor(found["unit"], unit), problems)
        factor = 1.0 if read is None else float(read)
    elif found["scale"] is not None:
        factor = found["scale"]
        if not isfinite(factor) or factor == 0.0:
            item = entry.find(("scale",))
            limit = f"must be how many {unit or 'SI units'} one unit of the column is"
            problems.add(item.place, "scale", shown(item), limit, "give a number")
    return Column(found["column"] or name, factor), found


def load_columns(path: Path) -> dict[str, Column]:
    """Return the columns that a file of `--columns` gives the channels of the rig.

    Raises:
        ConfigError: lists every problem of the file.
    """
    if not path.is_file():
        limit = "is not a file" if path.exists() else "does not exist"
        remedy = "give a YAML file, as in `position_m: {column: q, unit: mm}`"
        raise ConfigError([Problem("--columns", 0, 0, display_path(path), "", limit, remedy)])
    sources = Sources()
    root = sources.read_yaml(path.resolve())
    sources.problems.raise_if_any()
    assert root is not None
    checked(root, dict.fromkeys(OF_RIG, Any), sources.problems)
    columns = {
        name: column_in(name, entry, unit_of(name), sources.problems, {})[0]
        for name, entry in root.items()
        if name in OF_RIG
    }
    sources.problems.raise_if_any()
    return columns
