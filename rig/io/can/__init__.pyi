from .canopen import (
    CONSUMER_HEARTBEAT as CONSUMER_HEARTBEAT,
    DEVICE_TYPE as DEVICE_TYPE,
    EMERGENCY as EMERGENCY,
    HEARTBEAT as HEARTBEAT,
    NMT as NMT,
    NO_OBJECT as NO_OBJECT,
    PRODUCER_HEARTBEAT as PRODUCER_HEARTBEAT,
    READ_ONLY as READ_ONLY,
    RPDO1 as RPDO1,
    SDO_REPLY as SDO_REPLY,
    SDO_REQUEST as SDO_REQUEST,
    TPDO1 as TPDO1,
    WRONG_LENGTH as WRONG_LENGTH,
    Entry as Entry,
    NmtCommand as NmtCommand,
    NmtState as NmtState,
    SdoError as SdoError,
    abort_reply as abort_reply,
    parse_request as parse_request,
    read_reply as read_reply,
    write_reply as write_reply,
)
from .ds408 import (
    ACTUAL as ACTUAL,
    CONTROL_MODE as CONTROL_MODE,
    CONTROL_WORD as CONTROL_WORD,
    DEVICE_MODE as DEVICE_MODE,
    DEVICE_PROFILE as DEVICE_PROFILE,
    FULL_SCALE as FULL_SCALE,
    HOLD_SETPOINT as HOLD_SETPOINT,
    MODE_ANALOG as MODE_ANALOG,
    MODE_BUS as MODE_BUS,
    SETPOINT as SETPOINT,
    SPOOL_CLOSED_LOOP as SPOOL_CLOSED_LOOP,
    STATUS_WORD as STATUS_WORD,
    DriveState as DriveState,
    H as H,
    after_fault as after_fault,
    after_word as after_word,
    to_share as to_share,
)
from .ds408_pdo import (
    COMMAND_LAYOUT as COMMAND_LAYOUT,
    STATUS_LAYOUT as STATUS_LAYOUT,
    TPDO1_PERIOD as TPDO1_PERIOD,
    set_up as set_up,
)
from .libraries import cantools as cantools, python_can as python_can
from .link import CanOptions as CanOptions, open_bus as open_bus
from .pump import COMMAND as COMMAND, STATUS as STATUS, UNITS as UNITS, CanPump as CanPump
from .valve import CanValve as CanValve
