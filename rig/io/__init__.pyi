from .bypass_valves import (
    IDENTITY as IDENTITY,
    NEEDLE_FULL_SCALE as NEEDLE_FULL_SCALE,
    STANDARD_REGISTERS as STANDARD_REGISTERS,
    THROTTLE as THROTTLE,
    BypassRegisters as BypassRegisters,
)
from .can import (
    ACTUAL as ACTUAL,
    COMMAND as COMMAND,
    COMMAND_LAYOUT as COMMAND_LAYOUT,
    CONSUMER_HEARTBEAT as CONSUMER_HEARTBEAT,
    CONTROL_MODE as CONTROL_MODE,
    CONTROL_WORD as CONTROL_WORD,
    DEVICE_MODE as DEVICE_MODE,
    DEVICE_PROFILE as DEVICE_PROFILE,
    DEVICE_TYPE as DEVICE_TYPE,
    EMERGENCY as EMERGENCY,
    FULL_SCALE as FULL_SCALE,
    HEARTBEAT as HEARTBEAT,
    HOLD_SETPOINT as HOLD_SETPOINT,
    MODE_ANALOG as MODE_ANALOG,
    MODE_BUS as MODE_BUS,
    NMT as NMT,
    NO_OBJECT as NO_OBJECT,
    PRODUCER_HEARTBEAT as PRODUCER_HEARTBEAT,
    READ_ONLY as READ_ONLY,
    RPDO1 as RPDO1,
    SDO_REPLY as SDO_REPLY,
    SDO_REQUEST as SDO_REQUEST,
    SETPOINT as SETPOINT,
    SPOOL_CLOSED_LOOP as SPOOL_CLOSED_LOOP,
    STATUS as STATUS,
    STATUS_LAYOUT as STATUS_LAYOUT,
    STATUS_WORD as STATUS_WORD,
    TPDO1 as TPDO1,
    TPDO1_PERIOD as TPDO1_PERIOD,
    UNITS as UNITS,
    WRONG_LENGTH as WRONG_LENGTH,
    CanOptions as CanOptions,
    DriveState as DriveState,
    Entry as Entry,
    H as H,
    NmtCommand as NmtCommand,
    NmtState as NmtState,
    SdoError as SdoError,
    abort_reply as abort_reply,
    after_fault as after_fault,
    after_word as after_word,
    cantools as cantools,
    open_bus as open_bus,
    parse_request as parse_request,
    python_can as python_can,
    read_reply as read_reply,
    set_up as set_up,
    to_share as to_share,
    write_reply as write_reply,
)
from .device_lock import connection_of as connection_of, exclusive as exclusive
from .driver import (
    Driver as Driver,
    DriverError as DriverError,
    ExchangeStatus as ExchangeStatus,
    FastDriver as FastDriver,
)
from .flow_meters import meter_line as meter_line
from .libc import bind as bind, monotonic_ns as monotonic_ns, scratch as scratch
from .limits import ChannelLimit as ChannelLimit, Response as Response
from .loop_exchange import exchange as exchange
from .modbus_daq import (
    WORDS as WORDS,
    Register as Register,
    RegisterMap as RegisterMap,
    RegisterMapError as RegisterMapError,
    RegisterType as RegisterType,
    RegisterValue as RegisterValue,
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
