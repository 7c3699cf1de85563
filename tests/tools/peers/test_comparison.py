"""Cases are read, answers are judged and tables are made; no method is run here."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools.peers import __main__ as program
from tools.peers.cases import Case, Plan, case_of, listed_plans, shared_plans
from tools.peers.compare import (
    METHODS,
    Compared,
    Outcome,
    errors,
    excess,
    placed,
    quantities,
    right,
)
from tools.peers.correcting import Corrected, Correction
from tools.peers.optional import MissingPeerError, needed
from tools.peers.tables import by_case, summary

ROOT = Path(__file__).parents[3]


def answer(*names: str, verdict: str = "missing_effect", **more: Any) -> Mapping[str, Any]:
    effects = [{"name": name, "indistinguishable_from": []} for name in names]
    return {"verdict": verdict, "effects": effects, **more}


def of(**fields: Any) -> Case:
    return Case((), (), **fields)


def test_a_hidden_effect_must_be_named_and_nothing_beside_it() -> None:
    case = of(names=("internal_leakage",))
    assert right(case, answer("internal_leakage"))
    assert not right(case, answer("internal_leakage", "end_stop"))
    assert not right(case, answer("end_stop"))
    assert right(case, {"verdict": "", "effects": [
        {"name": "end_stop", "indistinguishable_from": ["internal_leakage"]}]})  # fmt: skip


def test_where_nothing_of_the_catalogue_is_hidden_the_verdict_counts() -> None:
    assert right(of(verdict="adequate"), answer(verdict="adequate"))
    assert not right(of(verdict="unknown_effect"), answer("end_stop"))
    assert right(of(), answer()) is None


def test_quantities_are_those_of_what_was_discovered() -> None:
    found = answer(discovered=[{"of": "position x direction"}])
    assert quantities(found) == {"position", "velocity"}
    assert quantities(answer(term={"text": "+ 3 rad/s^2 velocity |velocity|"})) == {"velocity"}
    assert right(of(of=("velocity",)), answer(discovered=[{"of": "velocity"}]))


def test_a_peer_is_right_where_its_largest_correction_is_in_the_right_place() -> None:
    found = Corrected("as given", np.zeros(1), (Correction("force balance", ("velocity",), 1, ""),))
    assert placed(of(equations=("force balance",)), found)
    assert not placed(of(equations=("spool",)), found)
    assert not placed(of(equations=("force balance",), of=("position",)), found)
    assert placed(of(verdict="adequate"), found) is False
    assert placed(of(), found) is None


def test_a_channel_below_the_floor_counts_as_nothing() -> None:
    assert excess(np.array([3.0, 0.5]), np.array([1.0, 1.0])) == 1.0
    assert excess(np.array([np.inf]), np.array([1.0])) is None


def test_errors_are_read_from_what_an_answer_tells_above_its_own_floor() -> None:
    channels: list[dict[str, Any]] = [
        {"before": 8.0, "after": 0.5, "floor": 1.5}, {"before": None, "floor": 1.0}
    ]  # fmt: skip
    assert errors(channels[:1], "after") == [2.0]
    assert excess(errors(channels[:1], "after"), np.array([1.0])) == 1.0
    assert np.isnan(errors(channels, "before")[1])


def test_cases_are_listed_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "axis.py").touch()
    file = tmp_path / "cases.yaml"
    file.write_text(
        "- {name: axis, fit: [a.csv], holdout: [b.csv], plant: 'axis.py:axis', of: [velocity]}\n"
    )
    case = case_of(listed_plans(file)[0], tmp_path)
    assert case.fit == (tmp_path / "a.csv",)
    assert case.plant == f"{tmp_path / 'axis.py'}:axis"
    assert case.of == ("velocity",)
    file.write_text("- {name: axis, fit: [a.csv], hold: [b.csv]}\n")
    with pytest.raises(ValueError, match="hold is not known"):
        listed_plans(file)


def test_shared_cases_that_are_missing_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "case_6").mkdir()
    (plan,) = shared_plans(tmp_path)
    case = case_of(plan, tmp_path)
    assert case.names == ("internal_leakage", "return_back_pressure")
    assert case.equations == ("flow, chamber 1", "flow, chamber 2")


def test_the_tables_tell_what_each_method_leaves() -> None:
    outcomes = {method: Outcome(1.0, 12.0, True, "") for method in METHODS[:3]}
    outcomes[METHODS[3]] = Outcome(None, 3.0, False, "")
    found = [Compared(Plan("shared", "case_1", {}), "spool null bias", 10.0, outcomes)]
    assert "| case 1 | spool null bias | 10 | 1, right, 12 s |" in by_case(found)
    assert "none, wrong, 3 s |" in by_case(found)
    rows = summary(found).splitlines()
    assert "| shared: rig gap | 1 | 90 % | 1 of 1 | 0 of 1 | 0 | 1 of 1 | 12 |" in rows
    assert "| shared: Gaussian process | 1 | 0 % | 0 of 1 | 0 of 1 | 1 | 0 of 1 | 3 |" in rows


def test_a_missing_package_is_told_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(MissingPeerError, match=r"nothing_.* is not .*-e \.\[peers\]"):
        needed("nothing_of_the_kind")

    def missing(*names: str) -> None:
        raise MissingPeerError("no peers")

    monkeypatch.setattr(program, "needed", missing)
    assert program.main([]) == 2
    assert "no peers" in capsys.readouterr().err


def test_the_product_imports_no_peer() -> None:
    for package in ("rig", "estimator", "control", "faults"):
        for file in (ROOT / package).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            assert "sklearn" not in text, file
            assert "pysindy" not in text, file
