from .motion import Counted as Counted, MotionCounter as MotionCounter
from .store import (
    CounterError as CounterError,
    Counters as Counters,
    RigCounter as RigCounter,
    counters_path as counters_path,
    note_maintenance as note_maintenance,
    read_counters as read_counters,
)
