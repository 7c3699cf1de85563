from .additions import add as add
from .hooks import run_hook as run_hook
from .scheduler import (
    JOURNAL as JOURNAL,
    Job as Job,
    Scheduler as Scheduler,
    ScheduleState as ScheduleState,
    state_of as state_of,
    waiting as waiting,
)
