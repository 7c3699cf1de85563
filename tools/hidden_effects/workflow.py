"""Two ways in which trials run the gap workflow: as the command `rig gap`, or in this process."""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

Result = Mapping[str, Any]
Workflow = Callable[[Sequence[Path], Path, Path], Result]
"""A function that runs the workflow and returns the object that `rig gap --json` prints.

Its arguments are the recordings to identify with, the held-out recording, and a folder for the
files that the workflow writes.
"""

LONGEST_S: Final = 900.0
"""s: a workflow that takes longer is ended and has failed."""

_REFUSED: Final = 2


class WorkflowFailedError(Exception):
    """The workflow ended without a result; the message says how.

    Attributes:
        refused: whether the workflow rejected the recordings and gave a reason.
    """

    def __init__(self, message: str, refused: bool = False) -> None:
        super().__init__(message)
        self.refused = refused


def rig_gap(identify: Sequence[Path], holdout: Path, out: Path) -> Result:
    """Run the command `rig gap` with the nominal model; return the JSON object that it printed.

    Raises:
        WorkflowFailedError: the command ended with a status other than 0 (`refused` is True for
            status 2), its last line is no JSON object, or it took longer than `LONGEST_S`.
    """
    command = [
        sys.executable, "-m", "rig.cli", "gap", *map(str, identify), "--holdout", str(holdout),
        "--model", "nominal", "--out", str(out), "--json",
    ]  # fmt: skip
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise WorkflowFailedError(f"rig gap took longer than {LONGEST_S:g} s") from None
    lines = ended.stdout.strip().splitlines()
    if ended.returncode != 0:
        said = (ended.stderr.strip().splitlines() or lines or ["nothing"])[-1]
        raise WorkflowFailedError(
            f"rig gap left with status {ended.returncode}: {said}", ended.returncode == _REFUSED
        )
    try:
        found = json.loads(lines[-1])
    except (IndexError, json.JSONDecodeError):
        raise WorkflowFailedError("the last line that rig gap printed is no JSON") from None
    if not isinstance(found, dict):
        raise WorkflowFailedError("the last line that rig gap printed is no JSON object")
    return found


def in_process(identify: Sequence[Path], holdout: Path, out: Path) -> Result:
    """Run the workflow of `rig gap` in this process and return what `rig gap --json` would print.

    No report and no files are written; `out` is not used.

    Raises:
        WorkflowFailedError: the workflow raised an error, or a recording cannot be read; `refused`
            is True only in the second case.
    """
    from estimator.gap.servo.actuator import servo_actuator
    from estimator.gap.verdict.workflow import find_gap
    from rig.plant import Model
    from rig.recording import RecordingError, read_recording
    from rig.runner.experiments import answer

    try:
        recordings = [read_recording(path) for path in (*identify, holdout)]
    except RecordingError as error:
        raise WorkflowFailedError(str(error), refused=True) from error
    try:
        found = find_gap(recordings[:-1], recordings[-1:], servo_actuator(Model()))
    except Exception as error:  # any error fails this trial only; the next trial goes on
        raise WorkflowFailedError(f"{type(error).__name__}: {error}") from error
    return answer(found)
