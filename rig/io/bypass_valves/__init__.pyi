from .driver import BypassValves as BypassValves
from .registers import (
    IDENTITY as IDENTITY,
    NEEDLE_FULL_SCALE as NEEDLE_FULL_SCALE,
    STANDARD_REGISTERS as STANDARD_REGISTERS,
    THROTTLE as THROTTLE,
    BypassRegisters as BypassRegisters,
)
