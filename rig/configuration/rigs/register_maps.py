"""Register maps of Modbus devices and DBC files of CAN devices say where signals are found."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from rig.configuration.reading import Located, Place, Sources, options_of, read_options
from rig.io import BypassRegisters, RegisterMap

if TYPE_CHECKING:
    from cantools.database.can import Database

Map = RegisterMap | BypassRegisters
MAPS: Final[tuple[type[Map], ...]] = (RegisterMap, BypassRegisters)


def read_map(root: Located) -> Map | None:
    """Return the map that a file describes; if it is unusable, record problems, return None.

    The file is read as a `RegisterMap` or as `BypassRegisters`, of whichever it has more keys.
    """
    keys = {key for key, _ in root.items()}
    best = max(MAPS, key=lambda kind: len(keys & set(options_of(kind))))
    return read_options(best, root)


def read_dbc(path: Path, sources: Sources) -> "Database | None":
    """Return the CAN messages in a DBC file; if it cannot be read, add a problem, return None."""
    # cantools takes a tenth of a second to import, and few configurations are DBC files.
    from rig.io import cantools

    content = sources.read_bytes(path)
    if content is None:
        return None
    try:
        database = cantools.database.load_string(content.decode("cp1252"), database_format="dbc")
    except (cantools.database.errors.Error, ValueError) as error:
        reason = " ".join(str(error).split())
        start = Place(path, 1, 1)
        sources.problems.add(start, "DBC", "", f"cannot be parsed: {reason}", "correct the file")
        return None
    assert isinstance(database, cantools.database.can.Database)
    return database
