"""A test of a campaign that locks the cylinder: its outcome, and the ways in which it ends."""

import json
from pathlib import Path

import pytest

from estimator.leak_test import LeakTestError
from estimator.leaks import Decision
from faults import Campaign, CampaignTest
from rig.configuration import Rig, load_campaign
from rig.control_socket import ask
from rig.loop import StopRequestedError, TripError
from rig.report.campaign import write_report
from rig.runner import Observer, Status, run_campaign
from rig.runner.campaign.simulated_bench import SimulatedBench
from rig.runner.campaign.stopping import StopFlag
from rig.runner.leak_test import SimulatedLockable
from rig.runner.outcomes import outcome_of, record_of

ROOT = Path(__file__).parents[4]


class Listening(SimulatedBench):
    """A bench that keeps what its blocking valves were ordered."""

    orders: list[tuple[bool, bool]]

    def lockable(self, test: CampaignTest) -> SimulatedLockable:
        rig, self.orders = super().lockable(test), []
        block = rig.block

        def heard(chamber_1: bool, chamber_2: bool) -> None:
            self.orders.append((chamber_1, chamber_2))
            block(chamber_1, chamber_2)

        rig.block = heard  # type: ignore[method-assign]
        return rig


@pytest.fixture
def leaking(tmp_path: Path) -> tuple[Campaign, Rig]:
    """A campaign with a leak test alone, on `locked` with 0.0015 L/min out of chamber 2."""
    text = (ROOT / "config/rigs/locked.yaml").read_text()
    leak = "plant: {model: nominal, effects: {external_leakage_2: 7.9e-12 m^3/(s Pa^0.5)}}\n"
    (tmp_path / "rig.yaml").write_text(text + leak)
    path = tmp_path / "campaign.yaml"
    path.write_text(
        "name: locked\nrig: rig.yaml\ntests:\n"
        "  - {name: locked, settle: 0 s, expect: external_leakage_2, "
        "leak_test: {at_most: 0.001 L/min, could_see: 0.0015 L/min}}\n"
    )
    return load_campaign(path)


def test_leaks_intervals_and_the_valves_own_leak_are_in_all_results(
    leaking: tuple[Campaign, Rig], tmp_path: Path
) -> None:
    outcome = run_campaign(*leaking, tmp_path / "out")
    (test,) = outcome.tests
    assert test.decision is not None
    assert test.decision.verdict == "external_leakage_2"
    # The leak is the expected one, and larger than what may be.
    assert test.status is Status.FAILED
    assert [each.figure[:9] for each in test.missed] == ["chamber 2"]
    (written,) = json.loads((tmp_path / "out/results.json").read_text())["tests"]
    found = written["leak_test"]
    low, high = found["places"]["external_leakage_2"]["interval_95_L_per_min"]
    assert low < 0.0015 < high
    assert found["blocking_valves"]["chamber_1"]["leak_L_per_min"] < 1e-4
    assert "chamber 2, out: leak, 0.00" in (tmp_path / "out/junit.xml").read_text()
    page = write_report(outcome, tmp_path / "out").read_text()
    assert "Leaks of the locked cylinder" in page
    assert "There is no recording" not in page
    assert "The test ended after" not in page
    assert outcome_of(json.loads(json.dumps(record_of(test)))) == test


@pytest.mark.parametrize(("how", "status"), [("skip", Status.SKIPPED), ("stop", Status.ABORTED)])
def test_a_test_that_is_ended_early_leaves_both_blocking_valves_open(
    how: str, status: Status, leaking: tuple[Campaign, Rig], tmp_path: Path
) -> None:
    campaign, rig = leaking
    stop, bench = StopFlag(), Listening(rig, tmp_path / "out")

    class Ending(Observer):
        def test_advances(self, time_s: float, decision: Decision | None) -> None:
            if time_s > 1.0 and how == "stop":
                stop.request("somebody")
            elif 1.0 < time_s < 1.006:
                ask(tmp_path / "out", "skip")

    outcome = run_campaign(
        campaign, rig, tmp_path / "out", observer=Ending(), stop=stop, bench=bench
    )
    assert outcome.tests[0].status is status
    assert outcome.tests[0].leak_test is None
    assert (True, True) in bench.orders
    assert bench.orders[-1] == (False, False)


@pytest.mark.parametrize(
    ("first", "told"),
    [
        (LeakTestError("chamber 1 lost its pressure"), "chamber 1 lost its pressure"),
        (StopRequestedError("stopped by ann"), "stopped by ann"),
        (ValueError("of a mistake"), "ValueError: of a mistake (test_leak_step.py:"),
    ],
)
def test_what_ended_a_test_is_told_before_what_then_kept_its_rig_locked(
    first: Exception,
    told: str,
    leaking: tuple[Campaign, Rig],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise first

    def stays_locked(*_: object) -> None:
        raise TripError("the blocking valves do not open; look at them")

    monkeypatch.setattr(SimulatedLockable, "exchange", fails)
    monkeypatch.setattr(SimulatedLockable, "release", stays_locked)
    (test,) = run_campaign(*leaking, tmp_path / "out").tests
    assert test.status is Status.TRIPPED
    assert test.message.startswith(told)
    assert test.message.endswith(
        "as the rig was released: the blocking valves do not open; look at them"
    )
