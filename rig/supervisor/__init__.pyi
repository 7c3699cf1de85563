from .calibration import calibratable as calibratable, calibrate as calibrate
from .connected_rig import LOG as LOG, ConnectedRig as ConnectedRig
from .processes import Onlooker as Onlooker, RowFeed as RowFeed, Stream as Stream
from .session import Session as Session
from .strokes import Strokes as Strokes
from .trip_report import (
    Confirmation as Confirmation,
    Note as Note,
    TripReport as TripReport,
    kept_trip_report as kept_trip_report,
    trip_error as trip_error,
)
