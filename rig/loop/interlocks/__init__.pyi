from .check_tolerances import (
    Tolerances as Tolerances,
    locked_tolerances as locked_tolerances,
    tolerances as tolerances,
)
from .judging import (
    Interlock as Interlock,
    Tick as Tick,
    allowed_command as allowed_command,
    check_sample as check_sample,
    held_position as held_position,
    interlock as interlock,
    judged_sample as judged_sample,
    passed_on as passed_on,
    with_limits as with_limits,
)
from .ladder import (
    LIMITED as LIMITED,
    NO_CHANNEL as NO_CHANNEL,
    Action as Action,
    Cause as Cause,
    LimitTable as LimitTable,
    channel_name as channel_name,
    explain as explain,
    limit_table as limit_table,
    rungs_of as rungs_of,
    rungs_with_bands as rungs_with_bands,
)
from .passing_log import (
    PASSING_NUMBERS as PASSING_NUMBERS,
    PASSINGS_KEPT as PASSINGS_KEPT,
    PassingLog as PassingLog,
)
from .passings import (
    PassingReader as PassingReader,
    RungPassed as RungPassed,
    latest_passings as latest_passings,
)
from .trip import (
    FULL as FULL,
    LoopStoppedError as LoopStoppedError,
    StopRequestedError as StopRequestedError,
    TripError as TripError,
)
