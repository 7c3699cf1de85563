from .asking import leased as leased, why_busy as why_busy, word_of_station as word_of_station
from .keeper import Keeper as Keeper, Lease as Lease
