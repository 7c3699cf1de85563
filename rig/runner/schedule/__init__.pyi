from .additions import add as add
from .hooks import run_hook as run_hook
from .scheduler import Scheduler as Scheduler
from .state import (
    JOURNAL as JOURNAL,
    Job as Job,
    ScheduleState as ScheduleState,
    state_of as state_of,
)
