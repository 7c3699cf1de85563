from .position_loop import (
    COMMAND_LIMIT as COMMAND_LIMIT,
    POSITION_GAIN as POSITION_GAIN,
    proportional_command as proportional_command,
    raised_cosine as raised_cosine,
)
from .request import (
    Checks as Checks,
    RequestError as RequestError,
    RequestProblem as RequestProblem,
)
from .setpoints import (
    Chirp as Chirp,
    Constant as Constant,
    FromFile as FromFile,
    Multisine as Multisine,
    Polyline as Polyline,
    Pseudorandom as Pseudorandom,
    Quantity as Quantity,
    Sequence as Sequence,
    Setpoint as Setpoint,
    SetpointError as SetpointError,
    SetpointFileError as SetpointFileError,
    Sine as Sine,
    Steps as Steps,
    Stretch as Stretch,
    Trapezoid as Trapezoid,
    Triangle as Triangle,
    period_of as period_of,
)
from .tolerant import TOLERANT_STATE as TOLERANT_STATE, tolerant_command as tolerant_command
