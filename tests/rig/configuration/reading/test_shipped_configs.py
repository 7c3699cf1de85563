"""What is shipped works: every file checks clean and says what the thesis says."""

from math import sqrt
from pathlib import Path

import numpy as np
import pytest
import yaml

from control.setpoints import Pseudorandom, Sine
from estimator.filters.registry import FILTERS
from faults.campaign import CampaignTest, SpringLoad
from faults.schedule import FaultSchedule
from faults.verdict import LEAK_KINDS, Verdict
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.checking import check
from rig.configuration.reading.lookup import FOLDERS, shipped_config_dir

SHIPPED = sorted(shipped_config_dir().rglob("*.yaml"))
CAMPAIGNS = sorted((shipped_config_dir() / FOLDERS["campaign"]).glob("*.yaml"))


def campaign_tests(name: str) -> tuple[CampaignTest, ...]:
    return load_campaign(name)[0].tests


def coefficients(name: str, motion: str = "") -> dict[str, list[float]]:
    """Return the injected coefficients in 1e-9 or 1e-12 SI by kind of leak, in order."""
    found: dict[str, list[float]] = {}
    for test in campaign_tests(name):
        for fault in test.faults if motion in test.name else ():
            scale = 1e12 if fault.linear else 1e9
            found.setdefault(fault.kind, []).append(round(fault.coefficient * scale, 6))
    return found


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_file_checks_clean(path: Path) -> None:
    report = check(path)
    # A check knows the kind of a file by its content.
    assert shipped_config_dir() / FOLDERS[report.kind] == path.parent
    assert report.name == path.stem
    assert report.warnings == ()


@pytest.mark.parametrize("path", CAMPAIGNS, ids=lambda path: path.stem)
def test_every_shipped_campaign_makes_tables_for_the_loop(path: Path) -> None:
    campaign, rig = load_campaign(path)
    assert campaign.filter_name in FILTERS
    for test in campaign.tests:
        ticks = round(test.duration_s * 1000)
        table = FaultSchedule(test.faults).table(ticks, 1e-3)
        assert table.shape == (ticks, 8)
        assert bool(np.any(table)) == (test.expect != Verdict.HEALTHY)
        assert np.isfinite(test.setpoint.sample(np.arange(ticks) * 1e-3)).all()
        assert set(rig.bypass_valves) >= {fault.kind for fault in test.faults}


def test_the_quickstart_is_a_healthy_rig_and_three_leaks_at_two_levels() -> None:
    tests = campaign_tests("quickstart")
    assert [test.expect for test in tests] == [
        Verdict.HEALTHY,
        *(kind for kind in LEAK_KINDS for _ in range(2)),
    ]
    flows = [
        test.faults[0].coefficient * sqrt(2.5e6 if "internal" in test.name else 6.9e6) * 6e4
        for test in tests[1:]
    ]
    assert flows == pytest.approx([0.3, 0.8] * 3)
    assert {test.duration_s for test in tests} == {40.0}


def test_open_loop_leaks_are_those_of_table_5_1() -> None:
    assert coefficients("open_loop_5_1") == {
        "external_leakage_1": [3.87, 7.67],
        "external_leakage_2": [4.04, 9.50],
        "internal_leakage": [11.10, 14.43],
    }
    for test in campaign_tests("open_loop_5_1"):
        assert test.setpoint == Sine(0.0, 3.0, 0.5, 0.1, "command")
        assert all(fault.at_s == 18.0 for fault in test.faults)


def test_closed_loop_leaks_are_those_of_tables_5_2_and_5_3() -> None:
    assert coefficients("closed_loop_sine_5_2_1") == {
        "external_leakage_1": [4.18, 7.31],
        "external_leakage_2": [6.06, 10.07],
        "internal_leakage": [10.12, 12.28],
    }
    assert coefficients("closed_loop_pseudorandom_5_2_2") == {
        "external_leakage_1": [6.83, 12.69],
        "external_leakage_2": [8.45, 12.52],
        "internal_leakage": [13.42, 15.54],
    }


def test_every_pseudorandom_test_has_a_sequence_of_its_own() -> None:
    setpoints = [test.setpoint for test in campaign_tests("closed_loop_pseudorandom_5_2_2")]
    assert len(set(setpoints)) == len(setpoints)
    for setpoint in setpoints:
        assert isinstance(setpoint, Pseudorandom)
        assert (setpoint.lower, setpoint.upper) == (0.05, 0.5)
        assert (setpoint.hold_min_s, setpoint.hold_max_s) == (2.0, 2.0)


def test_simulated_leaks_are_those_of_section_7_1() -> None:
    assert coefficients("simulation_7_1", "sine") == {
        "external_leakage_1": [2.0, 4.0, 6.0],
        "external_leakage_2": [2.0, 4.0, 6.0],
        "internal_leakage": [4.0, 6.0, 8.0],
    }
    assert coefficients("simulation_7_1", "pseudorandom") == {
        str(kind): [2.0, 6.0] for kind in LEAK_KINDS
    }
    for test in campaign_tests("simulation_7_1"):
        assert test.load == SpringLoad(2e4, 0.22)
        assert all(fault.linear and fault.at_s == 20.0 for fault in test.faults)


def test_loaded_leaks_have_the_flows_of_tables_7_1_to_7_3() -> None:
    path = shipped_config_dir() / "campaigns" / "loaded_7_2.yaml"
    flows: dict[str, list[str]] = {}
    for test in yaml.safe_load(path.read_text())["tests"][1:]:
        for (fault,) in test["matrix"]["level"].values():
            flows.setdefault(fault["type"], []).append(fault["flow"])
    assert flows == {
        "external_leakage_1": ["0.32 L/min", "0.46 L/min", "0.56 L/min"],
        "external_leakage_2": ["0.35 L/min", "0.53 L/min", "0.68 L/min"],
        "internal_leakage": ["0.26 L/min", "0.38 L/min", "0.84 L/min"],
    }
    for test in campaign_tests("loaded_7_2"):
        assert test.load == SpringLoad(6e5, 0.176)
        assert len(test.faults) == (0 if test.expect == Verdict.HEALTHY else 1)
