"""What chaos can do inside a Python process, by signals; loaded by each process of a scenario.

SIGUSR1 steps the wall clock by an hour, as the process sees it: stepping the machine's own needs
privilege and would disturb whatever else runs there. SIGUSR2 hangs the main thread, and it alone.
"""

import signal
import time

STEP_S = 3600


def _step_clock(number: int, frame: object) -> None:
    true_time, true_time_ns = time.time, time.time_ns
    time.time = lambda: true_time() + STEP_S
    time.time_ns = lambda: true_time_ns() + STEP_S * 1_000_000_000


def _hang(number: int, frame: object) -> None:
    while True:
        time.sleep(1.0)


signal.signal(signal.SIGUSR1, _step_clock)
signal.signal(signal.SIGUSR2, _hang)
