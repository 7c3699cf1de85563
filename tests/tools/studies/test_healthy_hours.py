import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.filters.registry import FILTERS, OUTPUTS, FilterRun
from estimator.leaks.detection import Decision
from estimator.leaks.oil_account import Samples
from rig.lanes import LANES
from tools.studies import healthy_hours
from tools.studies.healthy_hours import (
    Alarm,
    Group,
    Judge,
    Setting,
    poisson_interval,
    read_groups,
    study,
    summary_of,
)

pytestmark = pytest.mark.long

ALARM = Alarm(3, 100.0, "internal_leakage", 90.0, "steps", 5.0, 4.0)
WALL = {"simulation": 1.0, "filter": 1.0, "detector": 2.0}
QUIET = Group(0, 43200.0, WALL, {"healthy": 90, "inconclusive": 10}, [])
LOUD = Group(1, 43200.0, WALL, {"healthy": 99, "internal_leakage": 1}, [ALARM])


@pytest.mark.parametrize(
    ("count", "lower", "upper"), [(0, 0.0, 3.689), (1, 0.0253, 5.572), (10, 4.795, 18.39)]
)
def test_the_interval_of_a_count_is_that_of_tables(count: int, lower: float, upper: float) -> None:
    assert poisson_interval(count) == pytest.approx((lower, upper), rel=1e-3, abs=1e-9)


def test_a_summary_sets_the_alarms_of_all_days_beside_the_setting() -> None:
    found = summary_of([QUIET, LOUD], Setting(1.0))
    assert found["hours"] == 24.0
    assert found["alarms_per_day"] == 1.0
    assert found["setting_within_interval"]
    assert not summary_of([QUIET, LOUD], Setting(100.0))["setting_within_interval"]
    assert found["alarms_by_motion"] == {"steps": 1}
    assert found["decisions"]["inconclusive"] == pytest.approx(0.05)
    assert found["rig_seconds_per_core_second"]["all"] == pytest.approx(86400.0 / 8.0)


def test_a_line_cut_off_by_a_kill_is_run_again(tmp_path: Path) -> None:
    kept = tmp_path / "groups.jsonl"
    kept.write_text(json.dumps(asdict(LOUD)) + "\n" + json.dumps(asdict(QUIET))[:-20])
    assert read_groups(kept) == {1: LOUD}


def test_an_accused_rig_counts_once_and_is_judged_afresh(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    class Accuser:
        """Accuses at the third block of each that it sees."""

        def __init__(self, *_: Any) -> None:
            self.blocks = 0
            made.append(self)

        def update(self, *_: Any) -> None:
            self.blocks += 1

        @property
        def accuses(self) -> bool:
            return self.blocks == 3

        def decide(self) -> Decision:
            return Decision("multiple" if self.accuses else "healthy", onset_s=1.0)

    monkeypatch.setattr(healthy_hours, "OilAccountDetector", Accuser)
    judge = Judge(7, 1.0)
    time_s = np.arange(3.0)
    samples = Samples(time_s, *[time_s] * 6)
    run: Any = None
    alarms = [judge.take(samples, run, "sine") for _ in range(6)]
    assert [alarm is not None for alarm in alarms] == [False, False, True] * 2
    assert len(made) == 3
    assert judge.verdicts == {"multiple": 2}


def test_a_silent_detector_is_asked_for_its_verdict_every_ten_seconds() -> None:
    judge = Judge(7, 1.0)
    for k in range(40):
        time_s = 0.5 * (k + np.arange(2.0))
        still = np.zeros(2)
        samples = Samples(time_s, still, still, still, still, still, still)
        estimates = np.zeros((2, len(FILTERS["product"].states)))
        outputs = np.zeros((2, len(OUTPUTS)))
        run = FilterRun(FILTERS["product"], time_s, estimates, outputs, np.eye(11))
        assert judge.take(samples, run, "still") is None
    assert judge.verdicts == {"inconclusive": 2}


def test_a_detector_that_fails_is_told_with_rig_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(healthy_hours, "OilAccountDetector", lambda *_: None)
    nothing: Any = None
    samples = Samples(np.array([12.0]), *[nothing] * 6)
    with pytest.raises(RuntimeError, match=r"rig 7 at 12\.0 s"):
        Judge(7, 1.0).take(samples, nothing, "sine")


def test_a_study_runs_what_is_asked_once_and_by_its_seed_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_s = 10.0
    hours = 2 * LANES * run_s / 3600.0
    found = study(hours, Setting(1.0), 1, tmp_path, run_s)
    assert found["rigs"] == 2 * LANES
    assert found["hours"] == pytest.approx(hours)
    assert json.loads((tmp_path / "summary-1.json").read_text())["alarms"] == found["alarms"]
    monkeypatch.setattr(healthy_hours, "run_group", None)
    assert study(hours, Setting(1.0), 1, tmp_path, run_s) == found
    monkeypatch.undo()
    again = healthy_hours.run_group(1, Setting(1.0), run_s)
    (kept,) = tmp_path.glob("groups-1-*.jsonl")
    before = read_groups(kept)[1]
    assert (again.verdicts, again.alarms) == (before.verdicts, before.alarms)
