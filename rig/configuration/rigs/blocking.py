"""Blocking valves: one in the line of each chamber, which together lock the cylinder."""

from dataclasses import dataclass
from typing import Annotated

from rig.channels import BLOCKING
from rig.configuration.reading import Located, Physical, Schema, read_mapping
from rig.io import DriverSpec
from rig.plant import LITRE_PER_MINUTE


@dataclass(frozen=True)
class BlockingValves:
    """The blocking valves of a rig, both of the same kind.

    Attributes:
        travel_s: time in s that a valve takes from open to shut.
        leak: greatest leak of a shut valve by its data sheet, m^3/s.
        leak_pressure: pressure difference in Pa at which that is stated.
    """

    travel_s: float
    leak: float
    leak_pressure: float


class BlockingFile(Schema):
    """Keys of the blocking valves of a rig file."""

    travel: Annotated[float, Physical("s", 0.0, 2.0, 0.2)] = 0.2
    leak: Annotated[float, Physical("m^3/s", 0.0, 1e-6, 1e-4 * LITRE_PER_MINUTE)]
    leak_pressure: Annotated[float, Physical("Pa", 1e5, 1e8, 1e7)]


def read_blocking_valves(
    item: Located | None, backend: str | None, drivers: tuple[DriverSpec, ...]
) -> BlockingValves | None:
    """Return the blocking valves of a rig file; None if it has none, or they are unusable.

    Problems are recorded: also for a rig on hardware none of whose `drivers` moves such valves.
    """
    file = read_mapping(BlockingFile, item)
    if item is None or file is None:
        return None
    moved = {output for spec in drivers for output in spec.outputs}
    # Without drivers, these have a problem of their own.
    if backend == "hardware" and drivers and not moved.issuperset(BLOCKING):
        remedy = "write `blocking: true` under the driver bypass_valves, or remove them"
        item.refuse("are moved by none of the rig's drivers", remedy, "")
        return None
    return BlockingValves(file.travel, file.leak, file.leak_pressure)
