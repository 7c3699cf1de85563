from .board import RING_ROWS as RING_ROWS, Board as Board, RingReader as RingReader, Word as Word
from .clock import wakeup_lateness as wakeup_lateness
from .cycle import guard as guard, judge as judge, sample_row as sample_row
from .decided import (
    PRESENT as PRESENT,
    PROBABILITIES as PROBABILITIES,
    PROBABLE as PROBABLE,
    VERDICT_CODES as VERDICT_CODES,
    confirmed_fault as confirmed_fault,
    no_decision as no_decision,
)
from .homing import (
    Homing as Homing,
    HomingError as HomingError,
    HomingSample as HomingSample,
    Phase as Phase,
)
from .interlocks import (
    FULL as FULL,
    LIMITED as LIMITED,
    NO_CHANNEL as NO_CHANNEL,
    Action as Action,
    Cause as Cause,
    Interlock as Interlock,
    LoopStoppedError as LoopStoppedError,
    PassingLog as PassingLog,
    PassingReader as PassingReader,
    RungPassed as RungPassed,
    StopRequestedError as StopRequestedError,
    Tolerances as Tolerances,
    TripError as TripError,
    channel_name as channel_name,
    explain as explain,
    interlock as interlock,
    latest_passings as latest_passings,
    limit_table as limit_table,
    passed_on as passed_on,
    rungs_of as rungs_of,
    rungs_with_bands as rungs_with_bands,
    tolerances as tolerances,
    with_limits as with_limits,
)
from .lane_control import LaneGuide as LaneGuide, lane_guide as lane_guide
from .lane_ticks import (
    COMMAND as COMMAND,
    LANE_READINGS as LANE_READINGS,
    LOGGED as LOGGED,
    LOGGED_OF_CHAMBERS as LOGGED_OF_CHAMBERS,
    MOST_STEPS as MOST_STEPS,
    NOISE_COUNT as NOISE_COUNT,
    POSITION as POSITION,
    PRESSURE_1 as PRESSURE_1,
    PRESSURE_2 as PRESSURE_2,
    RETURN as RETURN,
    LaneRigs as LaneRigs,
    LoopSetting as LoopSetting,
    plant_ticks as plant_ticks,
    reading_ticks as reading_ticks,
)
from .reaction import (
    ACTED as ACTED,
    Reaction as Reaction,
    react as react,
    reaction_memory as reaction_memory,
    tolerating as tolerating,
)
from .realtime import Grant as Grant, RealTime as RealTime
from .simulated_loop import (
    Motion as Motion,
    SimulatedLoop as SimulatedLoop,
    batch_ticks as batch_ticks,
    estimates_in as estimates_in,
)
from .timing import (
    TIMING as TIMING,
    StageTimes as StageTimes,
    Timing as Timing,
    in_short as in_short,
)
from .wire import (
    LEAST_AHEAD_TICKS as LEAST_AHEAD_TICKS,
    NULL_V as NULL_V,
    ChangeControl as ChangeControl,
    Close as Close,
    Closed as Closed,
    Count as Count,
    Course as Course,
    Drive as Drive,
    Found as Found,
    Integers as Integers,
    Left as Left,
    Open as Open,
    Opened as Opened,
    Pace as Pace,
    Segment as Segment,
    SetAhead as SetAhead,
    WireLoop as WireLoop,
    changed_course as changed_course,
    control_in as control_in,
    course as course,
    orders as orders,
    pace as pace,
    post_decision as post_decision,
    prepared as prepared,
    set_ahead as set_ahead,
    wire_channels as wire_channels,
    wire_memory as wire_memory,
    wire_ticks as wire_ticks,
)
