"""The worked example judges the same recordings with two models, and counts honestly."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.plant import Model
from tools.counted_shares import interval
from tools.hidden_effects.recordings import Recorded
from tools.hidden_effects.rig_values import RigValues
from tools.worked_gap_example import trials as example
from tools.worked_gap_example.tables import by_case, by_size, right, wrong
from tools.worked_gap_example.trials import (
    CASES,
    ONSET_S,
    Case,
    Heard,
    Trial,
    heard,
    hiding,
    leaking,
    recorded,
    recording_of,
    tried,
    true_flow,
)

QUIET = Heard("healthy", None, None, None, None, None)
NAMED = Heard("external_leakage_1", ONSET_S + 2.0, ONSET_S + 2.0, 0.1, 0.09, 0.11)
EARLY = replace(NAMED, alarm_s=ONSET_S - 4.0)
OTHER = replace(NAMED, verdict="internal_leakage")
LEAK = Trial("external_leakage_1", 0.1, QUIET, NAMED)


def test_a_leak_is_named_right_only_by_its_name_and_not_before_it_opened() -> None:
    assert right(LEAK, NAMED)
    assert not any(right(LEAK, other) for other in (QUIET, EARLY, OTHER))
    assert [wrong(LEAK, each) for each in (QUIET, NAMED, EARLY, OTHER)] == [
        False, False, True, True,
    ]  # fmt: skip
    assert wrong(Trial(None, 0.0, QUIET, QUIET), OTHER)


def test_tables_hold_counts_with_exact_intervals() -> None:
    assert interval(0, 30) == pytest.approx((0.0, 0.1157), abs=1e-4)
    assert interval(30, 30) == pytest.approx((0.8843, 1.0), abs=1e-4)
    trials = [Trial(None, 0.0, OTHER, QUIET)] + [
        replace(LEAK, flow=flow) for flow in (0.04, 0.07, 0.15, 0.25)
    ]
    table = by_size(trials)
    assert "| healthy | 1 of 1 (2 to 100 %) | 0 of 1 (0 to 98 %) |" in table
    assert "| all leaks | 0 of 4 (0 to 60 %) | 0 of 4 (0 to 60 %) | 0 of 4" in table
    assert "| revised model | 2.0 s |" in table
    assert "valve underlap leakage, 8.00 um" in by_case({CASES[0]: trials})


def test_a_size_of_which_there_is_no_leak_has_a_row_of_dashes() -> None:
    table = by_size([Trial(None, 0.0, QUIET, QUIET), replace(LEAK, flow=0.04)])
    assert "| 0.05 to 0.1 L/min | – | – | – | – |" in table
    assert "| healthy | 0 of 1 (0 to 98 %) | 0 of 1 (0 to 98 %) |  |  |" in table
    assert "| healthy | – | – |  |  |" in by_size([LEAK])


def test_kept_trials_and_models_count_only_for_their_seed_and_their_sources(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made: list[int] = []
    table = np.zeros((1, 1))

    def runs(case: Case, rig: RigValues, seed: int) -> Iterator[tuple[None, float, Recorded]]:
        made.append(seed)
        yield None, float(seed), Recorded(table, table)

    def rig_gap(identify: Sequence[Path], holdout: Path, out: Path) -> dict[str, str]:
        out.mkdir()
        (out / "model.yaml").write_text("")
        return {}

    models: list[str] = []
    monkeypatch.setattr(example, "runs", runs)
    monkeypatch.setattr(example, "rig_gap", rig_gap)
    monkeypatch.setattr(example, "recorded", lambda *given: Recorded(table, table))
    monkeypatch.setattr(example, "write", lambda *given: None)
    monkeypatch.setattr(example, "load_model", models.append)
    monkeypatch.setattr(example, "recording_of", lambda made: made)
    monkeypatch.setattr(example, "heard", lambda recording, model: QUIET)
    assert [tried(CASES[0], tmp_path, seed)[0].flow for seed in (1, 2, 1)] == [1.0, 2.0, 1.0]
    assert made == [1, 2]
    monkeypatch.setattr(example, "sources_digest", lambda: "other")
    assert tried(CASES[0], tmp_path, 1)[0].flow == 1.0
    assert made == [1, 2, 1]
    assert len(set(models)) == len(models) == 3


def test_a_recording_of_the_hidden_rig_is_judged_by_the_detector() -> None:
    rig = hiding(CASES[0], 1)
    leaks = leaking(rig, "external_leakage_1", 0.2)
    made = recorded(leaks, "multisine", [1], ONSET_S + 4.0)
    assert true_flow(leaks, "external_leakage_1", made) == pytest.approx(0.2, rel=0.15)
    same = recorded(rig, "multisine", [1], ONSET_S + 4.0)
    before = made.table[:, 0] < ONSET_S
    assert np.array_equal(made.table[before], same.table[before])
    model = Model().with_effect(CASES[0].effect, value=CASES[0].value)
    assert heard(recording_of(made), model).verdict == "external_leakage_1"
