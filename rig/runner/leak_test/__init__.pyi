from .connected import foreseen as foreseen, run_connected_leak_test as run_connected_leak_test
from .results import LeakTest as LeakTest, leak_test_figures as leak_test_figures
from .sequence import StoppedError as StoppedError, run_leak_test as run_leak_test
from .simulated import SimulatedLockable as SimulatedLockable
