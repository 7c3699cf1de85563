from .calibration import Strokes as Strokes, calibratable as calibratable, calibrate as calibrate
from .checks import checks_for as checks_for, greatest_null_V as greatest_null_V
from .connected_rig import LOG as LOG, ConnectedRig as ConnectedRig, Stop as Stop
from .guiding import basis_for as basis_for, guide_for as guide_for
from .leases import (
    LONGEST_WORD as LONGEST_WORD,
    Keeper as Keeper,
    Lease as Lease,
    tell_station as tell_station,
    why_busy as why_busy,
    word_of_station as word_of_station,
)
from .locking import MOST_COMMAND_V as MOST_COMMAND_V, LockedRig as LockedRig
from .manual import (
    HELP as HELP,
    Inbox as Inbox,
    Manual as Manual,
    ManualError as ManualError,
    parse as parse,
)
from .processes import (
    Errand as Errand,
    MakeSafe as MakeSafe,
    News as News,
    Onlooker as Onlooker,
    RowFeed as RowFeed,
    Stream as Stream,
    trips_told as trips_told,
)
from .session import Session as Session
from .trip_report import (
    TripReport as TripReport,
    kept_trip_report as kept_trip_report,
    trip_error as trip_error,
)
from .unproven import (
    PROBED as PROBED,
    BrokenOffError as BrokenOffError,
    UnprovenRig as UnprovenRig,
    WatchedRig as WatchedRig,
)
