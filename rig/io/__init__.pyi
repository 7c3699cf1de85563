from .bypass_valves import (
    IDENTITY as IDENTITY,
    NEEDLE_FULL_SCALE as NEEDLE_FULL_SCALE,
    STANDARD_REGISTERS as STANDARD_REGISTERS,
    THROTTLE as THROTTLE,
    BypassRegisters as BypassRegisters,
)
from .can import (
    COMMAND as COMMAND,
    STATUS as STATUS,
    UNITS as UNITS,
    CanOptions as CanOptions,
    DriveState as DriveState,
    FrameReader as FrameReader,
    H as H,
    canopen as canopen,
    cantools as cantools,
    ds408 as ds408,
    open_bus as open_bus,
    python_can as python_can,
)
from .correction import (
    Corrections as Corrections,
    correct as correct,
    corrections_of as corrections_of,
)
from .device_lock import (
    LockedError as LockedError,
    connection_of as connection_of,
    exclusive as exclusive,
    in_use as in_use,
    locked as locked,
)
from .driver import (
    Driver as Driver,
    DriverError as DriverError,
    ExchangeStatus as ExchangeStatus,
    FastDriver as FastDriver,
)
from .flow_meters import meter_line as meter_line
from .libc import bind as bind, monotonic_ns as monotonic_ns, scratch as scratch
from .limits import ALWAYS as ALWAYS, ChannelLimit as ChannelLimit, Response as Response
from .loop_exchange import exchange as exchange
from .modbus_daq import (
    WORDS as WORDS,
    Fact as Fact,
    Register as Register,
    RegisterMap as RegisterMap,
    RegisterMapError as RegisterMapError,
    RegisterType as RegisterType,
    RegisterValue as RegisterValue,
    Watchdog as Watchdog,
)
from .registry import (
    DriverSpec as DriverSpec,
    driver_class as driver_class,
    driver_types as driver_types,
)
from .settings import HomingSettings as HomingSettings, LoopSettings as LoopSettings
from .signals import (
    BALLS as BALLS,
    FAST_INPUTS as FAST_INPUTS,
    FAST_OUTPUTS as FAST_OUTPUTS,
    METERS as METERS,
    NEEDLES as NEEDLES,
    SLOW_INPUTS as SLOW_INPUTS,
)
from .simulated import SimulatedRig as SimulatedRig, simulated_rig as simulated_rig
from .transducer_calibration import (
    RENEW as RENEW,
    CalibrationPoint as CalibrationPoint,
    TransducerCalibration as TransducerCalibration,
    calibration_doubts as calibration_doubts,
    today as today,
)
from .wiring import Wiring as Wiring
