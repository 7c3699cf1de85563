"""Runs a small campaign on the simulated rig, in forks of a process that has everything loaded.

A fork takes a third of the time of a process of its own. What a program does only as it is loaded
is therefore tried in processes of their own (`in_process`).
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NoReturn

from .injection import VARIABLE, Injection, Order
from .judging import Ended

ROOT: Final = Path(__file__).parents[2]
HOOKS: Final = Path(__file__).parent / "hooks"
PATIENCE_S: Final = 120.0
"""s: how long a run may take; untroubled it takes 4 s, and up to a minute beside other programs."""
_POLL_S: Final = 0.02
CAMPAIGN: Final = """\
name: failing
rig: simulated
model: nominal
defaults:
  duration: 12 s
  settle: 0.2 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}
tests:
  - name: one
  - name: two
"""
"""Two tests, so that a run can be resumed between them; 12 s are enough for a verdict."""


def arguments_of(campaign: Path, out: Path, *options: str) -> list[str]:
    """Return the arguments of `rig` that run a campaign on the simulated rig."""
    return ["run", str(campaign), "--pace", "fast", "--out", str(out), *options]


def in_process(arguments: Sequence[str], order: Order | None, printed: Path) -> Ended:
    """Run `rig` in a process of its own, and return how it ended.

    Args:
        arguments: the command line, without the program's name.
        order: what shall be noted and fail; None for nothing.
        printed: file for what it prints.
    """
    environment = dict(os.environ)
    if order is not None:
        paths = os.pathsep.join((str(HOOKS), str(ROOT)))
        environment |= {VARIABLE: order.to_json(), "PYTHONPATH": paths}
    with printed.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", *arguments],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code: int | None = process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            code = None
        alive = _killed(process.pid)
        process.wait()
    return Ended(code, printed.read_text(errors="replace"), alive if code is not None else ())


def in_fork(arguments: Sequence[str], order: Order | None, printed: Path) -> Ended:
    """Run `rig` in a fork of this process, and return how it ended; see `in_process`."""
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        _run(arguments, order, printed)
    code = _waited(pid)
    alive = _killed(pid)
    if code is None:
        os.waitpid(pid, 0)
    return Ended(code, printed.read_text(errors="replace"), alive if code is not None else ())


def _run(arguments: Sequence[str], order: Order | None, printed: Path) -> NoReturn:
    from rig.cli.application import main

    code = 70
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.default_int_handler)
        file = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        for stream in (1, 2):
            os.dup2(file, stream)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", closefd=False)
        if order is not None:
            Injection(order).__enter__()
        try:
            main(arguments)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        sys.stdout.flush()
    finally:
        os._exit(code)


def _waited(pid: int) -> int | None:
    """Return the exit code of a child; None if it has not ended within `PATIENCE_S`."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(_POLL_S)
    return None


def _killed(session: int) -> tuple[str, ...]:
    """Kill the processes of a session, and return the command lines of those that lived."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found.append((folder / "cmdline").read_text().replace("\0", " ").strip())
                os.kill(int(folder.name), signal.SIGKILL)
        except (FileNotFoundError, ProcessLookupError):
            continue
    return tuple(found)


Runner = Callable[[Sequence[str], Order | None, Path], Ended]
"""`in_process` or `in_fork`."""
