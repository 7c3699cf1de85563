"""The gap workflow, blind, on a few short trials; hundreds longer ones are `make trials`.

What the workflow must find before it says that a rig hides nothing, or what it hides, is tested in
tests/estimator/gap. An effect off the menu takes the search 50 s of processor time, and is tried by
`make trials` only.
"""

from pathlib import Path

import pytest

from tools.hidden_effects.trials import Plan, trial
from tools.hidden_effects.workflow import in_process


@pytest.mark.parametrize(
    "kind",
    [*(pytest.param(kind, marks=pytest.mark.long) for kind in ("none", "single")), "unexcited"],
)
def test_a_short_blind_trial_comes_out_right(kind: str, tmp_path: Path) -> None:
    found = trial(Plan(kind, 1, 0, 4.0), tmp_path, False, in_process)
    assert found.score.outcome == "right", (found.envelope, found.answer)
