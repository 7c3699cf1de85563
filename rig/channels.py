"""The one table of channels: whatever is measured, where it comes from, and how it is shown.

The names of shared memory, of the driver protocol, of recordings and of the stream follow from it,
and so does what the console's page and `rig monitor` show. docs/io_node.md tells how to add one.
"""

from enum import Enum, auto
from typing import Final, NamedTuple


class Kind(Enum):
    """How a channel comes to the software."""

    READING = auto()
    """A transducer that the fast driver samples every tick; in the order of `rig.plant.Reading`."""
    STATUS = auto()
    """What the fast device tells of itself every tick: switches, counters, its valve output."""
    CARRIED = auto()
    """A transducer that changes slowly, carried by the fast driver's block. Limits act upon it as
    upon a reading; no filter takes it, and a device may lack it."""
    SLOW = auto()
    """What a slow driver reads, whenever its device has it."""
    COMPUTED = auto()
    """A column that the loop computes; it is listed here for how it is shown only."""


class Source(Enum):
    """The device that usually supplies a channel."""

    FAST = "fast I/O device"
    METERS = "flow meters"
    BYPASS = "bypass valves"
    DRIVE = "valve drive"
    PUMP = "pump unit"
    LOOP = "loop"


class Unit(NamedTuple):
    """A unit of the screen."""

    text: str
    factor: float = 1.0
    """From SI."""
    zero: float = 0.0
    """SI value that is shown as 0."""

    def shown(self, value: float) -> float:
        """Return an SI value in this unit."""
        return (value - self.zero) * self.factor


MM: Final = Unit("mm", 1e3)
MPA: Final = Unit("MPa", 1e-6)
KPA: Final = Unit("kPa", 1e-3)
KN: Final = Unit("kN", 1e-3)
VOLT: Final = Unit("V")
LITRES_PER_MINUTE: Final = Unit("L/min", 6e4)
CELSIUS: Final = Unit("°C", zero=273.15)


class Shown(NamedTuple):
    """How people see a channel."""

    title: str
    unit: Unit
    digits: int
    """Behind the point, on the console's page."""
    on_monitor: bool = False
    """Whether `rig monitor` has it too."""


class Channel(NamedTuple):
    """What is known of one channel."""

    name: str
    """It ends in the SI unit, see `rig.recording.unit_of`; switches and counters have none."""
    kind: Kind
    source: Source = Source.FAST
    shown: Shown | None = None
    """None: it has no line of its own on the screen."""
    ends: tuple[float, float] | None = None
    """Ends of the transducer's range, SI: what a broken wire or a short circuit reads. None: it has
    none, or the rig's sensors tell (`rig.plant.SensorParameters`)."""


BYPASSES: Final = (
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
)
"""The valves that make faults, by the fault each makes; the last one is a throttle without ball."""

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
    # The fast device may measure them in the place of meters of their own.
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
)
"""Every channel. Their order within a kind is that of shared memory and of a recording's columns: a
new one comes last of its kind. The order of those that are shown is that on the screen."""


def names_of(*kinds: Kind) -> tuple[str, ...]:
    """Return the names of the channels of some kinds, kind by kind."""
    return tuple(channel.name for kind in kinds for channel in CHANNELS if channel.kind is kind)


def names_from(source: Source) -> tuple[str, ...]:
    """Return the names of the channels that a device supplies."""
    return tuple(channel.name for channel in CHANNELS if channel.source is source)


READINGS: Final = names_of(Kind.READING)
"""What every filter may take, in the order of `rig.plant.Reading`."""

ENDS: Final = {channel.name: channel.ends for channel in CHANNELS if channel.ends is not None}
"""Ends of the range of the transducers whose ends no data sheet of a rig tells, SI."""

SHOWN: Final = tuple(
    (channel.name, channel.shown) for channel in CHANNELS if channel.shown is not None
)
"""Name and looks of what is shown as a number, in the order of the screen."""
