"""The table of leaks has a row for each leak and law, from what a run found."""

import json
from pathlib import Path

from rig.configuration import load_campaign
from tools.tracking.leaks import table

CAMPAIGN = Path(__file__).parents[3] / "tools" / "tracking" / "leaks.yaml"


def test_each_leak_is_run_as_often_under_both_laws() -> None:
    campaign, _ = load_campaign(CAMPAIGN)
    under = [
        test.control is not None and not test.control.is_proportional for test in campaign.tests
    ]
    assert len(under) == 70
    assert sum(under) == 35


def test_repeats_are_one_row_with_median_and_spread(tmp_path: Path) -> None:
    tests = [
        {
            "name": f"internal_leakage 0.1, tracking {seed}",
            "status": "passed",
            "found": {"latency_s": 2.0, "leak_L_per_min": 0.1},
        }
        for seed in (1, 2)
    ]
    (tmp_path / "results.json").write_text(json.dumps({"tests": tests}))
    assert list(table(tmp_path))[2:] == [
        "| internal_leakage | 0.1 | tracking | 2 of 2 | 2.0 | 0.100 ± 0.000 |"
    ]
