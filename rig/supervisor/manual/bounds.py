"""What a manual motion may do at most, from the rig's limits and the assumed model."""

from dataclasses import dataclass
from typing import Final

from rig.configuration import Rig, show, valve_speed
from rig.plant import Model

MARGIN_M: Final = 0.002
"""Distance in m that setpoints keep from the position limits of the rig.

At the limits themselves noise of the encoder and the overshoot of the position loop would make the
interlock hold the ram.
"""
SPEED_SHARE: Final = 0.5
"""Share of the speed that an unloaded valve gives at the greatest command.

The other half is left for the load and for correcting errors.
"""
FORCE_SHARE: Final = 0.05
"""Share of the force of the whole supply pressure on the piston that may accelerate the mass.

The pressures of the chambers then stay near those of rest.
"""
USUAL_SPEED: Final = 0.02
"""Speed in m/s of a motion for which none is given."""
ACCELERATION: Final = 0.5
"""Acceleration in m/s^2 of jogs and moves: at 20 mm/s the ram stops within 40 ms and 0.4 mm."""
HOLD_SPEED: Final = 0.02
"""Greatest speed in m/s of hold-to-run, so that a lost heartbeat stops the ram within 5 mm.

From the last heartbeat that came, the setpoint goes on for `ALIVE_S` at this speed (2.4 mm), then
comes to rest (0.4 mm). A ram of which the model's speed for a volt is a fifth off trails by a fifth
of the 0.29 s that the position loop of the thesis' rig takes without feedforward (1.1 mm).
"""
ALIVE_S: Final = 0.12
"""Time in s after a heartbeat for which hold-to-run goes on.

A holder beats at least every 100 ms; 20 ms are left for a late one. The setpoint rests 40 ms
later, well within the 250 ms in which the ram must.
"""


class ManualError(ValueError):
    """The refusal of a manual command; the message gives value, limit and remedy."""


@dataclass(frozen=True)
class Bounds:
    """Between which positions, how fast, and with which acceleration a manual setpoint moves.

    Attributes:
        low_m: least position.
        high_m: greatest position.
        speed: greatest speed, m/s.
        acceleration: greatest acceleration, m/s^2.
    """

    low_m: float
    high_m: float
    speed: float
    acceleration: float

    def check_position(self, position_m: float, what: str) -> None:
        """Raise `ManualError` if a position is not allowed; `what` names it."""
        if not self.low_m <= position_m <= self.high_m:
            between = f"{show(self.low_m, 'm')} and {show(self.high_m, 'm')}"
            raise ManualError(
                f"{what}: {show(position_m, 'm')} is not between {between}, the limits of the rig "
                f"less {show(MARGIN_M, 'm')}; ask for a position between them"
            )

    def check_speed(self, speed: float, what: str, most: float | None = None) -> None:
        """Raise `ManualError` if a speed in m/s is not above 0 and at most `most` or the bound."""
        most = self.speed if most is None else min(most, self.speed)
        if not 0.0 < speed <= most:
            raise ManualError(
                f"{what}: {show(speed, 'm/s')} is not above 0 and at most {show(most, 'm/s')}; "
                "ask for a speed between them"
            )


def bounds_of(rig: Rig, model: Model) -> Bounds:
    """Return the bounds of manual motions of a rig, by its limits and the assumed model."""
    par, limits = model.parameters, rig.limits
    force = (par.supply_pressure - par.return_pressure) * par.piston_area
    return Bounds(
        limits.position_min_m + MARGIN_M,
        limits.position_max_m - MARGIN_M,
        SPEED_SHARE * valve_speed(par, limits.command_V),
        FORCE_SHARE * force / par.moving_mass,
    )
