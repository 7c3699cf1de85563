"""How valve, encoder and pressure lines of a rig are connected: as its device says, or turned over.

Three mistakes of an installation turn a sign over: the wires of the valve's coil or of the encoder
are exchanged, or the pressure lines of the two chambers are. A rig file that tells of them
(section `wiring`) has them undone in software, where the signals leave and enter the loop.
"""

from dataclasses import dataclass
from typing import Literal

Turn = Literal["normal", "inverted"]
Lines = Literal["normal", "swapped"]


@dataclass(frozen=True)
class Wiring:
    """How a rig is wired, against the names of the signals in its device's register map.

    Attributes:
        valve: `inverted` if a positive voltage at the valve moves the ram in; the command leaves
            the loop with the other sign then.
        encoder: `inverted` if the encoder counts down while the ram extends; only for a rig with
            the section `homing`, which finds the zero.
        spool: `inverted` if the spool's transducer `spool_m` reads less while the spool goes the
            way that moves the ram out.
        pressures: `swapped` if `pressure_1_Pa` is that of chamber 2, and `pressure_2_Pa` that of
            chamber 1; calibrations belong to the transducers, under the names of the register map.
    """

    valve: Turn = "normal"
    encoder: Turn = "normal"
    spool: Turn = "normal"
    pressures: Lines = "normal"

    def turned(self, by: "Wiring") -> "Wiring":
        """Return the wiring of a rig that, with this wiring undone, still shows the wiring `by`."""
        return Wiring(
            _twice(self.valve, by.valve),
            _twice(self.encoder, by.encoder),
            _twice(self.spool, by.spool),
            "swapped" if (self.pressures == "swapped") != (by.pressures == "swapped") else "normal",
        )


def _twice(first: Turn, second: Turn) -> Turn:
    return "normal" if first == second else "inverted"
