"""Regimes: how the ram works during a block of the oil account, as far as errors depend on it."""

from typing import Final

from estimator.accounts import INTERNAL_LEAKAGE, AccountBlock
from rig.plant import Parameters

NEAR_STOP: Final = "near_stop"
STANDSTILL: Final = "standstill"
REGIMES: Final = (NEAR_STOP, STANDSTILL, "creep", "loaded", "fast", "moving")
"""Names of the regimes. A block has the first one that fits; `moving` is what is left."""

STOP_REACH: Final = 2e-3
"""Distance from a stroke end, m, within which the ram may touch it: twice the 1 mm within which
`rig commission` finds the stroke of a rig."""
STANDSTILL_TRAVEL: Final = 1e-4
"""Greatest travel of a block at a standstill, m: three counts of the encoder (0.03 mm)."""
CREEP_SPEED: Final = 0.0105
"""Mean speed below which a ram creeps, m/s. It takes 0.4 L/min, the flow of the 4 um of opening
within which edges are not straight lines (`EDGE_REACHES`; 1 um passes 0.1 L/min)."""
LOADED_PART: Final = 1.0 / 3.0
"""Pressure across the piston from which a ram is loaded, as a part of the supply pressure. The
pressure drops of the open edges have then fallen from a half of the supply pressure to a third."""
FAST_SPEED: Final = 0.1
"""Mean speed above which a ram is fast, m/s. It takes 3.8 L/min, or 40 um of opening. In a motion
of 1 Hz, a valve's lag of 2 ms makes an error of 1 % of that, as much as all the edges make."""


def regime_of(block: AccountBlock, parameters: Parameters) -> str:
    """Return the regime of a block, one of `REGIMES`.

    The speed is the travel between the extremes of the block's positions over its duration.

    Args:
        block: a block of the account.
        parameters: the parameters that are assumed; stroke and supply pressure count.
    """
    low, high = block.position_range
    if low <= parameters.stroke_min + STOP_REACH or high >= parameters.stroke_max - STOP_REACH:
        return NEAR_STOP
    travel = high - low
    if travel <= STANDSTILL_TRAVEL:
        return STANDSTILL
    speed = travel / (block.end_s - block.start_s)
    if speed <= CREEP_SPEED:
        return "creep"
    # The size of an internal leak is the mean root of the pressure across the piston.
    if block.sizes[INTERNAL_LEAKAGE] ** 2 >= LOADED_PART * parameters.supply_pressure:
        return "loaded"
    return "fast" if speed >= FAST_SPEED else "moving"
