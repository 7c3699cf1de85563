"""Asks the kernel, one by one, for everything that helps the loop to keep its time.

The loop also runs without any of these, but is late at times. `rig doctor` and every recording
report what the kernel refused, with its remedy.
"""

import ctypes
import gc
import os
import struct
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

_MCL_CURRENT: Final = 1  # sys/mman.h
_MCL_FUTURE: Final = 2
_PR_SET_TIMERSLACK: Final = 29  # linux/prctl.h
_TIMER_SLACK_NS: Final = 1000
"""Timer slack that is asked for; the kernel's own 50 us delay threads without SCHED_FIFO."""
_LATENCY_FILE: Final = "/dev/cpu_dma_latency"

# With the reset, threads and processes that this one starts do not inherit the priority.
_FIFO: Final = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK

_libc: Final = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Grant:
    """One request to the kernel, and the kernel's answer.

    Attributes:
        name: name of what was asked for.
        granted: whether the kernel granted it.
        why: the benefit of it if it was granted, else the reason for the refusal.
        remedy: how to get it; empty if it was granted.
    """

    name: str
    granted: bool
    why: str
    remedy: str = ""


class RealTime(ExitStack):
    """A context manager that asks the kernel to let the calling thread keep its time.

    The requests, for the thread and its process, are made when the object is made. A refused one
    raises no error. The end of the block, or `close`, undoes what was granted, except the timer
    slack; repeated calls do no harm.

    Args:
        cpu: processor to which the thread is pinned; None leaves it to the kernel.
        priority: SCHED_FIFO priority for this thread only; 0 asks for none.

    Attributes:
        grants: the requests, with the kernel's answers.
    """

    def __init__(self, cpu: int | None, priority: int) -> None:
        super().__init__()
        affinity = os.sched_getaffinity(0)
        self.callback(os.sched_setaffinity, 0, affinity)
        self.callback(_leave_fifo)
        self.grants: tuple[Grant, ...] = ()
        if cpu is not None:
            self._ask(
                f"processor {cpu}",
                lambda: os.sched_setaffinity(0, {cpu}),
                "the loop does not move to a cold cache",
                f"name one of {', '.join(map(str, sorted(affinity)))} as loop: cpu",
            )
        if priority:
            self._ask(
                f"SCHED_FIFO {priority}",
                lambda: os.sched_setscheduler(0, _FIFO, os.sched_param(priority)),
                "no other program delays the loop",
                "ulimit -r 99, LimitRTPRIO=99 in the service, or CAP_SYS_NICE",
            )
        self._ask(
            "timer slack 1 us",
            lambda: _checked(_libc.prctl(_PR_SET_TIMERSLACK, _TIMER_SLACK_NS, 0, 0, 0)),
            "a thread without SCHED_FIFO wakes 50 us earlier",
            "a seccomp filter forbids prctl: allow it",
        )
        self._ask(
            "locked memory",
            lambda: _checked(_libc.mlockall(_MCL_CURRENT | _MCL_FUTURE)),
            "no page of the loop must be fetched from disk",
            "ulimit -l unlimited, LimitMEMLOCK=infinity in the service, or CAP_IPC_LOCK",
        )
        self._ask(
            "processor awake",
            self._hold_latency,
            "the processor does not sleep deeply between ticks",
            f"allow this user to write {_LATENCY_FILE}, by a udev rule",
        )
        # Objects that exist now are never garbage, so that the collector may ignore them.
        gc.collect()
        gc.freeze()
        self.callback(_libc.munlockall)
        self.callback(gc.unfreeze)

    def _ask(self, name: str, request: Callable[[], object], why: str, remedy: str) -> None:
        """Make a request, and note the kernel's answer as a `Grant`."""
        granted = Grant(name, True, why)
        try:
            request()
        except OSError as error:
            granted = Grant(name, False, error.strerror or str(error), remedy)
        self.grants += (granted,)

    def _hold_latency(self) -> None:
        # This is in force as long as the file is open (Documentation/power/pm_qos_interface.rst).
        fd = os.open(_LATENCY_FILE, os.O_WRONLY | os.O_CLOEXEC)
        self.callback(os.close, fd)
        os.write(fd, struct.pack("i", 0))


def _leave_fifo() -> None:
    if os.sched_getscheduler(0) == _FIFO:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _checked(result: int) -> None:
    if result != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
