from .compiled_exchange import ExchangeStatus as ExchangeStatus, exchange as exchange
from .driver import ModbusDaq as ModbusDaq
from .plan import Tally as Tally
from .register_map import (
    WORDS as WORDS,
    Register as Register,
    RegisterMap as RegisterMap,
    RegisterMapError as RegisterMapError,
    RegisterType as RegisterType,
    RegisterValue as RegisterValue,
)
