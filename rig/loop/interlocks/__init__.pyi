from .check_tolerances import Tolerances as Tolerances, tolerances as tolerances
from .judging import (
    Interlock as Interlock,
    Tick as Tick,
    allowed_command as allowed_command,
    check_sample as check_sample,
    held_position as held_position,
    interlock as interlock,
    judged_sample as judged_sample,
)
from .ladder import (
    NO_CHANNEL as NO_CHANNEL,
    Action as Action,
    Cause as Cause,
    LimitTable as LimitTable,
    channel_name as channel_name,
    explain as explain,
    limit_table as limit_table,
)
from .trip import (
    FULL as FULL,
    LoopStoppedError as LoopStoppedError,
    StopRequestedError as StopRequestedError,
    TripError as TripError,
)
