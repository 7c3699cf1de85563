from .csv_table import FromFile as FromFile, SetpointFileError as SetpointFileError
from .held import Constant as Constant, Pseudorandom as Pseudorandom, Steps as Steps
from .periodic import Chirp as Chirp, Multisine as Multisine, Sine as Sine
from .polyline import Polyline as Polyline
from .protocol import (
    Quantity as Quantity,
    Samples as Samples,
    Setpoint as Setpoint,
    SetpointError as SetpointError,
    Times as Times,
)
