from math import isnan

import pytest
from hypothesis import given, strategies as st

from estimator.leaks.confirmation import CONFIRMED_AFTER_S
from estimator.leaks.detection import Decision
from faults.verdict import Verdict
from rig.loop.decided import DECIDED, VERDICT_CODES
from rig.plant import FAULTS
from rig.runner.outcomes.reactions import DecisionRows


def named(row: object) -> dict[str, float]:
    return dict(zip(DECIDED, row, strict=True))  # type: ignore[call-overload]


def test_a_row_holds_all_that_was_decided() -> None:
    decision = Decision(
        "external_leakage_2",
        onset_s=3.0,
        leak_m3_per_s=1e-5,
        leak_std_m3_per_s=1e-6,
        probabilities=dict.fromkeys(("healthy", *FAULTS), 0.0) | {"external_leakage_2": 1.0},
        present_leaks=(0.0, 4e-9, 0.0),
    )
    row = named(DecisionRows().row(7.0, decision))
    assert row["decided_at_s"] == 7.0
    assert VERDICT_CODES[int(row["verdict_code"])] == "external_leakage_2"
    assert row["fault_confirmed"] == 1.0
    assert row["probability_external_leakage_2"] == 1.0
    assert row["probability_healthy"] == 0.0
    assert row["decided_leak_low_m3_per_s"] == pytest.approx(1e-5 - 1.96e-6)
    assert row["decided_leak_high_m3_per_s"] == pytest.approx(1e-5 + 1.96e-6)
    assert row["present_external_leakage_2_m3_per_s_sqrtPa"] == 4e-9
    assert row["present_internal_leakage_m3_per_s_sqrtPa"] == 0.0


def test_what_is_not_known_is_nan_and_not_zero() -> None:
    row = named(DecisionRows().row(0.5, Decision("inconclusive")))
    assert isnan(row["probability_healthy"])
    assert isnan(row["decided_leak_m3_per_s"])
    assert isnan(row["decided_leak_low_m3_per_s"])


@given(verdicts=st.lists(st.sampled_from(Verdict), min_size=1, max_size=40))
def test_a_fault_is_confirmed_once_its_verdict_was_held_without_a_break(
    verdicts: list[Verdict],
) -> None:
    rows = DecisionRows()
    needed = round(CONFIRMED_AFTER_S / 0.5)
    for i, verdict in enumerate(verdicts):
        row = named(rows.row(0.5 * (i + 1), Decision(verdict)))
        fault = verdict not in ("healthy", "inconclusive")
        held = i >= needed and set(verdicts[i - needed : i + 1]) == {verdict}
        assert row["fault_confirmed"] == float(fault and held)


def test_a_verdict_that_nobody_knows_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"'leak' is not known.*healthy"):
        DecisionRows().row(0.5, Decision("leak"))
