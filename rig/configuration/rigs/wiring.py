"""The section `wiring` of rig files: which signs and pressure lines are turned over."""

from collections.abc import Iterator
from dataclasses import fields

from rig.configuration.reading import Located, read_options
from rig.io import Wiring


def read_wiring(root: Located, hardware: bool) -> Wiring | None:
    """Return how a rig is wired; None if its section is unusable.

    A simulated rig has no wires, and what it inherits does not count. Problems are recorded: a
    simulated rig's own file with the section, and an encoder that counts backwards on a rig that is
    not homed, whose zero is not where its device says either.

    Args:
        root: mapping of the rig file.
        hardware: whether the rig is hardware.
    """
    item = root.get("wiring")
    if item is None:
        return Wiring()
    if not hardware:
        if item.place.path == root.place.path:
            remedy = "add `backend: hardware`, or remove it"
            item.refuse("is of a simulated rig, which has no wires", remedy, "")
        return Wiring()
    wiring = read_options(Wiring, item)
    if wiring is not None and wiring.encoder == "inverted" and root.get("homing") is None:
        limit = "needs the section `homing`, which finds the zero of such an encoder"
        remedy = "add it, or turn an absolute encoder over in the register map, by scale and offset"
        item.refuse(limit, remedy, "inverted", "encoder")
    return wiring


def wiring_lines(wiring: Wiring, comment: str) -> Iterator[str]:
    """Yield the lines of a section `wiring` that reads back as `wiring`, a comment first."""
    yield f"# {comment}"
    yield "wiring:"
    for field in fields(wiring):
        yield f"  {field.name}: {getattr(wiring, field.name)}"
