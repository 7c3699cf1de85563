"""The faults that a rig can inject (figure 2.3): their names, and their coefficients in the plant.

Leaks and faults have the order of this module everywhere.
"""

from typing import Final, Literal, NamedTuple, get_args

LeakName = Literal["external_leakage_1", "external_leakage_2", "internal_leakage"]
FaultName = Literal[LeakName, "supply_leakage", "return_blockage"]

LEAKS: Final[tuple[str, ...]] = get_args(LeakName)
"""Leaks of the actuator itself: from chambers 1 and 2 to the return line, and past the piston."""
FAULTS: Final[tuple[str, ...]] = get_args(FaultName)
"""All faults: `LEAKS`, a leak of the supply line to the return line, and a blocked return line."""


class FaultInput(NamedTuple):
    """Fault coefficients that act in one tick, in addition to the model's own (eqs. 5.1 and 5.2).

    Square-root leaks are in m^3/(s Pa^0.5), linear ones in m^3/(s Pa), and the return blockage, a
    turbulent restriction, is in Pa/(m^3/s)^2.
    """

    external_leakage_1: float
    external_leakage_2: float
    internal_leakage: float
    external_leakage_1_linear: float
    external_leakage_2_linear: float
    internal_leakage_linear: float
    supply_leakage: float
    return_blockage: float


FAULT_COLUMNS: Final = FaultInput._fields
NO_FAULT: Final = FaultInput(*(0.0 for _ in FAULT_COLUMNS))
