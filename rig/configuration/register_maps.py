"""What devices call their signals: register maps of Modbus devices, DBC files of CAN ones."""

from pathlib import Path
from typing import TYPE_CHECKING

from rig.io.register_map import RegisterMap

from .document import Sources
from .options import read_options
from .problems import Place

if TYPE_CHECKING:
    from cantools.database.can import Database


def read_register_map(path: Path, sources: Sources) -> RegisterMap | None:
    """Return the register map in a YAML file; None, with problems, if it is unusable."""
    root = sources.read_yaml(path)
    return read_options(RegisterMap, root, sources) if root is not None else None


def read_dbc(path: Path, sources: Sources) -> "Database | None":
    """Return the CAN messages in a DBC file; None, with a problem, if it is none."""
    # Imported here: cantools costs a tenth of a second, and few configurations are DBC files.
    from cantools.database.can import Database
    from cantools.database.errors import Error

    content = sources.read_bytes(path)
    if content is None:
        return None
    database = Database()
    try:
        database.add_dbc_string(content.decode("cp1252"))
    except (Error, ValueError) as error:
        reason = " ".join(str(error).split())
        start = Place(path, 1, 1)
        sources.problems.add(start, "DBC", "", f"cannot be parsed: {reason}", "correct the file")
        return None
    return database
