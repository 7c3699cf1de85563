"""The smallest leak that a sweep finds: what is said where no curve shows it."""

import numpy as np
import pyarrow as pa
import pytest

from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.sweep.words import _rate, limit_in_words
from rig.sweep.study import study_of


def words(flows: list[float], named: list[bool]) -> str:
    """Return what is said of leaks of some flows, L/min, of which some were named right."""
    none = [float("nan")] * len(flows)
    table = pa.table(
        {
            "case": range(len(flows)),
            "fault": ["internal_leakage"] * len(flows),
            "verdict": ["internal_leakage" if right else "healthy" for right in named],
            "right": named,
            "false_alarm": [False] * len(flows),
            "lost": [False] * len(flows),
            "leak_true_m3_per_s": [flow * LITRE_PER_MINUTE for flow in flows],
            **{f"leak_{what}m3_per_s": none for what in ("", "low_", "high_")},
            "latency_s": none,
            "score": none,
        }
    )
    return limit_in_words(study_of(table).power["all"])


def test_sizes_that_separate_completely_are_both_given() -> None:
    flows = np.geomspace(0.01, 1.0, 40).tolist()
    reported = words(flows, [flow > 0.1 for flow in flows])
    assert (
        reported
        == "none up to 0.0943 L/min, all from 0.106 L/min on: 40 cases draw no curve between"
    )


@pytest.mark.parametrize(
    ("named", "reported"),
    [
        ([True] * 3, "not known: all 3 were named, down to 0.1 L/min"),
        ([False] * 3, "not known: none of 3 was named, up to 0.3 L/min"),
        ([True, False, True], "not known: 3 cases are too few"),
    ],
)
def test_why_none_is_known_is_reported(named: list[bool], reported: str) -> None:
    assert words([0.1, 0.2, 0.3], named) == reported


def test_a_rate_below_one_is_not_told_as_none() -> None:
    assert [_rate(each) for each in (0.35, 4.0, 219.4)] == ["0.35", "4", "219"]


def test_a_curve_that_leads_beyond_the_flows_drawn_gives_none() -> None:
    random = np.random.default_rng(3)
    flows = np.exp(random.uniform(np.log(0.01), np.log(1.0), 400))
    named = random.random(400) < 0.1 + 0.3 * flows
    assert words(flows.tolist(), named.tolist()) == "not known: beyond the flows that were drawn"
