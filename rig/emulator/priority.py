"""Gives the emulator a priority over ordinary programs, if the machine grants that."""

import os
from typing import Final

PRIORITY: Final = 50
"""Priority of SCHED_FIFO: below a 1 kHz loop at its usual 80, so that the emulator never delays
it."""


def raise_priority() -> bool:
    """Run this thread at `PRIORITY`, in real time; return whether the system grants that.

    Threads and processes that it starts run at the ordinary priority (SCHED_RESET_ON_FORK).
    """
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        return False
    return True
