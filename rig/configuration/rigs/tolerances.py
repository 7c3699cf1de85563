"""A tolerance file says by how much the figures of two runs may differ when they are compared.

It has one entry for each figure or group of figures.
"""

from pathlib import Path
from typing import Annotated

from pydantic import Field as SchemaField

from rig.configuration.reading import Schema, Sources, read_mapping, suggestion

KNOWN = (
    "status", "verdict", "onset", "latency", "leak", "residual", "friction", "bulk_modulus", "loop",
)  # fmt: skip
"""Names of figures, or first words of their names."""


class ToleranceFile(Schema):
    """Keys of one figure's tolerance: absolute, relative, and in standard errors."""

    absolute: Annotated[float, SchemaField(ge=0.0, allow_inf_nan=False)] = 0.0
    relative: Annotated[float, SchemaField(ge=0.0, allow_inf_nan=False)] = 0.0
    sigmas: Annotated[float, SchemaField(ge=0.0, allow_inf_nan=False)] = 0.0


def load_tolerances(path: Path) -> dict[str, ToleranceFile | None]:
    """Return figure -> tolerance from a file; the tolerance of an ignored figure is None.

    Raises:
        ConfigError: lists every problem of the file.
    """
    sources = Sources()
    found: dict[str, ToleranceFile | None] = {}
    root = sources.read_yaml(path)
    for name, item in root.items() if root is not None else ():
        if not any(name == known or name.startswith(f"{known}_") for known in KNOWN):
            item.refuse("is not a figure", suggestion(name, KNOWN, "figures begin with"), "")
        elif item.value == "ignore":
            found[name] = None
        elif not isinstance(item.value, dict):
            remedy = "write `ignore`, or `{absolute: ..., relative: ..., sigmas: ...}`"
            item.refuse("is no tolerance", remedy)
        else:
            found[name] = read_mapping(ToleranceFile, item)
    return sources.finished(found)
