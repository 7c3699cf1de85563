"""The table `CHANNELS` lists every channel: what supplies or computes it, and how it is shown.

The names in shared memory, in the driver protocol, in recordings and in the stream are derived from
this table, and so are the numbers that the console's page and `rig monitor` show.
docs/io_node.md describes how to add a channel.
"""

from enum import Enum, auto
from typing import Final, NamedTuple


class Kind(Enum):
    """A kind says how the value of a channel gets into the software."""

    READING = auto()
    """The fast driver samples this transducer in every tick. `rig.plant.Reading` has this order."""
    STATUS = auto()
    """The fast device reports this of itself in every tick: switches, counters, valve output."""
    CARRIED = auto()
    """This transducer changes slowly and is read together with the fast driver's readings. Limits
    act upon it as upon a reading, but no filter uses it, and a device may lack it."""
    SLOW = auto()
    """A slow driver reads this value, at a rate of its own, if its device supplies it."""
    COMPUTED = auto()
    """The loop computes this column. It is listed here only to say how it is shown."""


class Source(Enum):
    """The device that usually supplies a channel."""

    FAST = "fast I/O device"
    METERS = "flow meters"
    BYPASS = "bypass valves"
    DRIVE = "valve drive"
    PUMP = "pump unit"
    LOOP = "loop"


class Unit(NamedTuple):
    """A unit in which the screen shows values, with its conversion from SI."""

    text: str
    factor: float = 1.0
    """Factor from the SI unit to this unit, applied after `zero` is subtracted."""
    zero: float = 0.0
    """The SI value that is shown as 0."""

    def shown(self, value: float) -> float:
        """Return an SI value converted to this unit."""
        return (value - self.zero) * self.factor


MM: Final = Unit("mm", 1e3)
MPA: Final = Unit("MPa", 1e-6)
KPA: Final = Unit("kPa", 1e-3)
KN: Final = Unit("kN", 1e-3)
VOLT: Final = Unit("V")
LITRES_PER_MINUTE: Final = Unit("L/min", 6e4)
CELSIUS: Final = Unit("°C", zero=273.15)


class Shown(NamedTuple):
    """The title, unit and digits with which people see a channel."""

    title: str
    unit: Unit
    digits: int
    """Number of digits after the decimal point on the console's page."""
    on_monitor: bool = False
    """Whether `rig monitor` shows the channel too."""


class Channel(NamedTuple):
    """One channel with its kind, its source, its display and the range of its transducer."""

    name: str
    """The name ends in the SI unit (see `rig.recording.unit_of`) if the channel has a unit."""
    kind: Kind
    source: Source = Source.FAST
    shown: Shown | None = None
    """How the channel is shown; None if it has no line of its own on the screen."""
    ends: tuple[float, float] | None = None
    """Lower and upper end of the transducer's range, SI. A broken wire or a short circuit reads as
    one of them. None if there are no such ends, or if the rig's sensors give them
    (`rig.plant.SensorParameters`)."""


BYPASSES: Final = (
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
)
"""The valves that make faults, each named after the fault that it makes.

The last one is a throttle without a ball valve.
"""

BLOCKING: Final = ("blocking_1", "blocking_2")
"""The blocking valves in the lines of chambers 1 and 2; each is named as its channel.

Both are shut at 1, which locks the cylinder, and open at 0, without current.
"""

CHANNELS: Final = (
    Channel("position_m", Kind.READING, shown=Shown("position", MM, 2, True)),
    Channel("setpoint_m", Kind.COMPUTED, Source.LOOP, Shown("setpoint", MM, 2, True)),
    Channel("command_V", Kind.COMPUTED, Source.LOOP, Shown("command", VOLT, 3, True)),
    Channel("pressure_1_Pa", Kind.READING, shown=Shown("pressure 1", MPA, 3, True)),
    Channel(
        "est_pressure_1_Pa", Kind.COMPUTED, Source.LOOP, Shown("pressure 1, estimated", MPA, 3)
    ),
    Channel("pressure_2_Pa", Kind.READING, shown=Shown("pressure 2", MPA, 3, True)),
    Channel(
        "est_pressure_2_Pa", Kind.COMPUTED, Source.LOOP, Shown("pressure 2, estimated", MPA, 3)
    ),
    Channel("spool_m", Kind.READING, shown=Shown("spool", MM, 4)),
    Channel("supply_pressure_Pa", Kind.READING, shown=Shown("supply", MPA, 3, True)),
    Channel("load_N", Kind.READING, shown=Shown("load", KN, 3)),
    Channel("compensation_V", Kind.COMPUTED, Source.LOOP, Shown("compensation", VOLT, 3)),
    # The fast device may measure these flows where the rig has no separate flow meters.
    Channel("flow_1_m3_per_s", Kind.READING, Source.METERS),
    Channel("flow_2_m3_per_s", Kind.READING, Source.METERS),
    Channel("flow_internal_m3_per_s", Kind.READING, Source.METERS),
    Channel("estop_closed", Kind.STATUS),
    Channel("reset_button", Kind.STATUS),
    Channel("valve_enabled", Kind.STATUS),
    Channel("watchdog_tripped", Kind.STATUS),
    Channel("encoder_fault", Kind.STATUS),
    Channel("device_counter", Kind.STATUS),
    Channel("device_echo", Kind.STATUS),
    Channel("device_command_V", Kind.STATUS),
    Channel(
        "tank_temperature_K",
        Kind.CARRIED,
        shown=Shown("tank", CELSIUS, 1, True),
        ends=(223.15, 423.15),
    ),
    *(Channel(f"{bypass}_ball", Kind.SLOW, Source.BYPASS) for bypass in BYPASSES),
    *(Channel(f"{bypass}_needle", Kind.SLOW, Source.BYPASS) for bypass in BYPASSES),
    Channel("drive_state", Kind.SLOW, Source.DRIVE),
    Channel("drive_spool_m", Kind.SLOW, Source.DRIVE),
    Channel("drive_setpoint", Kind.SLOW, Source.DRIVE),
    Channel("pump_pressure_Pa", Kind.SLOW, Source.PUMP),
    Channel("oil_temperature_K", Kind.SLOW, Source.PUMP, Shown("oil", CELSIUS, 1)),
    Channel("pump_loaded", Kind.SLOW, Source.PUMP),
    *(Channel(valve, Kind.SLOW, Source.BYPASS) for valve in BLOCKING),
)
"""All channels.

Within a kind, their order is that of shared memory and of a recording's columns, so that a new
channel has to come last of its kind. The screen shows channels in the order of this table.
"""


def names_of(*kinds: Kind) -> tuple[str, ...]:
    """Return the names of the channels of the given kinds, one kind after the other.

    Within a kind they are in the order of `CHANNELS`.
    """
    return tuple(channel.name for kind in kinds for channel in CHANNELS if channel.kind is kind)


def names_from(source: Source) -> tuple[str, ...]:
    """Return the names of the channels that a device usually supplies, in `CHANNELS`' order."""
    return tuple(channel.name for channel in CHANNELS if channel.source is source)


READINGS: Final = names_of(Kind.READING)
"""Names of all readings, which any filter may use, in the order of `rig.plant.Reading`."""

ENDS: Final = {channel.name: channel.ends for channel in CHANNELS if channel.ends is not None}
"""Channel -> lower and upper end of its range in SI, for transducers that have `Channel.ends`."""

SHOWN: Final = tuple(
    (channel.name, channel.shown) for channel in CHANNELS if channel.shown is not None
)
"""Name and display of every channel that is shown as a number, in the order of the screen."""
