"""Lets signals disturb a Python process from inside; every process of a scenario loads this module.

SIGUSR1 steps the wall clock, as this process reads it, by an hour; to step the machine's own clock
would need privilege and would disturb all that runs there. SIGUSR2 hangs the main thread; the other
threads go on.

Where `RIG_CHAOS_PLAIN_REPORT` is set, `rig run` writes a page without plots as its report.
"""

import os
import signal
import sys
import time
from pathlib import Path
from types import ModuleType

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


def _write_plain(outcome: object, directory: Path, kept: object = None) -> Path:
    page = directory / "report.html"
    page.write_text("<p>This run wrote no plots, because the chaos suite asked for none.</p>\n")
    return page


if os.environ.get("RIG_CHAOS_PLAIN_REPORT"):
    # Plots take twice the processor time of all the rest of a short run.
    plain = ModuleType("rig.report")
    vars(plain)["write_report"] = _write_plain
    sys.modules[plain.__name__] = plain
