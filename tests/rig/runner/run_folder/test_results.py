import json
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import pytest

from estimator.leaks.detection import Decision
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome
from rig.runner.run_folder.results import results, write_results

LEAK = InjectedFault("internal_leakage", 18.0, None, 4e-9, False, 1.0 / 6e4)
FOUND = Decision("internal_leakage", 18.25, 1.2 / 6e4, 0.1 / 6e4, 5e-9, 12.0, 5.8, {"x_m": nan})
PASSED = TestOutcome(
    "leak", "internal_leakage", Status.PASSED, 3, 40.0, (LEAK,), FOUND, 20.5, "leak.mcap"
)
OUTCOME = CampaignOutcome("c", "", "r", "m", "product", 1.0, "2026-01-01T00:00:00+00:00", (PASSED,))


def test_flows_are_in_litres_a_minute_and_say_so() -> None:
    test = results(OUTCOME)["tests"][0]
    assert test["injected"][0]["leak_L_per_min"] == pytest.approx(1.0)
    assert test["found"]["leak_L_per_min"] == pytest.approx(1.2)
    assert test["found"]["leak_std_L_per_min"] == pytest.approx(0.1)
    assert test["found"]["interval_L_per_min"] == pytest.approx([1.004, 1.396])
    assert test["leak_error_L_per_min"] == pytest.approx(0.2)
    assert test["onset_error_s"] == pytest.approx(0.25)
    assert test["found"]["latency_s"] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("kind", "linear", "unit"),
    [
        ("internal_leakage", False, "m^3/(s Pa^0.5)"),
        ("internal_leakage", True, "m^3/(s Pa)"),
        ("return_blockage", False, "Pa/(m^3/s)^2"),
    ],
)
def test_a_coefficient_comes_with_its_unit(kind: str, linear: bool, unit: str) -> None:
    fault = replace(LEAK, kind=kind, linear=linear)
    outcome = replace(OUTCOME, tests=(replace(PASSED, injected=(fault,)),))
    assert results(outcome)["tests"][0]["injected"][0]["coefficient_unit"] == unit


def test_a_test_that_was_not_run_has_found_nothing() -> None:
    test = TestOutcome("leak", "internal_leakage", Status.NOT_RUN, 3, 40.0)
    written = results(replace(OUTCOME, tests=(test,)))
    assert written["tests"][0]["found"] is None
    assert written["exit_code"] == 3
    assert written["counts"] == {"not_run": 1}


def test_what_is_not_finite_is_null_and_the_file_is_strict_json(tmp_path: Path) -> None:
    unsure = replace(PASSED, decision=Decision("inconclusive", threshold=inf, details={"x_m": nan}))
    write_results(replace(OUTCOME, tests=(unsure,)), tmp_path / "results.json")

    def refuse(constant: str) -> None:
        raise ValueError(constant)

    text = (tmp_path / "results.json").read_text()
    found = json.loads(text, parse_constant=refuse)["tests"][0]["found"]
    assert found["threshold"] is None
    assert found["details"] == {"x_m": None}


def test_results_that_cannot_be_written_leave_the_earlier_ones(tmp_path: Path) -> None:
    write_results(OUTCOME, tmp_path / "results.json")
    before = (tmp_path / "results.json").read_text()
    with pytest.raises(TypeError):
        write_results(replace(OUTCOME, provenance={"x": object()}), tmp_path / "results.json")
    assert (tmp_path / "results.json").read_text() == before
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]
