from .connected import could_see as could_see, run_connected_leak_test as run_connected_leak_test
from .lockable import Lockable as Lockable
from .results import (
    PLACES as PLACES,
    LeakTest as LeakTest,
    leak_test_figures as leak_test_figures,
    leak_test_lines as leak_test_lines,
)
from .sequence import StoppedError as StoppedError, run_leak_test as run_leak_test
from .simulated import SimulatedLockable as SimulatedLockable
