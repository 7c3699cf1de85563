"""The faults a rig can inject (figure 2.3): their names, and as the plant sees them.

Whoever lists leaks or faults does so in the order they have here.
"""

from typing import Final, Literal, NamedTuple, get_args

LeakName = Literal["external_leakage_1", "external_leakage_2", "internal_leakage"]
FaultName = Literal[LeakName, "supply_leakage", "return_blockage"]

LEAKS: Final[tuple[str, ...]] = get_args(LeakName)
"""Leaks of the actuator itself: from chamber 1 and 2 to the return line, and past the piston."""
FAULTS: Final[tuple[str, ...]] = get_args(FaultName)
"""The leaks, that of the supply line to the return line, and a return line that is blocked."""


class FaultInput(NamedTuple):
    """Fault coefficients acting over one tick, added to the model's own (eqs. 5.1 and 5.2).

    Square-root leaks in m^3/(s Pa^0.5), linear ones in m^3/(s Pa), return blockage in
    Pa/(m^3/s)^2 (turbulent restriction).
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
