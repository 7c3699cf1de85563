"""Runs the command `rig gap` on a case, and reads what it answers."""

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, Final

from tools.peers.cases import Case

LONGEST_S: Final = 1800.0
"""Time after which the command is given up, s."""


@dataclass(frozen=True)
class Answered:
    """What the command answered.

    Attributes:
        answer: the object that `rig gap --json` prints; empty if the command failed.
        channels: `channels` of gap.json; empty if it has none.
        seconds: how long the command took by the wall clock, s.
        why: why there is no answer; "" if there is one.
    """

    answer: Mapping[str, Any]
    channels: tuple[Mapping[str, Any], ...]
    seconds: float
    why: str = ""


def rig_gap(case: Case, out: Path, discovered: bool) -> Answered:
    """Run the command on a case, its files going to the folder `out`.

    Args:
        case: the case.
        out: the folder; it is made if missing.
        discovered: whether the model written may have what no effect of the catalogue explains.
    """
    command = [
        sys.executable, "-m", "rig.cli", "gap", *map(str, case.fit),
        "--holdout", *map(str, case.holdout), "--model", case.model, "--out", str(out), "--json",
        *(["--plant", case.plant] if case.plant else []),
        *([] if discovered else ["--no-discovered"]),
    ]  # fmt: skip
    begun = monotonic()
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return Answered({}, (), LONGEST_S, f"rig gap took longer than {LONGEST_S:g} s")
    took = monotonic() - begun
    if ended.returncode != 0:
        said = (ended.stderr.strip().splitlines() or ["nothing"])[-1]
        return Answered({}, (), took, f"rig gap left with status {ended.returncode}: {said}")
    answer = json.loads(ended.stdout.strip().splitlines()[-1])
    figures = json.loads((out / "gap.json").read_text(encoding="utf-8"))
    return Answered(answer, tuple(figures.get("channels") or ()), took)
