"""The faults a rig can inject (figure 2.3) as the plant sees them: coefficients for each tick."""

from typing import Final, NamedTuple


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
