from . import orders as orders
from .ahead import (
    LEAST_AHEAD_TICKS as LEAST_AHEAD_TICKS,
    SetAhead as SetAhead,
    set_ahead as set_ahead,
)
from .cycle import wire_ticks as wire_ticks
from .layout import (
    NULL_V as NULL_V,
    RAMP_S as RAMP_S,
    Count as Count,
    Course as Course,
    Drive as Drive,
    Found as Found,
    Integers as Integers,
    Left as Left,
    Pace as Pace,
    pace as pace,
    wire_channels as wire_channels,
    wire_memory as wire_memory,
)
from .loop import WireLoop as WireLoop, post_decision as post_decision
from .orders import (
    ChangeControl as ChangeControl,
    Close as Close,
    Closed as Closed,
    Open as Open,
    Opened as Opened,
    Segment as Segment,
    changed_course as changed_course,
    control_in as control_in,
    course as course,
    prepared as prepared,
)
