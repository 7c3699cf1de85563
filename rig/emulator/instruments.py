"""The transducers' readings for the rig's electronics, with transducers that have failed."""

from collections.abc import Callable
from math import nan
from typing import TYPE_CHECKING, Final, Literal

from rig.channels import ENDS, READINGS, Kind, names_of
from rig.io import Wiring
from rig.plant import Reading, SensorParameters

from .plant import EmulatedPlant

CARRIED: Final = names_of(Kind.CARRIED)
STEADY: Final = {"tank_temperature_K": 313.15}
"""Constant value of each carried transducer, SI, since the emulated plant has no such quantity."""

CHANNELS: Final = (*READINGS, *CARRIED)
"""Signals of the transducers: those of `Reading` in its order, then those that are carried."""

if TYPE_CHECKING:
    Channel = str
else:
    # The keys of a script are checked against this type, which admits these names alone.
    Channel = Literal[CHANNELS]

Failure = Literal["nan", "zero", "low", "high", "drift"]


class Instruments:
    """Reads the plant's transducers, of which some may be frozen or have failed.

    Args:
        plant: the plant.
        wiring: how the transducers are wired to the device that reads them; as its register map
            says if None.
    """

    def __init__(self, plant: EmulatedPlant, wiring: Wiring | None = None) -> None:
        self.plant = plant
        self._wiring = wiring or Wiring()
        self._frozen: dict[int, float] = {}
        # What a failed transducer reads, SI, given the true value.
        self._failed: dict[int, Callable[[float], float]] = {}

    def read(self) -> Reading:
        """Return one sample of the transducers of `Reading`, SI.

        Each stands where it is wired to. A frozen transducer repeats an old reading, and a failed
        one reads as its failure says.
        """
        reading = self._as_wired(self.plant.reading())
        if not self._frozen and not self._failed:
            return reading
        return Reading(*(self._shown(index, value) for index, value in enumerate(reading)))

    def encoder_counts(self) -> int:
        """Return the encoder's count now, as a whole number, with the sign of its wiring."""
        counts = self.plant.encoder_counts()
        return -counts if self._wiring.encoder == "inverted" else counts

    def _as_wired(self, reading: Reading) -> Reading:
        if self._wiring.encoder == "inverted":
            reading = reading._replace(position=-reading.position)
        if self._wiring.spool == "inverted":
            reading = reading._replace(spool=-reading.spool)
        if self._wiring.pressures == "swapped":
            one, other = reading.pressure_1, reading.pressure_2
            reading = reading._replace(pressure_1=other, pressure_2=one)
        return reading

    def read_carried(self) -> dict[str, float]:
        """Return the readings of the transducers `CARRIED`, which change slowly, by channel, SI."""
        return {
            name: self._shown(index, STEADY[name])
            for index, name in enumerate(CARRIED, len(READINGS))
        }

    def _shown(self, index: int, value: float) -> float:
        """Return what the transducer at an index in `CHANNELS` reads in place of `value`, both SI.

        It is `value` unless the transducer is frozen or has failed.
        """
        if index in self._frozen:
            return self._frozen[index]
        return self._failed[index](value) if index in self._failed else value

    def freeze(self, channel: Channel, frozen: bool) -> None:
        """Freeze a channel at its present reading, or, if not `frozen`, let it go on.

        The present reading may be the wrong one of a failed transducer.
        """
        index = CHANNELS.index(channel)
        if frozen:
            self._frozen[index] = (*self.read(), *self.read_carried().values())[index]
        else:
            self._frozen.pop(index, None)

    def fail(self, channel: Channel, reads: Failure, rate_per_s: float = 0.0) -> None:
        """Make the transducer of a channel fail from now on.

        Args:
            channel: name of the channel.
            reads: how it reads: not a number, zero, an end of its range, or drifting away.
            rate_per_s: rate of a drift from the true value, in the channel's SI unit a second.
        """
        index = CHANNELS.index(channel)
        low, high = rails(self.plant.sensors)[index]
        constant = {"nan": nan, "zero": 0.0, "low": low, "high": high}.get(reads)
        since_ns = self.plant.clock()

        def shown(value: float) -> float:
            if constant is not None:
                return constant
            return value + rate_per_s * 1e-9 * (self.plant.time_ns - since_ns)

        self._failed[index] = shown

    def mend(self, channel: Channel) -> None:
        """Make a failed transducer read the true value again; a frozen one stays frozen."""
        self._failed.pop(CHANNELS.index(channel), None)


def rails(sensors: SensorParameters) -> tuple[tuple[float, float], ...]:
    """Return the ends (low, high) of every transducer's range, SI, in the order of `CHANNELS`.

    With a broken wire a transducer reads the low end, with a short circuit the high one. The
    encoder and the flow meters count and have no range; their ends are 0 and an absurd value.
    """
    pressure = (sensors.pressure_min, sensors.pressure_max)
    spool = (-sensors.spool_range, sensors.spool_range)
    counted, flow = (0.0, 10.0), (0.0, 1e-2)
    return (
        counted, pressure, pressure, spool, pressure, (0.0, sensors.load_max), flow, flow, flow,
        *(ENDS[name] for name in CARRIED),
    )  # fmt: skip
