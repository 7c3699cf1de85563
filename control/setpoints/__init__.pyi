from .held import Constant as Constant, Pseudorandom as Pseudorandom, Steps as Steps
from .lines import (
    FromFile as FromFile,
    Polyline as Polyline,
    SetpointFileError as SetpointFileError,
)
from .periodic import Chirp as Chirp, Multisine as Multisine, Sine as Sine
from .protocol import (
    Quantity as Quantity,
    Samples as Samples,
    Setpoint as Setpoint,
    SetpointError as SetpointError,
    Times as Times,
    period_of as period_of,
)
from .sequence import Sequence as Sequence, Stretch as Stretch
from .waves import Trapezoid as Trapezoid, Triangle as Triangle
