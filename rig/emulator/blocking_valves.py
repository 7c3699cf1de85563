"""The emulated blocking valves' oil: what a valve in a chamber's line passes at each position.

The valves are poppets of a form of their own, which neither the leak test nor the simulated rig
knows, and their leak is half of what the rig's data sheet allows at most.
"""

from typing import Final

from rig.configuration import BlockingValves
from rig.plant import OPEN_CONDUCTANCE, leak_conductance

LEAK_SHARE: Final = 0.5
"""Leak of a shut valve as a part of its data sheet's greatest one."""
_WIDE: Final = 3e-6
"""Conductance in m^3/(s Pa^0.5) of a valve that just leaves its open end: ten times that of the
servovalve at 10 V, so that nothing jumps there."""
_LEAST: Final = 1e-14
"""Least conductance of a shut valve, 2 mm^3/min at 10 MPa, as no valve of the plant may have 0."""


def conductance(shut: float, valves: BlockingValves) -> float:
    """Return what a blocking valve passes, m^3/(s Pa^0.5).

    The free area of a conical seat grows with the square of its lift where the poppet has a skirt.

    Args:
        shut: by which share of its travel the valve is shut, 0 (open) to 1.
        valves: the data sheet.
    """
    if shut <= 0.0:
        return OPEN_CONDUCTANCE
    leak = leak_conductance(LEAK_SHARE * valves.leak, valves.leak_pressure)
    return float(max(leak, _LEAST) + _WIDE * (1.0 - shut) ** 2)
