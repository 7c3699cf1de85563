from .changing import (
    FADE_S as FADE_S,
    ChangeMemory as ChangeMemory,
    Moment as Moment,
    Steered as Steered,
    change_memory as change_memory,
    changeable as changeable,
    forget_changes as forget_changes,
    is_changing as is_changing,
    offset_of_change as offset_of_change,
)
from .expected import expected_position as expected_position, reduced_velocity as reduced_velocity
from .guidance import (
    LoopBasis as LoopBasis,
    guide_along as guide_along,
    guide_of as guide_of,
    law_of as law_of,
    moving_guide as moving_guide,
)
from .loop_model import (
    corrected_of_multisine as corrected_of_multisine,
    corrected_of_sine as corrected_of_sine,
    feedforward_command as feedforward_command,
    frequencies_of as frequencies_of,
    hold_band as hold_band,
    loop_answer as loop_answer,
    valve_lag as valve_lag,
    velocity_gain as velocity_gain,
)
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
from .settings import ControlSettings as ControlSettings
from .stability import (
    LEAST_GAIN_MARGIN_DB as LEAST_GAIN_MARGIN_DB,
    LEAST_PHASE_MARGIN as LEAST_PHASE_MARGIN,
    LoopModel as LoopModel,
    Margins as Margins,
    least_margins as least_margins,
    margins as margins,
)
from .tolerant import TOLERANT_STATE as TOLERANT_STATE, tolerant_command as tolerant_command
from .tracking import (
    PLAIN as PLAIN,
    PROPORTIONAL as PROPORTIONAL,
    TONE_NUMBERS as TONE_NUMBERS,
    ControlLaw as ControlLaw,
    ControlMemory as ControlMemory,
    Guide as Guide,
    begin_motion as begin_motion,
    control_memory as control_memory,
    tracking_command as tracking_command,
)
