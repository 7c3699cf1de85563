from .asking import (
    leased as leased,
    tell_station as tell_station,
    why_busy as why_busy,
    word_of_station as word_of_station,
)
from .keeper import Keeper as Keeper, Lease as Lease
from .protocol import LONGEST_WORD as LONGEST_WORD
