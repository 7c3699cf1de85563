from .driver import ModbusDaq as ModbusDaq
from .register_map import (
    WORDS as WORDS,
    Fact as Fact,
    Register as Register,
    RegisterMap as RegisterMap,
    RegisterMapError as RegisterMapError,
    RegisterType as RegisterType,
    RegisterValue as RegisterValue,
    Watchdog as Watchdog,
)
