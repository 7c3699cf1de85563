"""What a test awaits: a mistake in it is one problem, and no second one follows from it."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from tests.rig.configuration.campaigns.written import HEAD, SINE, load


@pytest.mark.parametrize(
    ("until", "said"),
    [
        ("{verdict: internal_leakag, at_most: 400 s}", "did you mean internal_leakage?"),
        ("{channel: load_N, low: 3 kN, high: 2 kN, at_most: 400 s}", "is not below high"),
        ("3", "is not a mapping"),
    ],
)
def test_a_wrong_until_is_one_problem_and_no_duration_is_said_to_be_lacking(
    tmp_path: Path, until: str, said: str
) -> None:
    leak = "{type: internal_leakage, at: 300 s, flow: 0.4 L/min, pressure: 6.9 MPa}"
    keys = f"    setpoint: {SINE}\n    until: {until}\n    faults: [{leak}]\n"
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, f"{HEAD}tests:\n  - name: a\n{keys}")
    (problem,) = map(str, caught.value.problems)
    assert said in problem
