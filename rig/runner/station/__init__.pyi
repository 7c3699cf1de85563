from .resident import (
    NOTHING_MOVES as NOTHING_MOVES,
    WATCH as WATCH,
    Obey as Obey,
    Resident as Resident,
)
from .station_log import LOG as LOG, StationLog as StationLog, keep_newest as keep_newest
